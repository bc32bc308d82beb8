"""Nodal matrices of a link: textbook values, and exact integrals on irregular tables."""

import numpy as np
import pytest
from scipy.interpolate import PPoly

from flexarm.arm.beams.assembly import BeamTable, beam_matrices, beam_quadrature, nodal_shapes

X = np.array([0.0, 0.4, 0.55, 1.3, 2.0])
STIFFNESS = np.array([5.0, 4.0, 8.0, 2.0, 1.0])
MASS = np.array([3.0, 1.0, 1.5, 0.2, 0.9])
ROTARY = np.array([0.3, 0.0, 0.1, 0.2, 0.05])
# Rounding of sums over a few dozen points.
ROUNDING = {"rtol": 1e-12, "atol": 1e-12}


def matrices(elements):
    table = BeamTable(X, STIFFNESS, MASS, ROTARY)
    return beam_matrices(table, beam_quadrature(table.x, elements))


def exact(values, power):
    """Integrate a column of the table times x^power, by shifted polynomials."""
    column = PPoly(np.stack([np.diff(values) / np.diff(X), values[:-1]]), X)
    total = 0.0
    for k in range(X.size - 1):
        local = np.polynomial.Polynomial(column.c[::-1, k])
        product = (local * np.polynomial.Polynomial([X[k], 1.0]) ** power).integ()
        total += product(X[k + 1] - X[k]) - product(0.0)
    return total


def test_one_uniform_element_has_the_textbook_matrices():
    h, stiffness, mass, rotary = 0.7, 3.0, 2.0, 0.4
    two = np.ones(2)
    table = BeamTable(np.array([0.0, h]), stiffness * two, mass * two, rotary * two)
    found = beam_matrices(table, beam_quadrature(table.x, 1))
    np.testing.assert_allclose(
        found.stiffness, stiffness / h**3 * np.array([[12, -6 * h], [-6 * h, 4 * h**2]]), **ROUNDING
    )
    np.testing.assert_allclose(
        found.translational_mass,
        mass * h / 420 * np.array([[156, -22 * h], [-22 * h, 4 * h**2]]),
        **ROUNDING,
    )
    np.testing.assert_allclose(
        found.rotary_mass,
        rotary / (30 * h) * np.array([[36, -3 * h], [-3 * h, 4 * h**2]]),
        **ROUNDING,
    )
    np.testing.assert_allclose(found.deflection_moment, mass * h * np.array([0.5, -h / 12]))
    rotation = mass * h**2 * np.array([7 / 20, -h / 20]) + rotary * np.array([1.0, 0.0])
    np.testing.assert_allclose(found.rotation_moment, rotation, **ROUNDING)


def test_middle_node_connects_two_elements():
    two = np.ones(2)
    table = BeamTable(np.array([0.0, 2.0]), two, 420 * two, 0 * two)
    found = beam_matrices(table, beam_quadrature(table.x, 2))
    mass = [[312, 0, 54, -13], [0, 8, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    stiffness = [[24, 0, -12, 6], [0, 8, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    np.testing.assert_allclose(found.translational_mass, mass, **ROUNDING)
    np.testing.assert_allclose(found.stiffness, stiffness, **ROUNDING)


@pytest.mark.parametrize("elements", [1, 3, 8])
def test_parabola_and_cubic_are_integrated_exactly_on_an_irregular_table(elements):
    """v = x^2 and v = x^3 are in the space of any mesh, so every quadratic form has a closed
    form."""
    found = matrices(elements)
    nodes = np.linspace(0.0, 2.0, elements + 1)[1:]
    parabola = np.stack([nodes**2, 2 * nodes], axis=1).ravel()
    cubic = np.stack([nodes**3, 3 * nodes**2], axis=1).ravel()
    for matrix, expected in (
        (found.translational_mass, (exact(MASS, 4), exact(MASS, 5))),
        (found.rotary_mass, (4 * exact(ROTARY, 2), 6 * exact(ROTARY, 3))),
        (found.stiffness, (4 * exact(STIFFNESS, 0), 12 * exact(STIFFNESS, 1))),
    ):
        np.testing.assert_allclose(matrix, matrix.T, **ROUNDING)
        forms = (parabola @ matrix @ parabola, parabola @ matrix @ cubic)
        np.testing.assert_allclose(forms, expected, **ROUNDING)
    moments = (found.deflection_moment @ parabola, found.rotation_moment @ cubic)
    expected = (exact(MASS, 2), exact(MASS, 4) + 3 * exact(ROTARY, 2))
    np.testing.assert_allclose(moments, expected, **ROUNDING)
    np.testing.assert_allclose(found.mass, found.translational_mass + found.rotary_mass)


@pytest.mark.parametrize("derivative", range(3))
def test_shapes_reproduce_a_cubic_anywhere_along_the_link(derivative):
    elements, stations = 3, np.linspace(0.0, 2.0, 23)
    cubic = np.polynomial.Polynomial([0.0, 0.0, 1.3, -0.4])
    nodes = np.linspace(0.0, 2.0, elements + 1)[1:]
    nodal = np.stack([cubic(nodes), cubic.deriv()(nodes)], axis=1).ravel()
    found = nodal_shapes(stations, 2.0, elements, derivative) @ nodal
    expected = (cubic.deriv(derivative) if derivative else cubic)(stations)
    np.testing.assert_allclose(found, expected, **ROUNDING)
