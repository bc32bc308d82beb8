"""Paths p(s) of the tip in the plane: lines, rounded polygons, splines and circular arcs.

Between two neighbouring breaks a path is smooth; at a break p, dp/ds and d2p/ds2 are continuous.

A corner of a polygon with unit directions u and v before and after it is rounded from a distance d
before it to d after it. With l the length covered since the start of the corner and x = l / (2 d),

    dp/dl = u + (v - u) (3 x^2 - 2 x^3),

so the curvature is zero at both ends, the tip slows down in the corner, and it passes the corner at
a distance of 3/16 d |v - u|.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm.base.arguments import check_number, check_positive
from flexarm.base.errors import InputError, Problem, check_array, shown
from flexarm.base.late import interpolate
from flexarm.motion.motion import Floats

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


#: Corners start by default at this fraction of the shorter of their two sides; half is the most.
CORNER = 0.25
#: Sides and gaps below this fraction of the whole length are left out.
_NEGLIGIBLE = 1e-12


class PathPoint(NamedTuple):
    """Points p (m) and their derivatives dp/ds and d2p/ds2, (T, 2) each, world axes."""

    point: Floats
    slope: Floats
    curve: Floats


class TipPath(ABC):
    """A path p(s) of the tip, 0 <= s <= 1."""

    title: str  # name of the path in messages
    marks: dict[str, float]  # names of points in messages, with their s

    @property
    @abstractmethod
    def breaks(self) -> tuple[float, ...]:
        """Increasing s between 0 and 1 (both excluded) at which a third derivative may jump."""

    @property
    @abstractmethod
    def fastest(self) -> float:
        """Upper bound of |dp/ds|, m."""

    @abstractmethod
    def at(self, s: Floats) -> PathPoint:
        """Return points and derivatives at `s` (T,)."""

    @abstractmethod
    def extremes(self, center: Floats) -> Floats:
        """Return s (k,) that include all extremes of the distance from a point (2,)."""


@dataclass(frozen=True, eq=False)
class PolynomialPath(TipPath):
    """A path of polynomials: a line, a rounded polygon or a spline."""

    title: str
    marks: dict[str, float]
    #: Polynomials of s with values (2,), twice continuously differentiable
    pieces: interpolate.PPoly

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(self.pieces.x[1:-1].tolist())

    @property
    def fastest(self) -> float:
        """See `TipPath.fastest`; the sum of the terms' magnitudes in each piece."""
        width, c = np.diff(self.pieces.x), self.pieces.c
        powers = np.arange(len(c) - 1, 0, -1)
        terms = (
            powers[:, None]
            * np.hypot(*c[:-1].transpose(2, 0, 1))
            * width ** (powers - 1.0)[:, None]
        )
        return float(terms.sum(axis=0).max())

    def at(self, s: Floats) -> PathPoint:
        return PathPoint(*(self.pieces(s, order) for order in range(3)))

    def extremes(self, center: Floats) -> Floats:
        """See `TipPath.extremes`: the roots of (p - center) . dp/ds, and the ends of the pieces."""
        found = [self.pieces.x]
        for k, start in enumerate(self.pieces.x[:-1]):
            product = np.zeros(1)
            for values, middle in zip(self.pieces.c[:, k].T, center, strict=True):
                value = np.poly1d(values) - middle
                product = np.polyadd(product, (value * value.deriv()).coeffs)
            # Real parts of complex roots are further points of the path and do no harm.
            roots = start + np.real(np.roots(product))
            found.append(np.clip(roots, start, self.pieces.x[k + 1]))
        return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class ArcPath(TipPath):
    """A circular arc: center + radius (cos, sin)(first + s angle)."""

    title: str
    marks: dict[str, float]
    center: Floats
    radius: float
    first: float
    angle: float

    @property
    def breaks(self) -> tuple[float, ...]:
        """None."""
        return ()

    @property
    def fastest(self) -> float:
        return self.radius * abs(self.angle)

    def at(self, s: Floats) -> PathPoint:
        turned = self.first + s * self.angle
        out = self.radius * np.stack([np.cos(turned), np.sin(turned)], axis=-1)
        along = np.stack([-out[:, 1], out[:, 0]], axis=-1)
        return PathPoint(self.center + out, self.angle * along, -(self.angle**2) * out)

    def extremes(self, center: Floats) -> Floats:
        """See `TipPath.extremes`: the ends, and the points in line with both centres."""
        away = self.center - center
        direction = float(np.arctan2(away[1], away[0]))
        turned = np.mod(direction + np.array([0.0, np.pi]) - self.first, 2.0 * np.pi)
        if self.angle < 0.0:
            turned = turned - 2.0 * np.pi
        return np.concatenate([[0.0, 1.0], np.clip(turned / self.angle, 0.0, 1.0)])


