"""Cubic Hermite shape functions of one beam element, and Gauss quadrature along a link."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
    """Evaluate the four shape functions, or one of their derivatives by x, at xi (k,): (k, 4).

    The deflection inside the element is `shape_functions(xi, length) @ [v_1, phi_1, v_2, phi_2]`
    with the deflections v (m) and slopes phi (rad) of its two ends, at xi = 0 and 1.
    """
    powers = xi[:, None] ** np.arange(4 - derivative)
    unit = np.array([1.0, length, 1.0, length]) / length**derivative
    return np.asarray(powers @ _DERIVATIVES[derivative] * unit, np.float64)


# The integrands have at most degree 7: cubic times cubic shape functions times a linear mass per
# length, and quadratic times quadratic slopes times a cubic outboard moment. Four points suffice.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False)
class BeamQuadrature:
    """Points and weights along one link divided into elements of equal length."""

    elements: int  # number of elements
    element_length: float  # length of each element (m)
    points: FloatArray  # (k,) distances from the root (m), increasing
    weights: FloatArray  # (k,) quadrature weights (m)
    element: npt.NDArray[np.intp]  # (k,) index of the element of each point
    xi: FloatArray  # (k,) position in that element, 0 to 1

    @cached_property
    def nodal_rows(self) -> npt.NDArray[np.intp]:
        """Indices (k, 4) of the nodal coordinates of each point's element, from the root's on."""
        return 2 * self.element[:, None] + np.arange(4)

    @cached_property
    def all_rows(self) -> npt.NDArray[np.intp]:
        """Indices (k, 7) of the nodal coordinates, then of three interior values per element."""
        interior = 2 * self.elements + 2 + 3 * self.element[:, None] + np.arange(3)
        return np.hstack([self.nodal_rows, interior])


def beam_quadrature(breakpoints: FloatArray, elements: int) -> BeamQuadrature:
    """Return points and weights that integrate polynomials of degree 7 exactly on every piece.

    A piece lies between adjacent element ends or breakpoints (p,) m of the tables, so that shape
    functions and tables are polynomials inside it.
    """
    ends = np.linspace(0.0, breakpoints[-1], elements + 1)
    edges = np.union1d(ends, breakpoints)
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    points = (middle[:, None] + half[:, None] * _NODES).ravel()
    # A piece may be as short as rounding errors (a breakpoint at an element end), so its middle and
    # not its rounded points determine its element.
    owner = np.searchsorted(ends[1:-1], middle, side="right")
    element = np.repeat(owner, _NODES.size)
    element_length = float(breakpoints[-1]) / elements
    return BeamQuadrature(
        elements=elements,
        element_length=element_length,
        points=points,
        weights=(half[:, None] * _WEIGHTS).ravel(),
        element=element,
        xi=(points - ends[element]) / element_length,
    )
