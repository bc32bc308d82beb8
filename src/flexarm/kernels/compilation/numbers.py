"""Elementary functions of the kernels, for every number type.

When compiled, sine and cosine are polynomials, so that packs of runs and single runs have the same
numbers to the last bit; the others are those of the C library. Undecorated, NumPy calls the method
of the number (``x.sin()``), as symbolic scalars require.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.kernels.compilation.cache import before_compiling, merged

#: 2 pi in three parts: the first two have 33 bits, so that their products with the number of
#: turns are exact up to 2^20 turns.
_TURN_1, _TURN_2, _TURN_3 = 6.2831853069365025, 2.4308402025215864e-10, 8.089064995183803e-21
_TURNS = 0.15915494309189535  # 1 / (2 pi)
#: The sum with this number, 1.5 * 2^52, is rounded to an integer.
_ROUND = 6755399441055744.0


def _sine_and_versine(x: Any) -> Any:
    """Return sin x and 1 - cos x, with errors below 1e-15 for angles up to 1e6 rad.

    An eighth of the angle, reduced to half a turn, is at most pi / 8, where Taylor polynomials are
    exact to rounding. Three times, sin 2y = 2 sin y cos y and 1 - cos 2y = 2 sin^2 y double it.
    """
    turns = x.real * _TURNS + _ROUND - _ROUND
    y = 0.125 * (x - turns * _TURN_1 - turns * _TURN_2 - turns * _TURN_3)
    z = y * y
    s = z * (1.0 / 6227020800.0) - 1.0 / 39916800.0
    s = z * (z * (z * (z * s + 1.0 / 362880.0) - 1.0 / 5040.0) + 1.0 / 120.0) - 1.0 / 6.0
    s = y + y * z * s
    v = z * (1.0 / 87178291200.0) - 1.0 / 479001600.0
    v = z * (z * (z * (z * v + 1.0 / 3628800.0) - 1.0 / 40320.0) + 1.0 / 720.0) - 1.0 / 24.0
    v = z * (z * v + 0.5)
    for _ in range(3):
        twice = s + s
        s = twice - twice * v
        v = twice * (0.5 * twice)
    return s, v


def _sine(x: Any) -> Any:
    return np.sin(x)


def _cosine(x: Any) -> Any:
    return np.cos(x)


@before_compiling
def _declare_functions() -> None:
    """Give sine and cosine the polynomials, in compiled code."""
    from numba import extending

    from flexarm.kernels.compilation.dual_types import DUAL, chained

    turned = extending.register_jitable(_sine_and_versine)

    # Numba compares the signatures of these functions with those of the code: no annotations.
    @extending.overload(_sine)
    def sine(x):
        if x == DUAL:
            return lambda x: chained(turned(x.real)[0], 1.0 - turned(x.real)[1], x)
        return lambda x: turned(x)[0]

    @extending.overload(_cosine)
    def cosine(x):
        if x == DUAL:
            return lambda x: chained(1.0 - turned(x.real)[1], -turned(x.real)[0], x)
        return lambda x: 1.0 - turned(x)[1]


@merged
def sin(x: Any) -> Any:
    """Return the sine of a number of any type."""
    return _sine(x)


@merged
def cos(x: Any) -> Any:
    """Return the cosine of a number of any type."""
    return _cosine(x)


@merged
def exp(x: Any) -> Any:
    """Return the exponential of a number of any type."""
    return np.exp(x)


@merged
def log(x: Any) -> Any:
    """Return the natural logarithm of a number of any type."""
    return np.log(x)


@merged
def sqrt(x: Any) -> Any:
    """Return the square root of a number of any type."""
    return np.sqrt(x)


@merged
def real(x: Any) -> Any:
    """Return the real part, for branches that must not depend on a perturbation."""
    return x.real


@merged
def tanh(x: Any) -> Any:
    """Return the hyperbolic tangent; NumPy's overflows for complex numbers."""
    size = np.sqrt(x * x + 1e-300)
    fall = np.exp(-2.0 * size)
    return x / size * (1.0 - fall) / (1.0 + fall)


@merged
def positive_part(x: Any, rounding: Any) -> Any:
    """Return max(x, 0) with its corner rounded over ``rounding``; analytic for derivatives."""
    return 0.5 * (x + np.sqrt(x * x + rounding * rounding))
