"""The only functions beyond ``+ - * /`` that the kernels need, for every number type.

Compiled, they are the C library's for ``float64`` and ``complex128``. Undecorated, NumPy asks the
number itself (``x.sin()``), which is how symbolic scalars take part.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.kernels.cache import merged


@merged
def sin(x: Any) -> Any:
    """Sine of a number of any type."""
    return np.sin(x)


@merged
def cos(x: Any) -> Any:
    """Cosine of a number of any type."""
    return np.cos(x)


@merged
def exp(x: Any) -> Any:
    """Exponential of a number of any type."""
    return np.exp(x)


@merged
def log(x: Any) -> Any:
    """Natural logarithm of a number of any type."""
    return np.log(x)


@merged
def sqrt(x: Any) -> Any:
    """Square root of a number of any type."""
    return np.sqrt(x)


@merged
def real(x: Any) -> Any:
    """Real part: what a choice may depend on that every derivative has to agree with."""
    return x.real


@merged
def tanh(x: Any) -> Any:
    """Hyperbolic tangent of a number of any type; the libraries' complex one overflows."""
    size = np.sqrt(x * x + 1e-300)
    fall = np.exp(-2.0 * size)
    return x / size * (1.0 - fall) / (1.0 + fall)


@merged
def positive_part(x: Any, rounding: float) -> Any:
    """max(x, 0) with its corner rounded over ``rounding``: analytic, so derivatives stay exact."""
    return 0.5 * (x + np.sqrt(x * x + rounding * rounding))
