"""Cubic Hermite shape functions of one beam element."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numpy.polynomial import polynomial

FloatArray = npt.NDArray[np.float64]

# Rows: powers 0 to 3 of xi; columns: the shape functions for an element of unit length.
_SHAPES = np.array(
    [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [-3.0, -2.0, 3.0, -1.0],
        [2.0, 1.0, -2.0, 1.0],
    ]
)
_DERIVATIVES = tuple(polynomial.polyder(_SHAPES, order) for order in range(4))


def shape_functions(xi: FloatArray, length: float, derivative: int = 0) -> FloatArray:
    """Evaluate the four shape functions, or one of their derivatives along the beam.

    The deflection inside the element is `shape_functions(xi, length) @ [v_1, phi_1, v_2, phi_2]`
    with the deflections v (m) and slopes phi (rad) of its two ends.

    Args:
        xi: (k,) positions in the element, 0 at its inboard and 1 at its outboard end.
        length: length of the element (m).
        derivative: 0 deflection, 1 slope, 2 curvature, 3 derivative of curvature: d/dx, not d/dxi.

    Returns:
        (k, 4): columns belong to v_1, phi_1, v_2, phi_2. A slope column has one more factor of
        metre than a deflection column; each derivative has one less.
    """
    powers = xi[:, None] ** np.arange(4 - derivative)
    unit = np.array([1.0, length, 1.0, length]) / length**derivative
    values: FloatArray = np.asarray(powers @ _DERIVATIVES[derivative] * unit, np.float64)
    return values
