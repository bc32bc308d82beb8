"""One element with shear: its matrices, its internal field, and exactly reproduced functions."""

import numpy as np
import pytest

from flexarm.arm.beams.assembly import (
    BeamTable,
    beam_matrices,
    beam_quadrature,
    deflection_shapes,
    interior_shapes,
    nodal_rotations,
    nodal_shapes,
    point_shapes,
    rotation_shapes,
    shape_functions,
    shear_angles,
    shear_parameters,
)
from flexarm.arm.beams.invariants import strain_to_nodal

H, PHI = 0.7, 1.7
XI = np.linspace(0.0, 1.0, 11)
ROUNDING = {"rtol": 1e-12, "atol": 1e-12}  # a few operations on numbers of order one

X = np.array([0.0, 0.4, 0.55, 1.3, 2.0])
BENDING = np.array([5.0, 4.0, 8.0, 2.0, 1.0])
MASS = np.array([3.0, 1.0, 1.5, 0.2, 0.9])
ROTARY = np.array([0.3, 0.0, 0.1, 0.2, 0.05])
SHEAR = np.array([60.0, 20.0, 90.0, 15.0, 30.0])


def static_stiffness(table, quadrature):
    """Return the stiffness over the nodal values; interior values have no loads."""
    n, stiffness = 2 * quadrature.elements, beam_matrices(table, quadrature).stiffness
    coupling = stiffness[:n, n:]
    return stiffness[:n, :n] - coupling @ np.linalg.solve(stiffness[n:, n:], coupling.T)


def shapes(parameter):
    """Return deflection, its derivatives and rotation of one element: (11, 4) each."""
    angles = np.repeat(shear_angles(np.array([parameter]), H), XI.size, axis=0)
    deflection = [deflection_shapes(XI, H, angles, order) for order in range(3)]
    return *deflection, rotation_shapes(XI, H, angles)


@pytest.mark.parametrize("parameter", [0.0, 1e-6, PHI, 1e6])
class TestField:
    def test_nodal_coordinates_are_deflection_and_rotation_of_the_ends(self, parameter):
        v, _, _, rotation = shapes(parameter)
        nodal = np.stack([v[0], rotation[0], v[-1], rotation[-1]])
        np.testing.assert_allclose(nodal, np.eye(4), **ROUNDING)

    def test_translation_and_rotation_have_no_energy(self, parameter):
        v, slope, curvature, rotation = shapes(parameter)
        lifted, turned = [1.0, 0.0, 1.0, 0.0], [0.0, 1.0, H, 1.0]
        np.testing.assert_allclose(v @ lifted, 1.0, **ROUNDING)
        np.testing.assert_allclose(v @ turned, XI * H, **ROUNDING)
        np.testing.assert_allclose(rotation @ lifted, 0.0, **ROUNDING)
        np.testing.assert_allclose(rotation @ turned, 1.0, **ROUNDING)
        for nodal in (lifted, turned):
            np.testing.assert_allclose((slope - rotation) @ nodal, 0.0, **ROUNDING)
            np.testing.assert_allclose(curvature @ nodal, 0.0, atol=1e-11)

    def test_moment_and_shear_force_are_in_balance(self, parameter):
        """EI phi'' + k G A gamma = 0 with one gamma throughout; here EI = 1."""
        _, slope, curvature, rotation = shapes(parameter)
        gamma = slope - rotation
        np.testing.assert_allclose(gamma, np.tile(gamma[0], (XI.size, 1)), **ROUNDING)
        rate = np.diff(curvature, axis=0) / (XI[1] * H)
        # k G A = 12/(Phi_s h^2), multiplied out so that it is finite without shear.
        np.testing.assert_allclose(
            parameter * H**2 / 12 * rate, -gamma[1:], rtol=1e-9, atol=1e-10 + 1e-14 * parameter
        )

    def test_curvature_is_the_derivative_of_the_rotation(self, parameter):
        _, _, curvature, rotation = shapes(parameter)
        s = XI[:, None]
        linear = (1 - s) * curvature[0] + s * curvature[-1]
        np.testing.assert_allclose(curvature, linear, rtol=1e-11, atol=1e-11)
        turned = H * s * (curvature[0] + linear) / 2  # the integral from the inboard end
        np.testing.assert_allclose(rotation - rotation[0], turned, rtol=1e-11, atol=1e-11)


def test_without_shear_the_shapes_are_cubic_bit_for_bit():
    *deflection, rotation = shapes(0.0)
    for order, found in enumerate(deflection):
        np.testing.assert_array_equal(found, shape_functions(XI, H, order))
    np.testing.assert_array_equal(rotation, shape_functions(XI, H, 1))