def line_path(start: ArrayLike, end: ArrayLike) -> PolynomialPath:
    """Return the straight line between two world points (2,), m."""
    start, end = check_array("start", start, (2,)), check_array("end", end, (2,))
    line = _polynomials([0.0, 1.0], [[start, end - start]])
    return PolynomialPath("line from start to end", {"start": 0.0, "end": 1.0}, line)


def polygon_path(points: ArrayLike, blend: float | None) -> PolynomialPath:
    """Return straight lines between world points (k, 2) m, rounded from ``blend`` m at corners."""
    corners = _different(points)
    sides = np.diff(corners, axis=0)
    lengths = np.hypot(*sides.T)
    units = sides / lengths[:, None]
    room = np.minimum(lengths[:-1], lengths[1:])
    reach = CORNER * room
    if blend is not None:
        reach = np.full_like(room, check_positive("blend", blend, "m"))
        tight = int(np.argmin(room)) if room.size else 0
        if room.size and reach[tight] > 0.5 * room[tight]:
            rule = f"be at most {0.5 * room[tight]:.6g} m (half of the shorter line at a corner)"
            hint = f"That corner is points[{tight + 1}]."
            raise InputError(Problem("blend", rule, shown(blend), hint))
    total = float(lengths.sum())
    edges, rows = [0.0], []
    for k, unit in enumerate(units):
        before = reach[k - 1] if k > 0 else 0.0
        after = reach[k] if k < len(reach) else 0.0
        straight = lengths[k] - before - after
        if straight > _NEGLIGIBLE * total:
            rows.append([corners[k] + before * unit, total * unit])
            edges.append(edges[-1] + straight / total)
        if k < len(reach):
            turn, width = units[k + 1] - unit, 2.0 * after
            bend = [total**3 / width**2 * turn, -0.5 * total**4 / width**3 * turn]
            rows.append([corners[k + 1] - after * unit, total * unit, 0.0 * unit, *bend])
            edges.append(edges[-1] + width / total)
    edges[-1] = 1.0
    marks = {"points[0]": 0.0, f"points[{len(corners) - 1}]": 1.0}
    return PolynomialPath("path along the points", marks, _polynomials(edges, rows))


def spline_path(points: ArrayLike) -> PolynomialPath:
    """Return the spline through world points (k, 2) m; closed if the last equals the first."""
    knots = _different(points)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(knots, axis=0).T))])
    s = along / along[-1]
    closed = bool(np.all(knots[0] == knots[-1]))
    pieces = interpolate.CubicSpline(s, knots, bc_type="periodic" if closed else "not-a-knot")
    marks = {f"points[{k}]": float(part) for k, part in enumerate(s)}
    return PolynomialPath("path through the points", marks, pieces)


def arc_path(center: ArrayLike, start: ArrayLike, angle: float) -> ArcPath:
    """Return the circular arc from a world point (2,), m, about a centre, by an angle (rad)."""
    center = check_array("center", center, (2,))
    start = check_array("start", start, (2,))
    angle = check_number("angle", angle, lambda turn: turn != 0.0, "differ from 0")
    out = start - center
    radius = float(np.hypot(*out))
    if radius == 0.0:
        raise InputError(Problem("start", "differ from the center", shown(start.tolist())))
    first = float(np.arctan2(out[1], out[0]))
    return ArcPath("arc", {"start": 0.0}, center, radius, first, angle)


def _different(points: ArrayLike) -> Floats:
    """Return two or more points (k, 2) of which neighbours differ."""
    array = check_array("points", points, (-1, 2))
    if len(array) < 2:
        raise InputError(Problem("points", "have at least two points", str(len(array))))
    gaps = np.hypot(*np.diff(array, axis=0).T)
    near = np.flatnonzero(gaps <= _NEGLIGIBLE * gaps.sum())
    if near.size:
        name, rule = f"points[{near[0] + 1}]", "differ from the previous point"
        raise InputError(Problem(name, rule, shown(array[near[0] + 1].tolist())))
    return array


def _polynomials(edges: list[float], rows: list[list[Floats]]) -> interpolate.PPoly:
    """Return polynomials from coefficients of rising powers of s since the start of a piece."""
    most = max(len(row) for row in rows)
    table = np.zeros((most, len(rows), 2))
    for k, row in enumerate(rows):
        table[most - len(row) :, k] = row[::-1]
    return interpolate.PPoly(table, np.array(edges))
