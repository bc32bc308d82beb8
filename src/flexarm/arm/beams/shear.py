"""Shear deformation of an element, by the angle between the sections and the normals of the axis.

The deflection v remains the cubic Hermite polynomial, with end slopes that are the rotations phi
of the end sections plus this angle. Balance of moments inside the element makes the angle linear
in the nodal coordinates; theory page "beams", section 9. Without shear the angle is zero and the
element is that of Euler and Bernoulli.

Reference:
    Z. Friedman and J. B. Kosmatka, "An improved two-node Timoshenko beam finite element",
    Computers & Structures 47(3), 1993, 473-481.

These shapes are exact only under loads at nodes. Three interior shapes of each element, zero at
its ends, represent loads inside it; see ``beams.interior``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.arm.beams.hermite import BeamQuadrature, FloatArray, shape_functions
from flexarm.arm.beams.properties import BeamTable


def shear_parameters(table: BeamTable, quadrature: BeamQuadrature) -> FloatArray:
    """Return Phi_s = 12 EI / (k G A h^2) of each element (elements,), from its mean rigidities.

    Zero for an Euler-Bernoulli beam. The mean affects the shapes only: energies are integrated
    over the table itself.
    """
    if table.shear_rigidity is None:
        return np.zeros(quadrature.elements)
    bending, shear = (
        element_integrals(quadrature, np.interp(quadrature.points, table.x, column))
        for column in (table.flexural_rigidity, table.shear_rigidity)
    )
    return 12.0 * bending / (shear * quadrature.element_length**2)


def element_integrals(quadrature: BeamQuadrature, density: FloatArray) -> FloatArray:
    """Integrate a density, (q,) at the points, over each element: (elements,)."""
    totals = np.zeros(quadrature.elements)
    np.add.at(totals, quadrature.element, quadrature.weights * density)
    return totals


def shear_angles(parameters: FloatArray, length: float) -> FloatArray:
    """Return rows (k, 4) that give the shear angle v' - phi from v_1, phi_1, v_2, phi_2; (B.30)."""
    share = parameters / (1.0 + parameters)
    rows: FloatArray = share[:, None] * np.array([-1.0 / length, -0.5, 1.0 / length, -0.5])
    return rows


def deflection_shapes(
    xi: FloatArray, length: float, angles: FloatArray, derivative: int = 0
) -> FloatArray:
    """Evaluate the deflection v, its slope v' or curvature v'' = phi': (k, 4), as (B.31).

    ``xi`` (k,) are positions in their elements, ``angles`` (k, 4) the rows of `shear_angles`.
    """
    local = shape_functions(xi, length, derivative)
    turned: FloatArray = local + (local[:, 1] + local[:, 3])[:, None] * angles
    return turned


def rotation_shapes(xi: FloatArray, length: float, angles: FloatArray) -> FloatArray:
    """Evaluate the shapes (k, 4) of the section rotation phi; as in `deflection_shapes`."""
    rotation: FloatArray = deflection_shapes(xi, length, angles, 1) - angles
    return rotation


def interior_deflection(xi: FloatArray, length: float, derivative: int = 0) -> FloatArray:
    """Evaluate v of an element's three interior shapes at xi (k,), or its slope v': (k, 3).

    They are the parabola h xi (1 - xi), the cubic h xi (1 - xi)(1 - 2 xi), and zero.
    """
    zero, bump = np.zeros_like(xi), xi * (1.0 - xi)
    if derivative == 0:
        return length * np.stack([bump, bump * (1.0 - 2.0 * xi), zero], axis=1)
    return np.stack([1.0 - 2.0 * xi, 1.0 - 6.0 * bump, zero], axis=1)


def interior_rotation(xi: FloatArray, length: float, derivative: int = 0) -> FloatArray:
    """Evaluate the rotation phi of the interior shapes, or phi': zero, zero, xi (1 - xi)."""
    zero, bump = np.zeros_like(xi), xi * (1.0 - xi)
    shape = bump if derivative == 0 else (1.0 - 2.0 * xi) / length
    return np.stack([zero, zero, shape], axis=1)


@dataclass(frozen=True, eq=False)
class PointShapes:
    """Shapes of the element of each quadrature point: (q, 4) for v_1, phi_1, v_2, phi_2.

    With shear (q, 7), where the last three columns are the interior shapes.
    """

    deflection: FloatArray  # v
    slope: FloatArray  # v'
    rotation: FloatArray  # phi of the section
    curvature: FloatArray  # phi'
    shear: FloatArray  # the angle v' - phi


def point_shapes(table: BeamTable, quadrature: BeamQuadrature) -> PointShapes:
    """Evaluate the shapes of a link's elements at its quadrature points."""
    xi, length = quadrature.xi, quadrature.element_length
    angles = shear_angles(shear_parameters(table, quadrature), length)[quadrature.element]
    nodal = PointShapes(
        deflection=deflection_shapes(xi, length, angles),
        slope=deflection_shapes(xi, length, angles, 1),
        rotation=rotation_shapes(xi, length, angles),
        curvature=deflection_shapes(xi, length, angles, 2),
        shear=angles,
    )
    if table.shear_rigidity is None:
        return nodal
    slope, rotation = interior_deflection(xi, length, 1), interior_rotation(xi, length)
    return PointShapes(
        deflection=np.hstack([nodal.deflection, interior_deflection(xi, length)]),
        slope=np.hstack([nodal.slope, slope]),
        rotation=np.hstack([nodal.rotation, rotation]),
        curvature=np.hstack([nodal.curvature, interior_rotation(xi, length, 1)]),
        shear=np.hstack([nodal.shear, slope - rotation]),
    )


