"""Matrices and vectors of one link over its nodal coordinates, root clamped.

Nodal coordinates are `[v_2, phi_2, ..., v_{N+1}, phi_{N+1}]`, deflection (m) and rotation of the
section (rad) at the free nodes of N elements; the root's own pair is zero and left out. N(x) are
the shapes of the deflection, N_phi(x) those of the rotation: N' for an Euler-Bernoulli beam.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flexarm.beams.hermite import FloatArray
from flexarm.beams.properties import BeamTable
from flexarm.beams.quadrature import BeamQuadrature
from flexarm.beams.shear import deflection_shapes, point_shapes, rotation_shapes, shear_angles


@dataclass(frozen=True, eq=False)
class BeamMatrices:
    """Nodal matrices of one link; n = 2 * elements.

    Attributes:
        translational_mass: (n, n) integral of mu N N^T.
        rotary_mass: (n, n) integral of rho I N_phi N_phi^T.
        stiffness: (n, n) integral of EI N_phi' N_phi'^T, and with shear of
            k G A (N' - N_phi) (N' - N_phi)^T.
        deflection_moment: (n,) integral of mu N: momentum of the deflection.
        rotation_moment: (n,) integral of mu x N + rho I N_phi: its angular momentum about the
            root.
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
    x, shapes = quadrature.points, point_shapes(table, quadrature)
    bending = np.interp(x, table.x, table.flexural_rigidity)
    mass = np.interp(x, table.x, table.mass_per_length)
    rotary = np.interp(x, table.x, table.rotary_inertia_per_length)
    stiffness = product_integral(quadrature, bending, shapes.curvature)
    if table.shear_rigidity is not None:
        shear = np.interp(x, table.x, table.shear_rigidity)
        stiffness = stiffness + product_integral(quadrature, shear, shapes.shear)
    return BeamMatrices(
        translational_mass=product_integral(quadrature, mass, shapes.deflection),
        rotary_mass=product_integral(quadrature, rotary, shapes.rotation),
        stiffness=stiffness,
        deflection_moment=integral(quadrature, mass, shapes.deflection),
        rotation_moment=integral(quadrature, mass * x, shapes.deflection)
        + integral(quadrature, rotary, shapes.rotation),
    )


def integral(quadrature: BeamQuadrature, density: FloatArray, local: FloatArray) -> FloatArray:
    """Integrate density(x) N(x) along the link.

    Args:
        quadrature: the points, q of them.
        density: (q,) weight function at the points.
        local: (q, 4) shapes of each point's element there, a field of `PointShapes`.

    Returns:
        (n,) one entry per nodal coordinate.
    """
    total = np.zeros(2 * quadrature.elements + 2)
    np.add.at(total, _rows(quadrature.element), local * (quadrature.weights * density)[:, None])
    return total[2:]


def product_integral(
    quadrature: BeamQuadrature, density: FloatArray, local: FloatArray, *, with_root: bool = False
) -> FloatArray:
    """Integrate density(x) N(x) N(x)^T along the link.

    Args:
        quadrature: the points, q of them.
        density: (q,) weight function at the points.
        local: (q, 4) shapes of each point's element there, a field of `PointShapes`.
        with_root: count the root's pair too, first.

    Returns:
        (n, n) symmetric matrix over the nodal coordinates, or (n + 2, n + 2) with the root's.
    """
    products = local[:, :, None] * local[:, None, :]
    products *= (quadrature.weights * density)[:, None, None]
    rows = _rows(quadrature.element)
    total = np.zeros((2 * quadrature.elements + 2,) * 2)
    np.add.at(total, (rows[:, :, None], rows[:, None, :]), products)
    return total if with_root else total[2:, 2:]


def nodal_shapes(
    stations: FloatArray,
    length: float,
    elements: int,
    derivative: int = 0,
    parameters: FloatArray | None = None,
) -> FloatArray:
    """Evaluate the deflection's shapes of all nodal coordinates at stations along the link.

    Args:
        stations: (k,) distances from the root (m), 0 to `length`.
        length: of the link (m).
        elements: number of elements.
        derivative: 0 deflection v, 1 slope v', 2 curvature phi'. The curvature jumps at element
            ends, with shear the slope too: the value is the outboard element's, at the tip the
            last element's.
        parameters: (elements,) Phi_s of `shear_parameters`; None where there is no shear.

    Returns:
        (k, n) rows that multiply nodal coordinates.
    """
    element, xi, angles = _places(stations, length, elements, parameters)
    return _spread(element, elements, deflection_shapes(xi, length / elements, angles, derivative))


def nodal_rotations(
    stations: FloatArray, length: float, elements: int, parameters: FloatArray
) -> FloatArray:
    """Evaluate the shapes (k, n) of the section's rotation phi; arguments as `nodal_shapes`."""
    element, xi, angles = _places(stations, length, elements, parameters)
    return _spread(element, elements, rotation_shapes(xi, length / elements, angles))


def _places(
    stations: FloatArray, length: float, elements: int, parameters: FloatArray | None
) -> tuple[npt.NDArray[np.intp], FloatArray, FloatArray]:
    """Element (k,), position in it (k,) and rows of its shear angle (k, 4) of each station."""
    scaled = stations / (length / elements)
    element = np.minimum(scaled.astype(np.intp), elements - 1)
    shear = np.zeros(elements) if parameters is None else parameters
    return element, scaled - element, shear_angles(shear, length / elements)[element]


def _spread(element: npt.NDArray[np.intp], elements: int, local: FloatArray) -> FloatArray:
    """(k, n) rows over all nodal coordinates of the local ones (k, 4)."""
    shapes = np.zeros((element.size, 2 * elements + 2))
    np.put_along_axis(shapes, _rows(element), local, axis=1)
    return shapes[:, 2:]


def _rows(element: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """(k, 4) positions of an element's coordinates, the root's pair counted."""
    return 2 * element[:, None] + np.arange(4)
