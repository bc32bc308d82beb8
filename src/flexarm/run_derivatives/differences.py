"""Derivatives of smooth functions by central differences of order 8, with an error estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from flexarm.errors import InputError, Problem, shown
from flexarm.kernels.layout import Array

#: Weights of central differences of orders 8 and 6 at steps 1, 2, 3, 4.
_ORDER_8 = 4 / 5, -1 / 5, 4 / 105, -1 / 280
_ORDER_6 = 3 / 4, -3 / 20, 1 / 60, 0.0
#: Step relative to the parameter. For power laws up to the exponent -4, the difference of order 8
#: then has a relative error below 2e-12, and rounding errors of the modes are below 1e-11.
_SHIFT = 0.008
#: Largest difference of the two orders relative to the derivatives of a column. It is 1e-9 for a
#: length; modes that change places cause differences near one.
_ACCURATE = 1e-6
#: Rounding errors of the difference: relative to the numbers of a column, and of numbers that would
#: be zero without them, in SI units.
_ROUNDED, _NOISE = 1e-9, 1e-12
#: Largest difference of the two orders of a function whose rounding errors are relative to its
#: value, and these rounding errors. It is 1e-12 for trigonometric functions at steps of 0.01, and
#: the error of order 8 is smaller. Number of steps, each a tenth of the one before.
_LOCAL, _EXACT, _ATTEMPTS = 1e-8, 2e-14, 6
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

    Raises:
        InputError: if the function is not smooth, or returns arrays of another shape.
    """
    step = _SHIFT * scale
    found: list[Array] = [np.zeros(1)]
    low: list[Array] = [np.zeros(1)]
    size: list[Array] = []
    for k, weights in enumerate(zip(_ORDER_8, _ORDER_6, strict=True), start=1):
        ahead, behind = at(value + k * step), at(value - k * step)
        size = size or [_largest(array) for array in ahead]
        if any(a.shape != b.shape for a, b in zip(ahead, behind, strict=True)):
            raise InputError(Problem(name, SMOOTH, shown(path)))
        rises = [(a - b) / step for a, b in zip(ahead, behind, strict=True)]
        found, low = (
            [weight * rise + (total[p] if k > 1 else 0.0) for p, rise in enumerate(rises)]
            for weight, total in zip(weights, (found, low), strict=True)
        )
    for exact, check, column in zip(found, low, size, strict=True):
        allowed = _ACCURATE * _largest(exact) + (_ROUNDED * column + _NOISE) / scale
        if np.any(np.abs(exact - check) > allowed):
            hint = "Modes may change places nearby, or a point may be at an end of an element."
            raise InputError(Problem(name, SMOOTH, shown(path), hint))
    return found


def local_slopes(function: Callable[[Array], Array], point: Array, steps: Array) -> Array:
    """Return the derivatives (k, m) of a function at ``point`` (k,) by each number.

    Near corners of the function the steps are reduced. The row of a number for which the two orders
    do not agree for any step is NaN.

    Args:
        function: function of points (p, k) that returns values (p, m).
        steps: (k,) first steps.
    """
    orders = np.array([_ORDER_8, _ORDER_6])
    shifts = np.concatenate([np.arange(1.0, 5.0), -np.arange(1.0, 5.0)])
    found: Array | None = None
    size = np.zeros(1)
    left = np.arange(point.size)
    for attempt in range(_ATTEMPTS):
        step = steps[left] * 0.1**attempt
        points = np.tile(point, (left.size, shifts.size, 1))
        points[np.arange(left.size), :, left] += step[:, None] * shifts
        values = function(points.reshape(-1, point.size)).reshape(left.size, shifts.size, -1)
        rises = (values[:, :4] - values[:, 4:]) / step[:, None, None]
        exact, low = np.einsum("oj,kjm->okm", orders, rises)
        if found is None:
            found = np.full((point.size, values.shape[2]), np.nan)
        size = np.maximum(size, np.abs(values).max(axis=(0, 1)))
        allowed = _LOCAL * np.abs(exact).max(axis=1, initial=0.0)[:, None]
        good = np.all(np.abs(exact - low) <= allowed + _EXACT * size / step[:, None], axis=1)
        found[left[good]] = exact[good]
        left = left[~good]
        if not left.size:
            break
    assert found is not None
    return found


def _largest(array: Array) -> Array:
    """Return the largest absolute value of each column, the last axis."""
    largest: Array = np.abs(array).max(axis=tuple(range(array.ndim - 1)), initial=0.0)
    return largest