# Rotary inertia is negligible below this fraction of mu h^2. In a beam of one material h then
# exceeds thirty radii of gyration, and shear is negligible too.
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True, eq=False)
class _Interior:
    """Interior values of a link per nodal value; k = 3 * elements with shear, else 0."""

    values: FloatArray  # (k, n) rows that multiply nodal coordinates
    #: (k, n) Y: the stiffness over the nodal coordinates is K + Y^T Y, where K is the stiffness of
    #: the static response
    stiffening: FloatArray

    @property
    def extended(self) -> FloatArray:
        """Nodal and interior values per nodal value, (n + k, n)."""
        return np.vstack([np.eye(self.values.shape[1]), self.values])

    def stiffened(self, strain_to_nodal: FloatArray, units: FloatArray) -> FloatArray:
        """Return F of (K + Y^T Y)^-1 = F F^T from that of K^-1, whose rows have ``units`` (n,)."""
        from scipy.linalg import solve_triangular

        Y = self.stiffening @ (strain_to_nodal / units[:, None])
        lower = np.linalg.cholesky(np.eye(len(units)) + Y.T @ Y)
        return np.asarray(solve_triangular(lower, strain_to_nodal.T, lower=True).T, np.float64)


def interior_values(
    table: BeamTable, quadrature: BeamQuadrature, shapes: PointShapes, stiffness: FloatArray
) -> _Interior:
    """Compute the interior values of a link from K (n + k, n + k), also over interior values."""
    n = 2 * quadrature.elements
    if table.shear_rigidity is None:
        return _Interior(np.zeros((0, n)), np.zeros((0, n)))
    K, K_bb = stiffness, stiffness[n:, n:]
    S = -np.linalg.solve(K_bb, K[n:, :n])
    static = K[:n, :n] + K[:n, n:] @ S
    forces = _inertia_forces(table, quadrature, shapes) @ _accelerations(table, quadrature, static)
    response = np.linalg.solve(K_bb, forces)
    energy = np.linalg.cholesky(K_bb).T @ response
    return _Interior(np.asarray(S + response, np.float64), np.asarray(energy, np.float64))


def _accelerations(table: BeamTable, quadrature: BeamQuadrature, static: FloatArray) -> FloatArray:
    """Return the mean acceleration (2 * elements, n) of v, phi in each element, per nodal value.

    It is the force ``static @ d`` at inner nodes divided by the inertia of these nodes. Root and
    tip elements take the value of their inner node, because other forces act at root and tip; the
    error is of first order in two elements and changes frequencies in fifth order. The moment at a
    node also contains mu h^3/15 v'' of a smooth field around it.
    """
    h, elements, xi = quadrature.element_length, quadrature.elements, quadrature.xi
    mass, rotary = (
        quadrature.weights * np.interp(quadrature.points, table.x, column)
        for column in (table.mass_per_length, table.rotary_inertia_per_length)
    )
    both = np.stack([mass, rotary + h**2 / 15.0 * mass], axis=1)
    inertia = np.zeros((elements + 1, 2))
    np.add.at(inertia, quadrature.element, (1.0 - xi)[:, None] * both)
    np.add.at(inertia, quadrature.element + 1, xi[:, None] * both)
    nodal = static.reshape(elements, 2, -1)[:-1] / inertia[1:-1, :, None]
    mean = np.zeros((elements, 2, static.shape[1]))
    mean[:-1] += nodal
    mean[1:] += nodal
    mean[1:-1] /= 2.0
    return mean.reshape(2 * elements, -1)


def _inertia_forces(table: BeamTable, quadrature: BeamQuadrature, local: PointShapes) -> FloatArray:
    """Return F (3 * elements, 2 * elements): inertia of each element's mean acceleration.

    If rotary inertia is negligible, F vanishes. Otherwise the response would cancel the deflection
    that node rotations cause in soft elements, and then these rotations would have no inertia.
    """
    elements = quadrature.elements
    mass, rotary = (
        np.interp(quadrature.points, table.x, column)
        for column in (table.mass_per_length, table.rotary_inertia_per_length)
    )
    of_element = np.zeros((elements, 3, 2))
    for k, field in ((0, mass[:, None] * local.deflection), (1, rotary[:, None] * local.rotation)):
        inertia = quadrature.weights[:, None] * field[:, 4:]
        np.add.at(of_element[:, :, k], quadrature.element, inertia)
    turning = element_integrals(quadrature, rotary)
    scale = _NEGLIGIBLE * quadrature.element_length**2 * element_integrals(quadrature, mass)
    of_element *= (turning / np.maximum(turning + scale, np.finfo(float).tiny))[:, None, None]
    forces = np.zeros((elements, 3, elements, 2))
    each = np.arange(elements)
    forces[each, :, each] = of_element
    return forces.reshape(3 * elements, -1)