def test_one_uniform_element_has_the_textbook_stiffness():
    """(B.32); J. S. Przemieniecki, Theory of Matrix Structural Analysis (1968), chapter 5."""
    bending, two = 3.0, np.ones(2)
    shear = 12 * bending / (PHI * H**2)
    table = BeamTable(np.array([0.0, H]), bending * two, two, two, shear * two)
    quadrature = beam_quadrature(table.x, 1)
    np.testing.assert_allclose(shear_parameters(table, quadrature), [PHI], rtol=1e-14)
    exact = np.array([[12, -6 * H], [-6 * H, (4 + PHI) * H**2]])
    found = static_stiffness(table, quadrature)
    np.testing.assert_allclose(found, bending / (H**3 * (1 + PHI)) * exact, **ROUNDING)


def test_shear_parameter_has_the_mean_rigidities_of_its_element():
    table = BeamTable(X, BENDING, MASS, ROTARY, SHEAR)
    found = shear_parameters(table, beam_quadrature(table.x, 2))
    # First element: the table from 0 to 1, divided at 0.55 and 1.3, where EI = 4.4 and kGA = 45.
    bending = 0.4 * 4.5 + 0.15 * 6.0 + 0.45 * 6.2
    shear = 0.4 * 40.0 + 0.15 * 55.0 + 0.45 * 67.5
    assert found[0] == pytest.approx(12 * bending / shear, rel=1e-13)
    plain = BeamTable(X, BENDING, MASS, ROTARY)
    np.testing.assert_array_equal(shear_parameters(plain, beam_quadrature(X, 2)), 0.0)


def inside(x, elements, field, derivative):
    return interior_shapes(x, 2.0, elements, field, derivative)


@pytest.mark.parametrize("elements", [1, 3, 8])
def test_energies_are_integrated_exactly_on_an_irregular_table(elements):
    """Against many points on every piece, for nodal and interior values."""
    table = BeamTable(X, BENDING, MASS, ROTARY, SHEAR)
    quadrature = beam_quadrature(table.x, elements)
    found, parameters = beam_matrices(table, quadrature), shear_parameters(table, quadrature)
    node, weight = np.polynomial.legendre.leggauss(9)
    edges = np.union1d(np.linspace(0.0, 2.0, elements + 1), X)
    half = np.diff(edges)[:, None] / 2
    x = ((edges[1:, None] + edges[:-1, None]) / 2 + half * node).ravel()
    weights = (half * weight).ravel()
    bending, mass, rotary, shear = (np.interp(x, X, c) for c in (BENDING, MASS, ROTARY, SHEAR))
    v, slope, curvature = (
        np.hstack([nodal_shapes(x, 2.0, elements, k, parameters), inside(x, elements, *field)])
        for k, field in enumerate((("deflection", 0), ("deflection", 1), ("rotation", 1)))
    )
    nodal = nodal_rotations(x, 2.0, elements, parameters)
    turn = np.hstack([nodal, inside(x, elements, "rotation", 0)])

    def form(density, rows):
        return rows.T @ ((weights * density)[:, None] * rows)

    close = {"rtol": 1e-11, "atol": 1e-11}
    np.testing.assert_allclose(found.translational_mass, form(mass, v), **close)
    np.testing.assert_allclose(found.rotary_mass, form(rotary, turn), **close)
    stiffness = form(bending, curvature) + form(shear, slope - turn)
    scale = np.abs(stiffness).max()
    np.testing.assert_allclose(found.stiffness, stiffness, atol=1e-13 * scale)
    np.testing.assert_allclose(found.deflection_moment, (weights * mass) @ v, **close)
    rotation_moment = (weights * mass * x) @ v + (weights * rotary) @ turn
    np.testing.assert_allclose(found.rotation_moment, rotation_moment, **close)
    local = point_shapes(table, quadrature)
    np.testing.assert_allclose(local.slope - local.rotation, local.shear, **close)


@pytest.mark.parametrize("softness", [1e-3, 1.0, 1e3])
def test_strain_coordinates_store_unit_energy(softness):
    elements = 6
    table = BeamTable(X, BENDING, MASS, ROTARY, SHEAR / softness)
    quadrature = beam_quadrature(table.x, elements)
    units = np.tile([1.0, 2.0 / elements], elements)
    stiffness = static_stiffness(table, quadrature) / np.outer(units, units)
    factor = strain_to_nodal(table, quadrature)
    # Condition number 1e5 of the stiffness matrix, and more with much shear, times rounding.
    np.testing.assert_allclose(factor.T @ stiffness @ factor, np.eye(12), atol=1e-9)
