"""Loads on an arm as forces on material points, converted to generalised forces by virtual work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .chain import Piece
from .jets import Rate
from .material_points import gauss_points, hermite


@dataclass(frozen=True)
class LoadPoints:
    """The points of one piece that a load acts on.

    piece: index. x (k,): stations, m. weight (k,): 1 at a station, m for a distributed load.
    deflection, slope (k, m): v and v' there; inner_slope (j, m): v' at the points of the integral
    of v'^2, and running (k, j) their weights for an integral from the root to each station.
    force (2,): N, or N/m; moment: N m; follower: whether the force turns with the root tangent.
    """

    piece: int
    x: np.ndarray
    weight: np.ndarray
    deflection: np.ndarray
    slope: np.ndarray
    inner_slope: np.ndarray
    running: np.ndarray
    force: np.ndarray
    moment: float
    follower: bool

    def generalised_force(
        self, place: tuple[Rate, Rate], angle: Rate, frame: Rate, coordinates: slice
    ) -> np.ndarray:
        """Force on the coordinates from world positions (k,), section angles (k,) and the angle of
        the root tangent: the virtual work per coordinate."""
        fx, fy = self.force
        if self.follower:
            c, s = np.cos(frame.value.value), np.sin(frame.value.value)
            fx, fy = c * fx - s * fy, s * fx + c * fy
        dx, dy, turn = (rate.value.first[:, coordinates] for rate in (*place, angle))
        return self.weight @ (fx * dx + fy * dy + self.moment * turn)


def load_points(
    loads: Sequence[Any],
    pieces: Sequence[Piece],
    bases: Sequence[np.ndarray | None],
    precision: type[np.floating],
) -> list[LoadPoints]:
    """Return the points of loads (the package's ``Load``) on the pieces of an arm."""
    found = []
    for load in loads:
        own = [i for i, piece in enumerate(pieces) if piece.owner == load.link - 1]
        if load.spread is None:
            i = own[-1]
            x = precision(pieces[i].link.length)
            if load.station is not None:
                i = max(k for k in own if pieces[k].start <= load.station or k == own[0])
                x = precision(load.station - pieces[i].start)
            found.append(_points(load, i, pieces, bases, np.array([x]), np.ones(1), precision))
            continue
        for i in own:
            link, start = pieces[i].link, pieces[i].start
            first, last = np.clip(np.array(load.spread) - start, 0, link.length)
            if last > first:
                nodes = np.arange(link.elements + 1) * link.length / link.elements
                inside = nodes[(nodes > first) & (nodes < last)]
                edges = np.concatenate([[first], inside, [last]]).astype(precision)
                x, weight = gauss_points(edges, 4)
                found.append(_points(load, i, pieces, bases, x, weight, precision))
    return found


def _points(
    load: Any,
    index: int,
    pieces: Sequence[Piece],
    bases: Sequence[np.ndarray | None],
    x: np.ndarray,
    weight: np.ndarray,
    precision: type[np.floating],
) -> LoadPoints:
    link, basis = pieces[index].link, bases[index]
    length, elements = precision(link.length), link.elements
    if not link.flexible:
        basis = np.zeros((2 * elements, 0))
    elif basis is None:
        basis = np.eye(2 * elements)
    nodes = np.arange(elements + 1) * length / elements
    # v'^2 has degree 4 between nodes.
    inner_x, inner_weight = gauss_points(np.unique(np.concatenate([nodes, x])), 3)

    def shapes(stations: np.ndarray, derivative: int) -> np.ndarray:
        return (hermite(stations, length, elements, derivative) @ basis).astype(precision)

    return LoadPoints(
        piece=index,
        x=x.astype(precision),
        weight=weight.astype(precision),
        deflection=shapes(x, 0),
        slope=shapes(x, 1),
        inner_slope=shapes(inner_x, 1),
        running=np.where(inner_x < x[:, None], inner_weight, 0.0).astype(precision),
        force=np.asarray(load.force, dtype=precision),
        moment=float(load.moment),
        follower=load.frame == "link",
    )
