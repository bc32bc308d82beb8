"""The differentiating number types against derivatives by hand."""

import numpy as np

from .jets import Jet, Rate, cos, sin

EXACT = 1e-15  # a few operations on numbers of order one


def test_jet_has_gradient_and_hessian_of_a_formula():
    x, y = 0.7, -1.3
    jet = Jet.variables(np.array([x, y]), rows=2)
    f = sin(jet[0] * jet[1]) * 2.0 + cos(jet[0]) - jet[1] * jet[1] * jet[0] + 1.0
    s, c = np.sin(x * y), np.cos(x * y)
    gradient = [2 * c * y - np.sin(x) - y * y, 2 * c * x - 2 * y * x]
    mixed = 2 * c - 2 * s * x * y - 2 * y
    hessian = [[-2 * s * y * y - np.cos(x), mixed], [mixed, -2 * s * x * x - 2 * x]]
    np.testing.assert_allclose(f.value, 2 * s + np.cos(x) - y * y * x + 1, rtol=EXACT)
    np.testing.assert_allclose(f.first, gradient, rtol=EXACT)
    np.testing.assert_allclose(f.second, hessian, rtol=2 * EXACT)


def test_matrix_and_arrays_act_on_every_point():
    matrix = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    jet = Jet.variables(np.array([0.5, -0.25]), rows=2)
    f = 3.0 - np.array([1.0, 10.0, 100.0]) * (matrix @ jet) * jet[0]
    np.testing.assert_allclose(f.value, 3 - np.array([1, 10, 100]) * (matrix @ jet.value) * 0.5)
    # d/dq of (m.q) q0 is m q0 + (m.q) e0, and again: m e0' + e0 m'
    np.testing.assert_allclose(f.first[2], -100 * (matrix[2] * 0.5 + np.array([1.0, 0.0])))
    np.testing.assert_allclose(f.second[2], [[-1000.0, -600.0], [-600.0, 0.0]])


def test_rate_of_jets_is_the_velocity_and_its_derivatives():
    q, qd = 0.4, 2.5
    jet = Jet.variables(np.array([q, qd]), rows=2)
    height = sin(Rate(jet[0], jet[1])) * 1.5 - 2.0
    np.testing.assert_allclose(height.rate.value, 1.5 * np.cos(q) * qd, rtol=EXACT)
    np.testing.assert_allclose(
        height.rate.first, [-1.5 * np.sin(q) * qd, 1.5 * np.cos(q)], rtol=EXACT
    )
    np.testing.assert_allclose(height.rate.second[0, 1], -1.5 * np.sin(q), rtol=EXACT)
