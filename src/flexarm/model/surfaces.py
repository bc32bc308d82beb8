"""Surfaces of contacts and curves of closures: walls, circles, and smooth curves through points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from flexarm.base.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Direction, Flag, Listed, Number, Pair, Positive, length_of
from flexarm.model.wording import Fault


class Wall(Record, kw_only=False):
    """A straight surface; the half-plane behind it, opposite to the normal, is solid."""

    kind: Literal["wall"] = Field(default="wall", kw_only=True)
    point: Pair
    """Any point on it [x, y], world frame (m)."""
    normal: Direction
    """Normal out of the solid [x, y], of any length."""


class RoundWall(Record, kw_only=False):
    """A circular surface with contact from outside (a post) or from inside (a round room)."""

    kind: Literal["round"] = Field(default="round", kw_only=True)
    center: Pair
    """Centre [x, y], world frame (m)."""
    radius: Positive
    """Radius (m)."""
    inside: Flag = False
    """Whether the arm is inside the circle."""


class SurfaceTable(Record, kw_only=False):
    """A smooth curve through points; the side to the right of its direction is solid.

    The curve is a cubic spline over the length of the polygon through the points. A profile with
    increasing x is therefore solid below. An open curve continues straight beyond its ends. The
    arm is inside a closed curve that runs counter-clockwise, and outside a clockwise one.
    """

    kind: Literal["table"] = Field(default="table", kw_only=True)
    x: Listed[Number]
    """x of at least three points (m)."""
    y: Listed[Number]
    """y of each point (m); consecutive points differ."""
    closed: Flag = False
    """Whether the last point is connected to the first."""

    _columns: ClassVar[tuple[str, ...]] = ("x", "y")

    @property
    def points(self) -> list[tuple[float, float]]:
        """The points; those of a closed curve begin and end with the same one."""
        if self.closed:
            return closed_polygon(self.x, self.y)
        return list(zip(self.x, self.y, strict=True))

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        x, y = length_of(given.raw("x")), length_of(given.raw("y"))
        if x is not None and x < 3:
            yield Fault(("x",), "have at least three points", str(x))
        elif x is not None and y is not None and x != y:
            yield Fault(("y",), f"have length {x}, one value for each point", str(y))
        elif given.has("x", "y"):
            yield from polygon_faults(given.x, given.y, given.has("closed") and given.closed)


Surface = Annotated[Wall | RoundWall | SurfaceTable, Field(discriminator="kind")]


Point = tuple[float, float]

#: Points closer than this fraction of the extent are equal, because of rounding errors.
_SAME_PLACE = 1e-9


def closed_polygon(x: Sequence[float], y: Sequence[float]) -> list[Point]:
    """Return the points of a closed polygon, the first also as the last, whether given or not."""
    points = list(zip(x, y, strict=True))
    if math.dist(points[0], points[-1]) <= _nearness(x, y):
        points.pop()
    return [*points, points[0]]


def polygon_faults(x: Sequence[float], y: Sequence[float], closed: bool) -> Iterator[Fault]:
    """Yield the first fault of the points (at least three) of a surface: of `x` or its items."""
    points = closed_polygon(x, y) if closed else list(zip(x, y, strict=True))
    near = _nearness(x, y)
    if len(points) < 3 + closed:
        yield Fault(("x",), "have at least three points", str(len(points) - closed))
        return
    for k in range(1, len(points)):
        if math.dist(points[k - 1], points[k]) <= near:
            yield Fault(("x", k), "differ from the previous point in x or y", shown(points[k][0]))
            return
    if not closed:
        return
    length = sum(math.dist(a, b) for a, b in pairwise(points))
    twice = sum(x * y_next - x_next * y for (x, y), (x_next, y_next) in pairwise(points))
    if abs(0.5 * twice) <= near * length:
        yield Fault(("x",), "enclose an area together with y", shown(list(x)))
        return
    crossing = min(_crossings(points), default=None)
    if crossing is not None:
        rule = (
            "and y are a polygon that crosses itself after the points "
            f"[{crossing[0]}] and [{crossing[1]}]"
        )
        yield Fault(("x",), rule)


def _nearness(x: Sequence[float], y: Sequence[float]) -> float:
    return _SAME_PLACE * max(max(x) - min(x), max(y) - min(y))


def _crossings(points: Sequence[Point]) -> Iterator[tuple[int, int]]:
    """Yield the pairs of sides of a closed polygon that cross, with the smaller number first."""
    # Sides are sorted along the longer axis, so that a side is compared with its neighbours only.
    width, height = (max(values) - min(values) for values in zip(*points, strict=True))
    axis = 0 if width >= height else 1
    last = len(points) - 2
    spans = [sorted((points[k][axis], points[k + 1][axis])) for k in range(last + 1)]
    order = sorted(range(last + 1), key=spans.__getitem__)
    for place, k in enumerate(order):
        for other in order[place + 1 :]:
            if spans[other][0] > spans[k][1]:
                break
            # Adjacent sides share a point; the last side is adjacent to the first.
            if abs(k - other) in (1, last) or not _cross(points, k, other):
                continue
            yield min(k, other), max(k, other)


def _cross(points: Sequence[Point], k: int, other: int) -> bool:
    """Return whether two sides of a polygon have a point in common; parallel ones do not."""
    (x, y), (x_next, y_next) = points[k], points[k + 1]
    (x_other, y_other), (x_end, y_end) = points[other], points[other + 1]
    side, along = (x_next - x, y_next - y), (x_end - x_other, y_end - y_other)
    to = (x_other - x, y_other - y)
    turn = side[0] * along[1] - side[1] * along[0]
    if turn == 0.0:
        return False
    here = (to[0] * along[1] - to[1] * along[0]) / turn
    there = (to[0] * side[1] - to[1] * side[0]) / turn
    return 0.0 <= here <= 1.0 and 0.0 <= there <= 1.0
