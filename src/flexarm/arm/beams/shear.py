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

from flexarm.arm.beams.hermite import FloatArray, shape_functions
from flexarm.arm.beams.properties import BeamTable
from flexarm.arm.beams.quadrature import BeamQuadrature


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
    """Return rows that give the shear angle v' - phi from nodal coordinates; (B.30).

    Args:
        parameters: (k,) Phi_s of k elements.
        length: length of an element (m).

    Returns:
        (k, 4): columns belong to v_1, phi_1, v_2, phi_2.
    """
    share = parameters / (1.0 + parameters)
    rows: FloatArray = share[:, None] * np.array([-1.0 / length, -0.5, 1.0 / length, -0.5])
    return rows


def deflection_shapes(
    xi: FloatArray, length: float, angles: FloatArray, derivative: int = 0
) -> FloatArray:
    """Evaluate the shapes of the deflection, or one of their derivatives; (B.31).

    Args:
        xi: (k,) positions in their elements, 0 to 1.
        length: length of an element (m).
        angles: (k, 4) rows of `shear_angles` of the elements of the positions.
        derivative: 0 deflection v, 1 slope v', 2 curvature v'' = phi'.

    Returns:
        (k, 4): columns belong to v_1, phi_1, v_2, phi_2.
    """
    local = shape_functions(xi, length, derivative)
    turned: FloatArray = local + (local[:, 1] + local[:, 3])[:, None] * angles
    return turned


def rotation_shapes(xi: FloatArray, length: float, angles: FloatArray) -> FloatArray:
    """Evaluate the shapes (k, 4) of the section rotation phi; as in `deflection_shapes`."""
    rotation: FloatArray = deflection_shapes(xi, length, angles, 1) - angles
    return rotation


def interior_deflection(xi: FloatArray, length: float, derivative: int = 0) -> FloatArray:
    """Evaluate the deflection v of an element's three interior shapes, or its slope v'.

    Args:
        xi: (k,) positions in their elements, 0 to 1.
        length: length of an element (m).
        derivative: 0 deflection v, 1 slope v'.

    Returns:
        (k, 3): the parabola h xi (1 - xi), the cubic h xi (1 - xi)(1 - 2 xi), and zero.
    """
    zero, bump = np.zeros_like(xi), xi * (1.0 - xi)
    if derivative == 0:
        return length * np.stack([bump, bump * (1.0 - 2.0 * xi), zero], axis=1)
    return np.stack([1.0 - 2.0 * xi, 1.0 - 6.0 * bump, zero], axis=1)


def interior_rotation(xi: FloatArray, length: float, derivative: int = 0) -> FloatArray:
    """Evaluate the rotation phi of the interior shapes, or phi', as `interior_deflection`.

    Returns:
        (k, 3): zero, zero, and the parabola xi (1 - xi).
    """
    zero, bump = np.zeros_like(xi), xi * (1.0 - xi)
    shape = bump if derivative == 0 else (1.0 - 2.0 * xi) / length
    return np.stack([zero, zero, shape], axis=1)


@dataclass(frozen=True, eq=False)
class PointShapes:
    """Shapes of the element of each quadrature point: (q, 4) for v_1, phi_1, v_2, phi_2.

    With shear (q, 7), where the last three columns are the interior shapes.

    Attributes:
        deflection: v. slope: v'. rotation: phi of the section. curvature: phi'.
        shear: the angle v' - phi.
    """

    deflection: FloatArray
    slope: FloatArray
    rotation: FloatArray
    curvature: FloatArray
    shear: FloatArray


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
