"""Matrices and vectors of one link over its nodal coordinates, root clamped.

Nodal coordinates are `[v_2, phi_2, ..., v_{N+1}, phi_{N+1}]`, deflection (m) and rotation of the
section (rad) at the free nodes of N elements; the zero pair of the clamped root is omitted. N(x)
are the shapes of the deflection, N_phi(x) those of the rotation: N' for an Euler-Bernoulli beam.
With shear, three interior values of each element follow; ``beams.interior`` expresses them by the
nodal ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flexarm.arm.beams.hermite import BeamQuadrature, FloatArray
from flexarm.arm.beams.properties import BeamTable
from flexarm.arm.beams.shear import (
    PointShapes,
    deflection_shapes,
    interior_deflection,
    interior_rotation,
    point_shapes,
    rotation_shapes,
    shear_angles,
)


@dataclass(frozen=True, eq=False)
class BeamMatrices:
    """Matrices of one link over n = 2 * elements nodal values, plus 3 * elements interior ones.

    The interior values exist only with shear.
    """

    translational_mass: FloatArray  # (n, n) integral of mu N N^T
    rotary_mass: FloatArray  # (n, n) integral of rho I N_phi N_phi^T
    #: (n, n) integral of EI N_phi' N_phi'^T, and with shear of k G A (N' - N_phi) (N' - N_phi)^T
    stiffness: FloatArray
    deflection_moment: FloatArray  # (n,) integral of mu N: momentum of the deflection
    #: (n,) integral of mu x N + rho I N_phi: its angular momentum about the root
    rotation_moment: FloatArray
    #: (n + 2, n + 2) mass without the clamp; the coordinates of the root come first
    free_mass: FloatArray

    @property
    def mass(self) -> FloatArray:
        """(n, n) sum of translational and rotary inertia."""
        return self.translational_mass + self.rotary_mass

    def over(self, shapes: FloatArray) -> BeamMatrices:
        """Return the matrices, except ``free_mass``, over other coordinates: ``shapes`` (n, k)."""

        def reduced(matrix: FloatArray) -> FloatArray:
            product: FloatArray = shapes.T @ matrix @ shapes
            return (product + product.T) / 2.0

        return BeamMatrices(
            translational_mass=reduced(self.translational_mass),
            rotary_mass=reduced(self.rotary_mass),
            stiffness=reduced(self.stiffness),
            deflection_moment=shapes.T @ self.deflection_moment,
            rotation_moment=shapes.T @ self.rotation_moment,
            free_mass=self.free_mass,
        )


def beam_matrices(
    table: BeamTable, quadrature: BeamQuadrature, shapes: PointShapes | None = None
) -> BeamMatrices:
    """Assemble the matrices of a link; exact for tables that are linear between stations."""
    x, shapes = quadrature.points, shapes or point_shapes(table, quadrature)
    mass, rotary, rigidity = (
        np.interp(x, table.x, column)
        for column in (
            table.mass_per_length,
            table.rotary_inertia_per_length,
            table.flexural_rigidity,
        )
    )
    stiffness = product_integral(quadrature, rigidity, shapes.curvature)
    if table.shear_rigidity is not None:
        shear = np.interp(x, table.x, table.shear_rigidity)
        stiffness += product_integral(quadrature, shear, shapes.shear)
    translational = product_integral(quadrature, mass, shapes.deflection, with_root=True)
    turning = product_integral(quadrature, rotary, shapes.rotation, with_root=True)
    return BeamMatrices(
        translational_mass=translational[2:, 2:],
        rotary_mass=turning[2:, 2:],
        stiffness=stiffness,
        deflection_moment=integral(quadrature, mass, shapes.deflection),
        rotation_moment=integral(quadrature, mass * x, shapes.deflection)
        + integral(quadrature, rotary, shapes.rotation),
        free_mass=translational + turning,
    )


def integral(quadrature: BeamQuadrature, density: FloatArray, local: FloatArray) -> FloatArray:
    """Integrate density(x) N(x), (q,) and (q, 4 or 7) at the points, along the link: (n,)."""
    rows, size = _all_rows(quadrature, local)
    total = np.zeros(size)
    np.add.at(total, rows, local * (quadrature.weights * density)[:, None])
    return total[2:]


def product_integral(
    quadrature: BeamQuadrature, density: FloatArray, local: FloatArray, *, with_root: bool = False
) -> FloatArray:
    """Integrate density(x) N(x) N(x)^T as ``integral``: (n, n), or (n + 2, n + 2) ``with_root``."""
    rows, size = _all_rows(quadrature, local)
    total = np.zeros((size, size))
    if not density.any():  # most links have no rotary inertia
        return total if with_root else total[2:, 2:]
    products = local[:, :, None] * local[:, None, :]
    products *= (quadrature.weights * density)[:, None, None]
    np.add.at(total, (rows[:, :, None], rows[:, None, :]), products)
    return total if with_root else total[2:, 2:]


def nodal_shapes(
    stations: FloatArray,
    length: float,
    elements: int,
    derivative: int = 0,
    parameters: FloatArray | None = None,
) -> FloatArray:
    """Evaluate the deflection shapes of all nodal coordinates at stations along the link.

    Args:
        stations: (k,) distances from the root (m), 0 to `length`.
        length: length of the link (m).
        elements: number of elements.
        derivative: 0 deflection v, 1 slope v', 2 curvature phi'. At element ends the curvature is
            discontinuous, with shear also the slope: the value is that of the outboard element, at
            the tip that of the last element.
        parameters: (elements,) Phi_s of `shear_parameters`; None without shear.

    Returns:
        (k, n) rows that multiply nodal coordinates.
    """
    element, xi = _places(stations, length, elements)
    angles = _angles(element, length / elements, elements, parameters)
    return _spread(element, elements, deflection_shapes(xi, length / elements, angles, derivative))


def nodal_rotations(
    stations: FloatArray, length: float, elements: int, parameters: FloatArray
) -> FloatArray:
    """Evaluate the shapes (k, n) of the section rotation phi; arguments as in `nodal_shapes`."""
    element, xi = _places(stations, length, elements)
    angles = _angles(element, length / elements, elements, parameters)
    return _spread(element, elements, rotation_shapes(xi, length / elements, angles))


def interior_shapes(
    stations: FloatArray, length: float, elements: int, field: str, derivative: int
) -> FloatArray:
    """Evaluate interior shapes (k, 3 * elements) of v or phi at stations; see `nodal_shapes`."""
    element, xi = _places(stations, length, elements)
    of = interior_deflection if field == "deflection" else interior_rotation
    shapes = np.zeros((element.size, 3 * elements))
    columns = 3 * element[:, None] + np.arange(3)
    np.put_along_axis(shapes, columns, of(xi, length / elements, derivative), axis=1)
    return shapes


def _places(
    stations: FloatArray, length: float, elements: int
) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Return the element (k,) of each station, and the position in it (k,)."""
    scaled = stations / (length / elements)
    element = np.minimum(scaled.astype(np.intp), elements - 1)
    return element, scaled - element


def _angles(
    element: npt.NDArray[np.intp], length: float, elements: int, parameters: FloatArray | None
) -> FloatArray:
    """Return the rows (k, 4) of the shear angle of each station's element."""
    shear = np.zeros(elements) if parameters is None else parameters
    return shear_angles(shear, length)[element]


def _spread(element: npt.NDArray[np.intp], elements: int, local: FloatArray) -> FloatArray:
    """Return rows (k, n) over all nodal coordinates, from those of one element (k, 4)."""
    shapes = np.zeros((element.size, 2 * elements + 2))
    np.put_along_axis(shapes, 2 * element[:, None] + np.arange(4), local, axis=1)
    return shapes[:, 2:]


def _all_rows(quadrature: BeamQuadrature, local: FloatArray) -> tuple[npt.NDArray[np.intp], int]:
    """Return the indices (q, 4 or 7) of the coordinates of ``local``, and their total number."""
    size = 2 * quadrature.elements + 2
    if local.shape[1] == 4:
        return quadrature.nodal_rows, size
    return quadrature.all_rows, size + 3 * quadrature.elements
