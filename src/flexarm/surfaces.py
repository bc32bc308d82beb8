"""Surfaces for contacts: walls, circles, and curves through points.

They are fixed in the axes of the arm's base, and move with an accelerated base.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_flag, check_positive
from flexarm.assemble import FloatArray
from flexarm.errors import InputError, Problem, check_array, shown

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

#: Maximum rotation (rad) of the tangent of a tabulated surface within a piece, so that the nearest
#: knot is a good initial value for Newton's method.
_TURN = 0.25
_MOST_CUTS = 64
#: Points closer than this fraction of the extent are equal, because of rounding errors.
_SAME_PLACE = 1e-9


@dataclass(frozen=True, eq=False)
class Wall:
    """A straight surface; the region behind it, against the normal, is solid.

    Args:
        point: (x, y) m, any point of the wall.
        normal: (x, y), pointing away from the wall; any length except zero.

    Raises:
        InputError: if a value is not finite, or the normal is zero.
    """

    point: ArrayLike
    normal: ArrayLike

    def __post_init__(self) -> None:
        check_array("Wall", "point", self.point, (2,))
        normal = check_array("Wall", "normal", self.normal, (2,))
        if not np.any(normal):
            rule = "have a length greater than 0"
            raise InputError(Problem("Wall", "normal", rule, shown(self.normal)))

    @property
    def arc(self) -> tuple[float, FloatArray, FloatArray]:
        """Curvature 0 (1/m), a point (2,) m and the unit normal (2,) there."""
        normal = np.asarray(self.normal, dtype=np.float64)
        normal = normal / np.max(np.abs(normal))  # prevents an overflow of the squares
        return 0.0, np.asarray(self.point, dtype=np.float64), normal / np.linalg.norm(normal)


@dataclass(frozen=True, eq=False)
class RoundWall:
    """A circle: a solid post with contacts from outside, or a round room with contacts from inside.

    Args:
        center: (x, y) m. radius: m, positive.
        inside: whether the arm is inside the circle.

    Raises:
        InputError: if a value is not finite, the radius is not positive, or ``inside`` is not a
            truth value.
    """

    center: ArrayLike
    radius: float
    inside: bool = False

    def __post_init__(self) -> None:
        check_array("RoundWall", "center", self.center, (2,))
        check_positive("RoundWall", "radius", self.radius)
        check_flag("RoundWall", "inside", self.inside)

    @property
    def arc(self) -> tuple[float, FloatArray, FloatArray]:
        """Curvature (1/m, negative inside), a point (2,) m and the unit normal (2,) there."""
        center = np.asarray(self.center, dtype=np.float64)
        outward = np.array([1.0, 0.0])
        sign = -1.0 if self.inside else 1.0
        return sign / self.radius, center + self.radius * outward, sign * outward


@dataclass(frozen=True, eq=False)
class SurfaceTable:
    """A smooth curve through points; the region to the right of its direction is solid.

    The curve is a cubic spline over the length of the polygon through the points. A profile with
    increasing x is therefore solid below. An open curve continues straight beyond its ends.

    Args:
        x, y: (k,) m, three points or more; consecutive points must differ.
        closed: whether the curve continues from the last point to the first. The arm is inside a
            counter-clockwise curve and outside a clockwise one.

    Raises:
        InputError: if a value is not finite, there are too few points, two consecutive points are
            equal, or the polygon of a closed curve crosses itself.
    """

    x: ArrayLike
    y: ArrayLike
    closed: bool = False
    pieces: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        from scipy.interpolate import CubicSpline

        where = "SurfaceTable"
        check_flag(where, "closed", self.closed)
        x = check_array(where, "x", self.x, (-1,))
        points = np.stack([x, check_array(where, "y", self.y, x.shape)], axis=1)
        near = _SAME_PLACE * float(np.ptp(points, axis=0).max(initial=0.0))
        if self.closed and len(points) and np.linalg.norm(points[0] - points[-1]) <= near:
            points = points[:-1]
        if len(points) < 3:
            raise InputError(Problem(where, "x", "have at least three points", shown(self.x)))
        if self.closed:
            points = np.concatenate([points, points[:1]])
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if np.any(lengths <= near):
            k = int(np.argmin(lengths)) + 1
            rule = "differ from the previous point"
            raise InputError(Problem(where, f"the point [{k}]", rule, shown(points[k].tolist())))
        if self.closed and abs(_area(points)) <= near * float(lengths.sum()):
            raise InputError(Problem(where, "x", "enclose an area with y", shown(self.x)))
        crossing = _crossing(points) if self.closed else None
        if crossing is not None:
            rule = f"and y cross themselves after the points [{crossing[0]}] and [{crossing[1]}]"
            raise InputError(Problem(where, "x", rule))
        ends = "periodic" if self.closed else "natural"
        spline = CubicSpline(np.append(0.0, np.cumsum(lengths)), points, bc_type=ends)
        object.__setattr__(self, "pieces", _cut(spline, self.closed))


def _area(points: FloatArray) -> float:
    """Return the area inside a polygon (k, 2), m^2, negative if clockwise; the ends coincide."""
    (x, y), (x_next, y_next) = points[:-1].T, points[1:].T
    return 0.5 * float(np.sum(x * y_next - x_next * y))


def _crossing(points: FloatArray) -> tuple[int, int] | None:
    """Return the first two sides of a polygon (k, 2) that cross; the end points coincide."""
    start, side = points[:-1], np.diff(points, axis=0)
    for k in range(len(start) - 2):
        # Adjacent sides share a point; the last side is adjacent to the first.
        others = np.arange(k + 2, len(start) - (k == 0))
        to, along = start[others] - start[k], side[others]
        turn = side[k, 0] * along[:, 1] - side[k, 1] * along[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):  # parallel sides do not cross
            here = (to[:, 0] * along[:, 1] - to[:, 1] * along[:, 0]) / turn
            there = (to[:, 0] * side[k, 1] - to[:, 1] * side[k, 0]) / turn
        found = (here >= 0.0) & (here <= 1.0) & (there >= 0.0) & (there <= 1.0)
        if found.any():
            return k, int(others[np.argmax(found)])
    return None


def _cut(spline: CubicSpline, closed: bool) -> FloatArray:
    """Return rows (pieces, 9): start (polygon length, m), then cubics of x, y in rising powers.

    The first and the last row continue the curve beyond its start and its end.
    """
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


Surface = Wall | RoundWall | SurfaceTable
