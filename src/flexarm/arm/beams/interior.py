"""Interior shapes of shear-deformable elements, as functions of the nodal values.

The two-node element is exact under loads at its nodes, but inertia also loads the link between
them. Without the shear strain of these loads, frequencies converge as h^2 if shear dominates.
Three interior values of each element, v cubic and phi quadratic with zero ends, represent it. They
are not coordinates, because they would add frequencies near the cut-off sqrt(kGA/rho I), which
limits the step of every integrator. They are functions of the nodal values d,
    b = S d + T p(d),    S = -K_bb^-1 K_bn,    T = K_bb^-1 F :

the static response to the nodal values, and to the inertia F p of the mean acceleration p of each
element. p follows from the forces K d at the inner nodes, which are inertia forces in a vibration.
Loads at the tip cause no forces there, so the static response to them stays exact. Theory page
"beams", section 9.

Symbols: n nodal, b interior; K stiffness; h length of an element.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.arm.beams.hermite import FloatArray
from flexarm.arm.beams.properties import BeamTable
from flexarm.arm.beams.quadrature import BeamQuadrature
from flexarm.arm.beams.shear import PointShapes, element_integrals

# Rotary inertia is negligible below this fraction of mu h^2. In a beam of one material h then
# exceeds thirty radii of gyration, and shear is negligible too.
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True, eq=False)
class Interior:
    """Interior values of a link per nodal value; k = 3 * elements with shear, else 0.

    Attributes:
        values: (k, n) rows that multiply nodal coordinates.
        stiffening: (k, n) Y: the stiffness over the nodal coordinates is K + Y^T Y, where K is
            the stiffness of the static response.
    """

    values: FloatArray
    stiffening: FloatArray

    @property
    def extended(self) -> FloatArray:
        """Nodal and interior values per nodal value, (n + k, n)."""
        return np.vstack([np.eye(self.values.shape[1]), self.values])

    def stiffened(self, strain_to_nodal: FloatArray, units: FloatArray) -> FloatArray:
        """Return the factor F of the flexibility (K + Y^T Y)^-1 = F F^T.

        Args:
            strain_to_nodal: (n, n) F of the static response, rows in metres.
            units: (n,) divisors that convert its rows to nodal coordinates.
        """
        from scipy.linalg import solve_triangular

        Y = self.stiffening @ (strain_to_nodal / units[:, None])
        lower = np.linalg.cholesky(np.eye(len(units)) + Y.T @ Y)
        return np.asarray(solve_triangular(lower, strain_to_nodal.T, lower=True).T, np.float64)


def interior_values(
    table: BeamTable, quadrature: BeamQuadrature, shapes: PointShapes, stiffness: FloatArray
) -> Interior:
    """Compute the interior values of a link per nodal value.

    Args:
        table: section properties along the link.
        quadrature: its points.
        shapes: `point_shapes` of the link.
        stiffness: K (n + k, n + k) over nodal and interior values, of `beam_matrices`.
    """
    n = 2 * quadrature.elements
    if table.shear_rigidity is None:
        return Interior(np.zeros((0, n)), np.zeros((0, n)))
    K, K_bb = stiffness, stiffness[n:, n:]
    S = -np.linalg.solve(K_bb, K[n:, :n])
    static = K[:n, :n] + K[:n, n:] @ S
    forces = _inertia_forces(table, quadrature, shapes) @ _accelerations(table, quadrature, static)
    response = np.linalg.solve(K_bb, forces)
    energy = np.linalg.cholesky(K_bb).T @ response
    return Interior(np.asarray(S + response, np.float64), np.asarray(energy, np.float64))


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
