"""Distance of a point from a surface: theory page "contact", (T.2) to (T.4).

One formula covers walls and circles: a circle of curvature kappa, which is zero for a wall and
negative if the point is inside the circle. A tabulated surface is a cubic spline whose nearest
point is found by Newton's method.

=============  =================================================================================
symbol         meaning
=============  =================================================================================
``gap``        distance of the point from the surface, negative for a penetration, m
``n``          unit normal of the surface, pointing away from the solid
``bend``       curvature of the surface, 1/m, positive if it is convex towards the point
``s``          arc length along a tabulated surface, m
=============  =================================================================================

Two branches depend on the state, and use real parts alone: the selection of the nearest piece of a
table, and the steps of Newton's iteration. The spline is twice continuously differentiable, so the
results and their derivatives are continuous across the knots, and the point found does not depend
on the path of the iteration.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.kernels.compilation.cache import merged
from flexarm.kernels.compilation.numbers import real, sqrt
from flexarm.kernels.layout import Array

#: Columns of a surface, from the first one in its array. CURVATURE, POINT and NORMAL describe a
#: wall or a circle; FIRST is the first row of a table in ``knots`` and COUNT its number of rows, 0
#: without a table.
CURVATURE, POINT, NORMAL, FIRST, COUNT = 0, 1, 3, 5, 6
SURFACE_PLACES = 7

#: Number of Newton iterations. Near the surface three reach rounding errors, because the pieces
#: are short and the initial value is close.
_ITERATIONS = 8


@merged
def _arc(rows: Array, k: int, at: int, x: Any, y: Any) -> tuple[Any, Any, Any, Any]:
    """Return gap, normal and curvature of a wall or a circle at a world point, (T.2)."""
    bend = rows[k, at + CURVATURE]
    dx = x - rows[k, at + POINT]
    dy = y - rows[k, at + POINT + 1]
    height = rows[k, at + NORMAL] * dx + rows[k, at + NORMAL + 1] * dy
    rise = 2.0 * height + bend * (dx * dx + dy * dy)
    root = sqrt(1.0 + bend * rise)
    gap = rise / (1.0 + root)
    nx = (rows[k, at + NORMAL] + bend * dx) / root
    ny = (rows[k, at + NORMAL + 1] + bend * dy) / root
    return gap, nx, ny, bend + 0.0 * gap


@merged
def _nearest_chord(knots: Array, first: int, last: int, x: Any, y: Any) -> tuple[int, float]:
    """Return the piece between knots whose chord is nearest to a point, and the arc length."""
    near = first + 1
    place = real(knots[near, 0])
    least = np.inf
    for j in range(first + 1, last):
        cx = real(knots[j + 1, 1]) - real(knots[j, 1])
        cy = real(knots[j + 1, 5]) - real(knots[j, 5])
        dx = real(x) - real(knots[j, 1])
        dy = real(y) - real(knots[j, 5])
        along = min(max((cx * dx + cy * dy) / (cx * cx + cy * cy), 0.0), 1.0)
        away = (dx - along * cx) ** 2 + (dy - along * cy) ** 2
        if away < least:
            least = away
            near = j
            start = real(knots[j, 0])
            place = start + along * (real(knots[j + 1, 0]) - start)
    return near, place


@merged
def _table(rows: Array, k: int, at: int, knots: Array, x: Any, y: Any) -> tuple[Any, Any, Any, Any]:
    """Return gap, normal and curvature at the nearest point of a table, (T.3), (T.4)."""
    first = int(real(rows[k, at + FIRST]))
    last = first + int(real(rows[k, at + COUNT])) - 1
    near, place = _nearest_chord(knots, first, last, x, y)
    s = place + 0.0 * x
    # Limit the search to the neighbouring pieces: a longer step could pass around a sharp end.
    lowest = real(knots[near - 1, 0])
    highest = real(knots[min(near + 2, last), 0])
    # An open curve continues straight beyond its ends.
    if real(knots[first, 0]) == real(knots[first + 1, 0]):
        lowest = lowest if near - 1 > first else -np.inf
        highest = highest if near + 2 < last else np.inf
    elif near + 1 == last:
        highest = real(knots[last, 0]) + real(knots[first + 2, 0]) - real(knots[first + 1, 0])
    for _ in range(_ITERATIONS):
        while near < last and real(s) >= real(knots[near + 1, 0]):
            near += 1
        while near > first and real(s) < real(knots[near, 0]):
            near -= 1
        u = s - knots[near, 0]
        dx = knots[near, 1] + u * (knots[near, 2] + u * (knots[near, 3] + u * knots[near, 4])) - x
        dy = knots[near, 5] + u * (knots[near, 6] + u * (knots[near, 7] + u * knots[near, 8])) - y
        tx = knots[near, 2] + u * (2.0 * knots[near, 3] + u * 3.0 * knots[near, 4])
        ty = knots[near, 6] + u * (2.0 * knots[near, 7] + u * 3.0 * knots[near, 8])
        square = tx * tx + ty * ty
        slope = square + dx * (2.0 * knots[near, 3] + u * 6.0 * knots[near, 4])
        slope += dy * (2.0 * knots[near, 7] + u * 6.0 * knots[near, 8])
        # Beyond half a radius of curvature Newton's method may diverge, so shorten its steps.
        if real(slope) < 0.5 * real(square):
            slope = 0.5 * square
        s = s - (dx * tx + dy * ty) / slope
        if real(s) < lowest or real(s) > highest:
            s = min(max(real(s), lowest), highest) + 0.0 * x
    while near < last and real(s) >= real(knots[near + 1, 0]):
        near += 1
    while near > first and real(s) < real(knots[near, 0]):
        near -= 1
    u = s - knots[near, 0]
    dx = x - knots[near, 1] - u * (knots[near, 2] + u * (knots[near, 3] + u * knots[near, 4]))
    dy = y - knots[near, 5] - u * (knots[near, 6] + u * (knots[near, 7] + u * knots[near, 8]))
    tx = knots[near, 2] + u * (2.0 * knots[near, 3] + u * 3.0 * knots[near, 4])
    ty = knots[near, 6] + u * (2.0 * knots[near, 7] + u * 3.0 * knots[near, 8])
    turn = tx * (2.0 * knots[near, 7] + u * 6.0 * knots[near, 8])
    turn -= ty * (2.0 * knots[near, 3] + u * 6.0 * knots[near, 4])
    length = sqrt(tx * tx + ty * ty)
    nx = -ty / length
    ny = tx / length
    return nx * dx + ny * dy, nx, ny, -turn / (length * length * length)


@merged
def nearest(
    rows: Array, k: int, at: int, knots: Array, x: Any, y: Any
) -> tuple[Any, Any, Any, Any]:
    """Return gap, normal and curvature of the surface of row k at a point.

    The columns of the surface begin at ``at``; ``knots`` (pieces, 9) has the tables.
    """
    if real(rows[k, at + COUNT]) > 0.0:
        return _table(rows, k, at, knots, x, y)
    return _arc(rows, k, at, x, y)
