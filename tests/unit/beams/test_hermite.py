"""The four shape functions: end values, sums, and reproduced polynomials."""

import numpy as np
import pytest

from flexarm.arm.beams.assembly import shape_functions

ROUNDING = {"rtol": 1e-13, "atol": 1e-13}  # cubics of order one, evaluated in a few operations


def test_values_and_slopes_at_the_ends_are_the_nodal_coordinates():
    ends = np.array([0.0, 1.0])
    value, slope = shape_functions(ends, 0.7), shape_functions(ends, 0.7, 1)
    nodal = np.stack([value[0], slope[0], value[1], slope[1]])
    np.testing.assert_allclose(nodal, np.eye(4), **ROUNDING)


def test_translation_and_rotation_leave_the_element_straight():
    length, xi = 0.7, np.linspace(0.0, 1.0, 11)
    values = shape_functions(xi, length)
    np.testing.assert_allclose(values @ [1.0, 0.0, 1.0, 0.0], np.ones(11), **ROUNDING)
    np.testing.assert_allclose(values @ [0.0, 1.0, length, 1.0], xi * length, **ROUNDING)


@pytest.mark.parametrize("derivative", range(4))
def test_any_cubic_is_reproduced_with_its_derivatives(derivative):
    length, xi = 0.7, np.linspace(0.0, 1.0, 11)
    cubic = np.polynomial.Polynomial([0.3, -1.2, 2.5, 4.0])
    slope = cubic.deriv()
    nodal = [cubic(0.0), slope(0.0), cubic(length), slope(length)]
    found = shape_functions(xi, length, derivative) @ nodal
    exact = (cubic.deriv(derivative) if derivative else cubic)(xi * length)
    # Division by length**3 and alternating sums of the nodal values lose two digits.
    np.testing.assert_allclose(found, exact, rtol=1e-11, atol=1e-11)
