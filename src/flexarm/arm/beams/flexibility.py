"""Factor of the flexibility matrix, without inverting the stiffness matrix.

On a fine mesh the stiffness matrix is ill conditioned (its condition number grows as the fourth
power of the number of elements), and frequencies computed from it lose as many digits: with 256
elements the lowest one keeps five. Because the root is clamped, the curvature, linear in each
element, can be integrated twice from the root instead. These sums lose no digits. With shear, the
mean shear angle of an element is included in the integration.
"""

from __future__ import annotations

import numpy as np

from flexarm.arm.beams.hermite import FloatArray
from flexarm.arm.beams.properties import BeamTable
from flexarm.arm.beams.quadrature import BeamQuadrature


def strain_to_nodal(table: BeamTable, quadrature: BeamQuadrature) -> FloatArray:
    """Compute the matrix F that transforms strain coordinates z to nodal coordinates.

    In element e (length h, xi from 0 to 1) the curvature is `c_0 + c_1 sqrt(3) (2 xi - 1)`, and
    `z_e = sqrt(h) R c` with `R^T R` the integral of EI over the products of the two functions, so
    the strain energy is |z|^2 / 2. Hence `F^T K F = 1` and `F F^T` is the flexibility matrix.
    With shear the angle, quadratic in each element, adds its flexibility; (B.32). These are the
    static shapes, including the interior shapes: the response to loads at nodes.

    Returns:
        (n, n) F, with n = 2 * elements; rows `[v_2, phi_2 h, v_3, phi_3 h, ...]`: rotations
        times the element length (m), so that all rows have the unit of length.

    Raises:
        numpy.linalg.LinAlgError: if the bending stiffness of an element is not positive.
    """
    h, elements = quadrature.element_length, quadrature.elements
    linear = np.sqrt(3.0) * (2.0 * quadrature.xi - 1.0)
    basis = np.stack([np.ones_like(linear), linear], axis=1)
    stiffness = np.interp(quadrature.points, table.x, table.flexural_rigidity)
    gram = np.zeros((elements, 2, 2))
    np.add.at(
        gram,
        quadrature.element,
        (quadrature.weights * stiffness)[:, None, None] * basis[:, :, None] * basis[:, None, :],
    )
    # z = R c sqrt(h) with gram = h R^T R = lower lower^T, so c = lower^-T z.
    curvature = np.linalg.inv(np.linalg.cholesky(gram)).transpose(0, 2, 1)
    # Increments of (v, phi h) over an element by its curvature: rotation h^2 c_0, deflection
    # h^2 integral of (1 - xi) kappa = h^2 (c_0 / 2 - c_1 sqrt(3) / 6), besides h phi.
    from_curvature = np.zeros((elements, 2, 2))
    from_curvature[:, 0, 0], from_curvature[:, 1, 0] = 0.5, 1.0
    from_curvature[:, 0, 1] = -np.sqrt(3.0) / 6.0
    gains = h**2 * from_curvature @ curvature
    if table.shear_rigidity is not None:
        flexibility = gains @ gains.transpose(0, 2, 1)
        flexibility[:, 0, 0] += h**2 * _shear_flexibility(table.shear_rigidity, table, quadrature)
        gains = np.asarray(np.linalg.cholesky(flexibility), np.float64)
    spread = np.zeros((elements, 2, elements, 2))
    each = np.arange(elements)
    spread[each, :, each, :] = gains
    rotation = np.cumsum(spread[:, 1], axis=0)
    deflection = np.cumsum(spread[:, 0] + rotation - spread[:, 1], axis=0)
    return np.stack([deflection, rotation], axis=1).reshape(2 * elements, 2 * elements)


def _shear_flexibility(
    rigidity: FloatArray, table: BeamTable, quadrature: BeamQuadrature
) -> FloatArray:
    """Return the mean shear angle of each element under unit shear force, (elements,), rad/(N m).

    The angle is a parabola: the best approximation of 1/kGA in the element by three Legendre
    polynomials.
    """
    basis = np.polynomial.legendre.legvander(2.0 * quadrature.xi - 1.0, 2)
    weights = quadrature.weights * np.interp(quadrature.points, table.x, rigidity)
    gram = np.zeros((quadrature.elements, 3, 3))
    products = weights[:, None, None] * basis[:, :, None] * basis[:, None, :]
    np.add.at(gram, quadrature.element, products)
    return np.asarray(np.linalg.inv(gram)[:, 0, 0], np.float64)
