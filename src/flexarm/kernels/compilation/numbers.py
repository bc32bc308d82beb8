"""Elementary functions of the kernels, for every number type.

When compiled, they are those of the C library for ``float64`` and ``complex128``. Undecorated,
NumPy calls the method of the number (``x.sin()``), as symbolic scalars require.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.kernels.compilation.cache import merged


@merged
def sin(x: Any) -> Any:
    """Return the sine of a number of any type."""
    return np.sin(x)


@merged
def cos(x: Any) -> Any:
    """Return the cosine of a number of any type."""
    return np.cos(x)


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
def positive_part(x: Any, rounding: float) -> Any:
    """Return max(x, 0) with its corner rounded over ``rounding``; analytic for derivatives."""
    return 0.5 * (x + np.sqrt(x * x + rounding * rounding))
