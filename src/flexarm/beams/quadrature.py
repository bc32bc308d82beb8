"""Where to evaluate a link: Gauss-Legendre points on pieces that hold no kink."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flexarm.beams.hermite import FloatArray

# The worst integrands have degree 7: cubic times cubic shape functions times a linear mass per
# length, and quadratic times quadratic slopes times a cubic outboard moment. Four points do.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False)
class BeamQuadrature:
    """Points and weights along one link divided into elements of equal length.

    Attributes:
        elements: number of elements.
        element_length: of each (m).
        points: (k,) distances from the root (m), increasing.
        weights: (k,) quadrature weights (m).
        element: (k,) index of the element a point lies in.
        xi: (k,) position in that element, 0 to 1.
    """

    elements: int
    element_length: float
    points: FloatArray
    weights: FloatArray
    element: npt.NDArray[np.intp]
    xi: FloatArray


def beam_quadrature(breakpoints: FloatArray, elements: int) -> BeamQuadrature:
    """Place points that integrate polynomials of degree 7 exactly on every piece.

    A piece lies between neighbours among the element ends and the breakpoints of the tables:
    inside it shape functions and tables are polynomials.

    Args:
        breakpoints: (p,) stations of the tables (m), from 0 to the length, increasing.
        elements: number of elements of equal length.
    """
    ends = np.linspace(0.0, breakpoints[-1], elements + 1)
    edges = np.union1d(ends, breakpoints)
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    points = (middle[:, None] + half[:, None] * _NODES).ravel()
    # A piece may be as short as rounding (a breakpoint on an element end): its middle, not the
    # rounded points, says which element it belongs to.
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
