"""Derivatives of smooth functions by central differences of order 8, with an error estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from flexarm.base.errors import InputError, Problem, shown
from flexarm.kernels.layout import Array

#: Weights of central differences of orders 8 and 6 at steps 1, 2, 3, 4.
ORDER_8 = 4 / 5, -1 / 5, 4 / 105, -1 / 280
ORDER_6 = 3 / 4, -3 / 20, 1 / 60, 0.0
#: Weights of second central differences of these orders.
_SECOND_8, _SECOND_6 = (8 / 5, -1 / 5, 8 / 315, -1 / 560), (3 / 2, -3 / 20, 1 / 90, 0.0)
#: Step relative to the parameter. For power laws up to the exponent -4, the difference of order 8
#: then has a relative error below 2e-12, and rounding errors of the modes are below 1e-11.
_SHIFT = 0.008
#: Largest difference of the two orders relative to the derivatives of a column. It is 1e-9 for a
#: length; modes that change places cause differences near one.
_ACCURATE = 1e-6
#: Rounding errors of the difference, relative to the numbers of a column.
_ROUNDED = 1e-9
#: Changes of the parameter, relative to its scale, at which numbers change by rounding alone, and
#: the rounding errors of the difference relative to these changes: those of a few points are small
#: by luck. Numbers that would be zero without rounding are nothing else.
_NEAR, _NOISE = (-2e-12, -1e-12, 1e-12, 2e-12), 100.0
#: Largest difference of the two orders of a function whose rounding errors are relative to its
#: value, and these rounding errors. It is 1e-12 for trigonometric functions at steps of 0.01, and
#: the error of order 8 is smaller. Number of steps, each a tenth of the one before.
_LOCAL, _EXACT, _ATTEMPTS = 1e-8, 2e-14, 6
#: Rounding errors of second differences, of solvers for example, relative to the value.
_UNEVEN = 1e-12
#: Halvings that locate a jump, and the smallest one, relative to the change of the value.
_HALVINGS, _JUMP = 40, 0.01
#: Rule of a parameter, in messages.
SMOOTH = "be a number on which the equations depend smoothly"


def differences(
    name: str, path: str, value: float, scale: float, at: Callable[[float], Sequence[Array]]
) -> list[Array]:
    """Return the derivatives of the arrays of a function at ``value``.

    Args:
        name, path: of the parameter, for messages.
        scale: change of the parameter over which the function is smooth.
        at: function that returns arrays, whose last axis has one unit in each column.
    """
    step = _SHIFT * scale
    found: list[Array] = [np.zeros(1)]
    low: list[Array] = [np.zeros(1)]
    size: list[Array] = []
    for k, weights in enumerate(zip(ORDER_8, ORDER_6, strict=True), start=1):
        ahead, behind = at(value + k * step), at(value - k * step)
        size = size or [_largest(array) for array in ahead]
        if any(a.shape != b.shape for a, b in zip(ahead, behind, strict=True)):
            raise InputError(Problem(name, SMOOTH, shown(path)))
        rises = [(a - b) / step for a, b in zip(ahead, behind, strict=True)]
        found, low = (
            [weight * rise + (total[p] if k > 1 else 0.0) for p, rise in enumerate(rises)]
            for weight, total in zip(weights, (found, low), strict=True)
        )
    noise = [np.zeros_like(column) for column in size]
    if not _agree(found, low, size, noise, scale):
        near = [at(value + change * scale) for change in _NEAR]
        noise = [_largest(np.ptp(arrays, axis=0)) for arrays in zip(*near, strict=True)]
        if not _agree(found, low, size, noise, scale):
            hint = "Modes may change places nearby, or a point may be at an end of an element."
            raise InputError(Problem(name, SMOOTH, shown(path), hint))
    return found


def _agree(
    exact: list[Array], low: list[Array], size: list[Array], noise: list[Array], scale: float
) -> bool:
    """Return whether differences of two orders agree; ``size`` and ``noise`` of each column."""
    for high, check, column, rounded in zip(exact, low, size, noise, strict=True):
        allowed = _ACCURATE * _largest(high) + (_ROUNDED * column + _NOISE * rounded) / scale
        if np.any(np.abs(high - check) > allowed):
            return False
    return True


def local_slopes(function: Callable[[Array], Array], point: Array, steps: Array) -> Array:
    """Return the derivatives (k, m) of a function at ``point`` (k,) by each number.

    Near corners of the function the steps are reduced. The row of a number is NaN if the two orders
    do not agree for any step, or if the function rounds the number. The derivatives of values that
    have a corner at the point itself, where those of the second order do not agree, are infinite.
    """
    orders, seconds = np.array([ORDER_8, ORDER_6]), np.array([_SECOND_8, _SECOND_6])
    # The point itself is not the first one, at which iterative solvers start.
    shifts = np.concatenate([np.arange(1.0, 5.0), -np.arange(1.0, 5.0), [0.0]])
    found, changed, size = np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(1)
    left = np.arange(point.size)
    for attempt in range(_ATTEMPTS):
        step = (steps[left] * 0.1**attempt)[:, None]
        points = np.tile(point, (left.size, shifts.size, 1))
        points[np.arange(left.size), :, left] += step * shifts
        values = function(points.reshape(-1, point.size)).reshape(left.size, shifts.size, -1)
        ahead, behind, now = values[:, :4], values[:, 4:8], values[:, 8]
        if not attempt:
            found, changed = np.full(now.shape, np.nan), np.zeros(now.shape)
        exact, low = np.einsum("oj,kjm->okm", orders, ahead - behind)
        bend, coarse = np.einsum("oj,kjm->okm", seconds, ahead + behind - 2.0 * now[:, None])
        size = np.maximum(size, np.abs(values).max(axis=(0, 1)))
        allowed = _LOCAL * np.abs(exact).max(axis=1, initial=0.0)[:, None] + _EXACT * size
        smooth = ~np.any(np.abs(exact - low) > allowed, axis=1)
        corner = np.abs(bend - coarse) > allowed + _UNEVEN * size
        good = smooth & ~np.any(corner, axis=1)
        if attempt == _ATTEMPTS - 1:
            exact, good = np.where(corner, np.inf, exact), smooth
        constant = np.all(np.abs(values - now[:, None]) <= _EXACT * size, axis=1)
        doubtful = constant & (changed[left] > 0.0) & good[:, None]
        rounded = np.zeros_like(good)
        for i, j in np.argwhere(doubtful):
            ends = 4.0 * step[i, 0], changed[left[i], j]
            rounded[i] |= _has_jumps(function, point, int(left[i]), int(j), ends)
        found[left[good & ~rounded]] = (exact / step)[good & ~rounded]
        rise, fall = ahead[:, -1] - now, now - behind[:, -1]
        both = (rise * fall > 0.0) & (np.minimum(np.abs(rise), np.abs(fall)) > _LOCAL * size)
        changed[left] = np.where(both, 4.0 * step, changed[left])
        left = left[~good]
        if not left.size:
            break
    return found


def _has_jumps(
    function: Callable[[Array], Array],
    point: Array,
    number: int,
    place: int,
    ends: tuple[float, float],
) -> bool:
    """Return whether a value that is constant near a point jumps on both sides of it."""
    near, far = (np.array([1.0, -1.0]) * end for end in ends)
    here = function(point[None])[0, place]

    def values(changes: Array) -> Array:
        points = np.tile(point, (2, 1))
        points[:, number] += changes
        return np.asarray(function(points)[:, place])

    last = np.abs(values(far) - here)
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        other = np.abs(values(middle) - here) > _JUMP * last
        near, far = np.where(other, near, middle), np.where(other, middle, far)
    return bool(np.all(np.abs(values(far) - values(near)) > _JUMP * last))


def _largest(array: Array) -> Array:
    """Return the largest absolute value of each column, the last axis."""
    return np.asarray(np.abs(array).max(axis=tuple(range(array.ndim - 1)), initial=0.0))
