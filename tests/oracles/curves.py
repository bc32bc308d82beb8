"""Signed distance of a point from a curve, for numbers that differentiate formulas.

The foot of the perpendicular, lengths and quotients solve equations by chord iterations with
constant slopes. Each round gives the solution one more order of derivatives exactly, so that
only ``+ - *``, ``sin`` and ``cos`` are used.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from flexarm.model import RoundWall, SurfaceTable, Wall

#: Orders of derivatives of the numbers of the oracles, and one round more.
ROUNDS = 5


def distance(curve: Any, x: Any, y: Any) -> Any:
    """Return the distance (m) of a point in the axes of a curve, negative inside its solid."""
    if isinstance(curve, Wall):
        normal = np.array(curve.normal) / np.hypot(*curve.normal)
        return normal[0] * (x - curve.point[0]) + normal[1] * (y - curve.point[1])
    if isinstance(curve, RoundWall):
        dx, dy = x - curve.center[0], y - curve.center[1]
        apart = length(dx * dx + dy * dy) - curve.radius
        return -apart if curve.inside else apart
    at = foot(curve, x, y)
    (cx, cy), (tx, ty), _ = course(curve, at)
    across = tx * (y - cy) - ty * (x - cx)
    return quotient(across, length(tx * tx + ty * ty))


def foot(curve: SurfaceTable, x: Any, y: Any) -> Any:
    """Return the parameter of the nearest point of a tabulated curve."""
    knots = spline(curve).x
    px, py = number(x), number(y)

    def apart(s: float) -> float:
        (cx, cy), _, _ = course(curve, s)
        return float((cx - px) ** 2 + (cy - py) ** 2)

    grid = np.linspace(1.5 * knots[0] - 0.5 * knots[-1], 1.5 * knots[-1] - 0.5 * knots[0], 4000)
    if curve.closed:
        grid = np.linspace(knots[0], knots[-1], 4000)
    best = grid[int(np.argmin([apart(s) for s in grid]))]
    width = 2.0 * (grid[1] - grid[0])
    start = minimize_scalar(
        apart, bounds=(best - width, best + width), method="bounded", options={"xatol": 1e-13}
    ).x
    for _ in range(3):
        start -= _condition(curve, start, px, py) / _slope(curve, start, px, py)
    slope = _slope(curve, start, px, py)
    at = x * 0.0 + start
    for _ in range(ROUNDS):
        at = at - _condition(curve, at, x, y) * (1.0 / slope)
    return at


def _condition(curve: SurfaceTable, s: Any, x: Any, y: Any) -> Any:
    (cx, cy), (tx, ty), _ = course(curve, s)
    return (cx - x) * tx + (cy - y) * ty


def _slope(curve: SurfaceTable, s: float, x: float, y: float) -> float:
    (cx, cy), (tx, ty), (bx, by) = course(curve, s)
    return float(tx * tx + ty * ty + (cx - x) * bx + (cy - y) * by)


def spline(curve: SurfaceTable) -> CubicSpline:
    """Return the cubic spline through the points over the length of their polygon."""
    points = np.array([curve.x, curve.y]).T
    if curve.closed:
        points = np.vstack([points, points[:1]])
    lengths = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    return CubicSpline(lengths, points, bc_type="periodic" if curve.closed else "natural")


def course(curve: SurfaceTable, s: Any) -> tuple[Any, Any, Any]:
    """Return position, and first and second derivative by the parameter, each x and y."""
    shape = spline(curve)
    place = number(s)
    if not curve.closed and not shape.x[0] <= place <= shape.x[-1]:  # straight beyond the ends
        end = shape.x[0] if place < shape.x[0] else shape.x[-1]
        polynomials = [np.stack([shape(end, 1)[k], shape(end)[k]]) for k in range(2)]
        u = s - end
    else:
        if curve.closed:
            s = s - (shape.x[-1] - shape.x[0]) * np.floor(
                (place - shape.x[0]) / (shape.x[-1] - shape.x[0])
            )
            place = number(s)
        piece = int(np.clip(np.searchsorted(shape.x, place, "right") - 1, 0, shape.c.shape[1] - 1))
        polynomials = [shape.c[:, piece, k] for k in range(2)]
        u = s - shape.x[piece]
    derivatives = [[np.polyder(p, k) if k else p for p in polynomials] for k in range(3)]
    first, second, third = ([_value(p, u) for p in pair] for pair in derivatives)
    return tuple(first), tuple(second), tuple(third)


def _value(polynomial: np.ndarray, u: Any) -> Any:
    value = u * 0.0
    for coefficient in polynomial:
        value = value * u + float(coefficient)
    return value


def number(x: Any) -> float:
    """Return the number of a rate, a jet or a plain number."""
    while hasattr(x, "value"):
        x = x.value
    return float(x)


def length(square: Any) -> Any:
    """Return the square root of a positive quantity."""
    root = float(np.sqrt(number(square)))
    value = square * 0.0 + root
    for _ in range(ROUNDS):
        value = value - (value * value - square) * (0.5 / root)
    return value


def quotient(above: Any, below: Any) -> Any:
    """Return a quotient."""
    share = 1.0 / number(below)
    value = above * share
    for _ in range(ROUNDS):
        value = value - (value * below - above) * share
    return value
