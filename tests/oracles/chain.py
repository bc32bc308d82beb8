"""An arm as a tree of pieces: whole links, or the parts of a link."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from flexarm.model import ArmSpec, Joint, Link, SectionTable

#: Stations within this fraction of the length of a link are one; sums of lengths are rounded.
SAME = 1e-9


@dataclass(frozen=True)
class Seat:
    """A section that carries a root: of the piece with this index, or of the base (None), at the
    tip of the piece or at its own root."""

    piece: int | None = None
    at_root: bool = False


@dataclass(frozen=True)
class Piece:
    """A link or a part of one, described by ``link``.

    hub_radius: distance from the joint to the root, m. joint: at its root, or None for a rigid
    connection. owner: index of the link it belongs to. start: distance of its root from that link's
    root, m. rows: its nodes among those of that link. seat: the section that carries its root.
    """

    link: Link
    hub_radius: float
    joint: Joint | None
    owner: int
    start: float
    rows: slice
    seat: Seat = field(default_factory=Seat)

    def meshed(self, elements: int) -> Piece:
        """Return the piece with this number of elements."""
        if elements == self.link.elements:
            return self
        return replace(self, link=self.link.model_copy(update={"elements": elements}))


def cut(spec: ArmSpec) -> list[Piece]:
    """Return all pieces of an arm; each follows the one that carries it.

    A link is divided into its segments, and where the joint of another link or a closure is.
    """
    pieces: list[Piece] = []
    for owner, (link, joint) in enumerate(zip(spec.links, spec.joints, strict=True)):
        seat, node = seat_of(spec, owner, pieces), 0
        ends = divisions(spec, owner)
        for k, (start, end) in enumerate(pairwise(ends)):
            elements = shared(link.elements, ends)[k]
            part = link if len(ends) == 2 else segment(link, start, end, elements)
            rows = slice(node, node + part.elements)
            radius = link.hub_radius if k == 0 else 0.0
            owned = joint if k == 0 else None
            pieces.append(Piece(part, radius, owned, owner, start, rows, seat))
            seat, node = Seat(len(pieces) - 1), rows.stop
    return pieces


def parent_of(spec: ArmSpec, owner: int) -> int:
    """Return the index of the link that carries the joint of a link, -1 for the base."""
    parent = spec.links[owner].parent
    return owner - 1 if parent is None else parent - 1


def seat_of(spec: ArmSpec, owner: int, pieces: list[Piece]) -> Seat:
    """Return the section that carries the joint of a link."""
    parent, station = parent_of(spec, owner), spec.links[owner].parent_station
    if parent < 0:
        return Seat()
    own = [i for i, piece in enumerate(pieces) if piece.owner == parent]
    length = spec.links[parent].length
    if station is None:
        return Seat(own[-1])
    if station <= SAME * length:
        return Seat(own[0], at_root=True)
    ends = [pieces[i].start + pieces[i].link.length for i in own]
    return Seat(own[int(np.argmin(np.abs(np.subtract(ends, station))))])


def divisions(spec: ArmSpec, owner: int) -> list[float]:
    """Return the stations (m) of the ends of all pieces of a link, from 0 to its length."""
    link = spec.links[owner]
    count = link.segments if link.flexible else 1
    ends = [link.length * k / count for k in range(count + 1)]
    points = [(parent_of(spec, i) + 1, child.parent_station) for i, child in enumerate(spec.links)]
    for closure in spec.closures:
        points += [(closure.link, closure.station), (closure.to_link, closure.to_station)]
    for number, station in points:
        if station is None or number != owner + 1:
            continue
        if min(abs(station - end) for end in ends) > SAME * link.length:
            ends = sorted([*ends, station])
    return ends


def shared(elements: int, ends: list[float]) -> list[int]:
    """Return the elements of each part: at least one, and otherwise in proportion to the length.

    Shares are rounded down, and the elements that are left go where most was lost, one each.
    """
    shares = elements * np.diff(ends) / ends[-1]
    counts = [max(1, int(share + SAME)) for share in shares]
    lost = np.argsort(counts - shares, kind="stable")
    for part in lost[: max(0, elements - sum(counts))]:
        counts[part] += 1
    return counts


def segment(link: Link, start: float, end: float, elements: int) -> Link:
    """Return the part of a link between two distances from its root (m), as a separate link."""
    beam = link.beam()
    x = np.array(beam.x)
    stations = np.concatenate([[start], x[(x > start) & (x < end)], [end]])
    columns: dict[str, Any] = {
        name: np.interp(stations, x, getattr(beam, name)).tolist()
        for name in ("flexural_rigidity", "mass_per_length", "rotary_inertia_per_length")
        if getattr(beam, name) is not None
    }
    return Link(
        length=end - start,
        table=SectionTable(x=(stations - start).tolist(), **columns),
        elements=elements,
        flexible=link.flexible,
        damping=link.damping,
    )
