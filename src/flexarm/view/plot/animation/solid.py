"""Surfaces in animations: their outline, and a band of the solid behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.arm.actions.surfaces import arc_of, pieces_of
from flexarm.model import RoundWall, Surface, SurfaceTable, Wall
from flexarm.view.plot.drawn_arm import FloatArray

#: Thickness of the band, as a fraction of the width of the view.
_BAND = 0.03
_POINTS = 181


@dataclass(frozen=True, eq=False)
class Solid:
    """Surface: its outline (k, 2) m, and the far side (k, 2) of a band of the solid behind it."""

    course: FloatArray
    behind: FloatArray


def solid_of(surface: Surface, view: FloatArray) -> Solid:
    """Return the outline and band of a surface in a view: left, right, bottom, top, m."""
    width = float(view[1] - view[0])
    middle = np.array([view[0] + view[1], view[2] + view[3]]) / 2.0
    if isinstance(surface, SurfaceTable):
        course = _course(surface, width)
        along = np.gradient(course, axis=0)
        along /= np.linalg.norm(along, axis=1)[:, None]
        inward = np.stack([along[:, 1], -along[:, 0]], axis=1)  # solid lies to the right
    elif isinstance(surface, RoundWall):
        angle = np.linspace(0.0, 2.0 * np.pi, _POINTS)
        outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        course = np.asarray(surface.center, dtype=np.float64) + surface.radius * outward
        inward = outward if surface.inside else -outward
    else:
        course, inward = _line(surface, middle, width)
    return Solid(course, course + _BAND * width * inward)


def _line(surface: Wall, middle: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    _, point, normal = arc_of(surface)
    along = np.array([normal[1], -normal[0]])
    nearest = point + along * float(along @ (middle - point))
    course = nearest + np.outer([-2.0 * width, 2.0 * width], along)
    return course, np.array([-normal, -normal])


def _course(surface: SurfaceTable, width: float) -> FloatArray:
    """Return points (k, 2) of a tabulated curve; an open one continues straight beyond its ends."""
    table = pieces_of(surface)
    beyond = 0.0 if surface.closed else 2.0 * width
    first, last = table[1, 0], table[-1, 0]
    s = np.linspace(first, last, _POINTS)
    if beyond:
        s = np.concatenate([[first - beyond], s, [last + beyond]])
    piece = table[np.searchsorted(table[1:, 0], s, side="right")]
    d = s - piece[:, 0]
    powers = np.stack([np.ones_like(d), d, d**2, d**3], axis=1)
    return np.stack(
        [np.sum(piece[:, 1:5] * powers, axis=1), np.sum(piece[:, 5:9] * powers, axis=1)], axis=1
    )
