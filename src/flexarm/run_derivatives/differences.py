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


def local_slope(
    function: Callable[[Array], Array], point: Array, place: int, step: float
) -> Array | None:
    """Return the derivative of a function of an array (k,) by the number at ``place``.

    Returns None if the differences of the two orders do not agree for any step. Near corners of
    the function the step is reduced.
    """
    for attempt in range(_ATTEMPTS):
        shift = step * 0.1**attempt
        found = low = size = np.zeros(1)
        for k, weights in enumerate(zip(_ORDER_8, _ORDER_6, strict=True), start=1):
            change = np.zeros(point.size)
            change[place] = k * shift
            ahead, behind = function(point + change), function(point - change)
            size = np.maximum(size, np.abs(ahead))
            found = found + weights[0] * (ahead - behind) / shift
            low = low + weights[1] * (ahead - behind) / shift
        allowed = _LOCAL * np.abs(found).max(initial=0.0) + _EXACT * size / shift
        if np.all(np.abs(found - low) <= allowed):
            return found
    return None


def _largest(array: Array) -> Array:
    """Return the largest absolute value of each column, the last axis."""
    largest: Array = np.abs(array).max(axis=tuple(range(array.ndim - 1)), initial=0.0)
    return largest
