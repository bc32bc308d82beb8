"""Walls, circles and curves through points, as arrays of the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from flexarm.base.late import interpolate
from flexarm.integrate.base import FloatArray
from flexarm.kernels.forces.surface import (
    COUNT,
    CURVATURE,
    FIRST,
    NORMAL,
    POINT,
    SURFACE_PLACES,
)
from flexarm.model.surfaces import RoundWall, Surface, SurfaceTable, Wall


def surface_rows(surfaces: Sequence[Surface]) -> tuple[FloatArray, FloatArray]:
    """Return a row (k, SURFACE_PLACES) for each surface, and the pieces (pieces, 9) of tables."""
    rows, tables, count = np.zeros((len(surfaces), SURFACE_PLACES)), [np.zeros((0, 9))], 0
    for row, surface in zip(rows, surfaces, strict=True):
        if isinstance(surface, SurfaceTable):
            tables.append(pieces_of(surface))
            row[FIRST], row[COUNT] = count, len(tables[-1])
            count += len(tables[-1])
        else:
            curvature, point, normal = arc_of(surface)
            row[CURVATURE], row[POINT : POINT + 2], row[NORMAL : NORMAL + 2] = (
                curvature,
                point,
                normal,
            )
    return rows, np.concatenate(tables)


#: Maximum rotation (rad) of the tangent of a tabulated surface within a piece, so that the nearest
#: knot is a good initial value for Newton's method.
_TURN = 0.25
_MOST_CUTS = 64


def arc_of(surface: Wall | RoundWall) -> tuple[float, FloatArray, FloatArray]:
    """Return the curvature (1/m, negative inside a circle), a point (2,) m and the normal there."""
    if isinstance(surface, Wall):
        normal = np.asarray(surface.normal, dtype=np.float64)
        normal = normal / np.max(np.abs(normal))  # prevents an overflow of the squares
        return 0.0, np.asarray(surface.point, dtype=np.float64), normal / np.linalg.norm(normal)
    outward = np.array([1.0, 0.0])
    sign = -1.0 if surface.inside else 1.0
    point = np.asarray(surface.center, dtype=np.float64) + surface.radius * outward
    return sign / surface.radius, point, sign * outward


@lru_cache(maxsize=32)
def pieces_of(surface: SurfaceTable) -> FloatArray:
    """Return rows (pieces, 9) of the spline through the points of a surface; see ``_cut``."""
    points = np.array(surface.points)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    ends = "periodic" if surface.closed else "natural"
    spline = interpolate.CubicSpline(np.append(0.0, np.cumsum(lengths)), points, bc_type=ends)
    return _cut(spline, surface.closed)


def _cut(spline: interpolate.CubicSpline, closed: bool) -> FloatArray:
    """Return rows (pieces, 9): start (polygon length, m), cubics of x, y; open at both ends."""
    starts = []
    for a, b in zip(spline.x[:-1], spline.x[1:], strict=True):
        slopes = spline(np.linspace(a, b, 17), 1)
        angles = np.unwrap(np.arctan2(slopes[:, 1], slopes[:, 0]))
        turn = np.abs(np.diff(angles)).sum()
        cuts = min(_MOST_CUTS, max(1, int(np.ceil(turn / _TURN))))
        starts += np.linspace(a, b, cuts, endpoint=False).tolist()
    s = np.array(starts)
    powers = [spline(s, k) / factor for k, factor in enumerate((1.0, 1.0, 2.0))]
    # The third derivative is discontinuous at knots, so evaluate it inside each piece.
    ends = np.append(s[1:], spline.x[-1])
    powers.append(spline(0.5 * (s + ends), 3) / 6.0)
    rows = np.column_stack([s, *(np.stack(powers, axis=2).reshape(len(s), 8).T)])
    first, last = rows[:1].copy(), rows[-1:].copy()
    if closed:
        before, after = last, first
        before[0, 0] = rows[0, 0] - (spline.x[-1] - rows[-1, 0])
        after[0, 0] = spline.x[-1]
    else:
        before, after = first, last
        end = spline.x[-1]
        before[0, 3:5] = before[0, 7:9] = 0.0
        after[0] = 0.0
        after[0, 0] = end
        after[0, [1, 5]], after[0, [2, 6]] = spline(end), spline(end, 1)
    table: FloatArray = np.concatenate([before, rows, after])
    table.setflags(write=False)
    return table


def course_of(surface: SurfaceTable, beyond: float, count: int) -> FloatArray:
    """Return ``count`` points (k, 2) of a curve, and one ``beyond`` (m) each end of an open one."""
    table = pieces_of(surface)
    first, last = table[1, 0], table[-1, 0]
    s = np.linspace(first, last, count)
    if beyond and not surface.closed:
        s = np.concatenate([[first - beyond], s, [last + beyond]])
    piece = table[np.searchsorted(table[1:, 0], s, side="right")]
    d = s - piece[:, 0]
    powers = np.stack([np.ones_like(d), d, d**2, d**3], axis=1)
    return np.stack(
        [np.sum(piece[:, 1:5] * powers, axis=1), np.sum(piece[:, 5:9] * powers, axis=1)], axis=1
    )
