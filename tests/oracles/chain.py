"""An arm as a chain of pieces: whole links, or the segments of a link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexarm.model import ArmSpec, Joint, Link, SectionTable


@dataclass(frozen=True)
class Piece:
    """A link or a segment, described by ``link``.

    hub_radius: distance from the joint to the root, m. joint: at its root, or None for a rigid
    connection. owner: index of the link it belongs to. start: distance of its root from that link's
    root, m. rows: its nodes among those of that link.
    """

    link: Link
    hub_radius: float
    joint: Joint | None
    owner: int
    start: float
    rows: slice


def cut(spec: ArmSpec) -> list[Piece]:
    """Return all pieces of an arm from the base outwards."""
    pieces = []
    for owner, (link, joint) in enumerate(zip(spec.links, spec.joints, strict=True)):
        count = link.segments if link.flexible else 1
        nodes = link.elements // count
        for k in range(count):
            start = link.length * k / count
            part = link if count == 1 else segment(link, start, link.length * (k + 1) / count)
            rows = slice(k * nodes, (k + 1) * nodes)
            radius = link.hub_radius if k == 0 else 0.0
            pieces.append(Piece(part, radius, joint if k == 0 else None, owner, start, rows))
    return pieces


def segment(link: Link, start: float, end: float) -> Link:
    """Return the part of a link between two distances from its root (m), as a separate link."""
    beam = link.beam()
    x = np.array(beam.x)
    stations = np.concatenate([[start], x[(x > start) & (x < end)], [end]])
    columns: dict[str, Any] = {
        name: np.interp(stations, x, getattr(beam, name)).tolist()
        for name in ("flexural_rigidity", "mass_per_length", "rotary_inertia_per_length")
    }
    return Link(
        length=end - start,
        table=SectionTable(x=(stations - start).tolist(), **columns),
        elements=link.elements // link.segments,
        damping=link.damping,
    )
