"""Matrices and vectors of one link over its nodal coordinates, root clamped.

Nodal coordinates are `[v_2, phi_2, ..., v_{N+1}, phi_{N+1}]`, deflection (m) and slope (rad) at
the free nodes of N elements; the root's own pair is zero and left out. N(x) are their shape
functions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flexarm.beams.hermite import FloatArray, shape_functions
from flexarm.beams.properties import BeamTable
from flexarm.beams.quadrature import BeamQuadrature


@dataclass(frozen=True, eq=False)
class BeamMatrices:
    """Nodal matrices of one link; n = 2 * elements.

    Attributes:
        translational_mass: (n, n) integral of mu N N^T.
        rotary_mass: (n, n) integral of rho I N' N'^T.
        stiffness: (n, n) integral of EI N'' N''^T.
        deflection_moment: (n,) integral of mu N: momentum of the deflection.
        rotation_moment: (n,) integral of mu x N + rho I N': its angular momentum about the root.
    """

    translational_mass: FloatArray
    rotary_mass: FloatArray
    stiffness: FloatArray
    deflection_moment: FloatArray
    rotation_moment: FloatArray

    @property
    def mass(self) -> FloatArray:
        """(n, n) translational and rotary inertia together."""
        return self.translational_mass + self.rotary_mass


def beam_matrices(table: BeamTable, quadrature: BeamQuadrature) -> BeamMatrices:
    """Assemble the matrices of a link; exact for tables that are linear between stations."""
    x = quadrature.points
    stiffness = np.interp(x, table.x, table.flexural_rigidity)
    mass = np.interp(x, table.x, table.mass_per_length)
    rotary = np.interp(x, table.x, table.rotary_inertia_per_length)
    return BeamMatrices(
        translational_mass=product_integral(quadrature, mass, 0),
        rotary_mass=product_integral(quadrature, rotary, 1),
        stiffness=product_integral(quadrature, stiffness, 2),
        deflection_moment=integral(quadrature, mass, 0),
        rotation_moment=integral(quadrature, mass * x, 0) + integral(quadrature, rotary, 1),
    )


def integral(quadrature: BeamQuadrature, density: FloatArray, derivative: int) -> FloatArray:
    """Integrate density(x) d^k N/dx^k along the link.

    Args:
        quadrature: the points, q of them.
        density: (q,) weight function at the points.
        derivative: k, as in `shape_functions`.

    Returns:
        (n,) one entry per nodal coordinate.
    """
    local = shape_functions(quadrature.xi, quadrature.element_length, derivative)
    total = np.zeros(2 * quadrature.elements + 2)
    np.add.at(total, _rows(quadrature.element), local * (quadrature.weights * density)[:, None])
    return total[2:]


def product_integral(
    quadrature: BeamQuadrature, density: FloatArray, derivative: int, *, with_root: bool = False
) -> FloatArray:
    """Integrate density(x) (d^k N/dx^k) (d^k N/dx^k)^T along the link.

    Args:
        quadrature: the points, q of them.
        density: (q,) weight function at the points.
        derivative: k, as in `shape_functions`.
        with_root: count the root's pair too, first.

    Returns:
        (n, n) symmetric matrix over the nodal coordinates, or (n + 2, n + 2) with the root's.
    """
    local = shape_functions(quadrature.xi, quadrature.element_length, derivative)
    products = local[:, :, None] * local[:, None, :]
    products *= (quadrature.weights * density)[:, None, None]
    rows = _rows(quadrature.element)
    total = np.zeros((2 * quadrature.elements + 2,) * 2)
    np.add.at(total, (rows[:, :, None], rows[:, None, :]), products)
    return total if with_root else total[2:, 2:]


def nodal_shapes(
    stations: FloatArray, length: float, elements: int, derivative: int = 0
) -> FloatArray:
    """Evaluate the shape functions of all nodal coordinates at stations along the link.

    Args:
        stations: (k,) distances from the root (m), 0 to `length`.
        length: of the link (m).
        elements: number of elements.
        derivative: as in `shape_functions`. From the second on the shapes jump at element ends:
            the value is the outboard element's, at the tip the last element's.

    Returns:
        (k, n) rows that multiply nodal coordinates.
    """
    element_length = length / elements
    scaled = stations / element_length
    element = np.minimum(scaled.astype(np.intp), elements - 1)
    local = shape_functions(scaled - element, element_length, derivative)
    shapes = np.zeros((stations.size, 2 * elements + 2))
    np.put_along_axis(shapes, _rows(element), local, axis=1)
    return shapes[:, 2:]


def _rows(element: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """(k, 4) positions of an element's coordinates, the root's pair counted."""
    return 2 * element[:, None] + np.arange(4)
