"""The recursion against Lagrange's equations of material points, at random states of random arms.

The two ways to the same accelerations share no formula: O(n m) passes over links in modal
coordinates, and automatic differentiation of energies in nodal coordinates.
"""

from functools import cache

import numpy as np
import pytest

from arm_states import drawn, modal_parts
from oracles.lagrangian import LagrangianOracle

EPSILON = np.finfo(float).eps
SEEDS = range(44)
FEWER = range(0, 44, 2)


@cache
def case(seed):
    """Return a random arm, its oracle in double precision, and its state in the oracle's
    coordinates."""
    d = drawn(seed)
    oracle = LagrangianOracle(d.arm.spec, precision=np.float64)
    q = oracle.coordinates(d.state.angles, d.state.nodal)
    qd = oracle.coordinates(d.state.angle_rates, d.state.nodal_rates)
    return d, oracle, q, qd, oracle.mass_matrix(q)


def shapes_of(arm):
    """Return the package's shapes as a basis for the oracle, which then has the same
    coordinates."""
    return [link.basis if link.w2.size else None for link in arm.assembly.links]


def nodal_coordinates(arm, oracle, vector):
    """Return modal coordinates of the package as nodal coordinates of the oracle."""
    return oracle.coordinates(arm.joint_angles(vector), arm.nodal(vector))


def to_modal(arm, oracle):
    """Return the matrix (dof, dof) from nodal coordinates to those of the package."""
    matrix = np.zeros((arm.dof, oracle.dof))
    for i, link in enumerate(arm.assembly.links):
        start, where = arm.joint_index[i], oracle.shape_slice[i]
        matrix[start, oracle.joint_index[i]] = 1.0
        if link.w2.size:
            matrix[start + 1 : start + 1 + link.w2.size, where] = link.projector
    return matrix


def condition(mass):
    """Return the condition number without the scale of units (m, rad), and these scales (dof,)."""
    scale = np.sqrt(np.diag(mass))
    return np.linalg.cond(mass / np.outer(scale, scale)), scale


@pytest.mark.sampled("0", "11", "22", "32", "43")
@pytest.mark.parametrize("seed", SEEDS)
def test_accelerations(seed):
    """Error and result are compared as kinetic energy, so that metres and radians have equal
    weight."""
    d, oracle, q, qd, mass = case(seed)
    exact = LagrangianOracle(d.arm.spec).acceleration(q, qd, d.torque, d.tip_force)
    found = d.arm.forward_dynamics(d.q, d.qd, d.torque, d.tip_force)
    found = nodal_coordinates(d.arm, oracle, found)
    number, scale = condition(mass)
    # The required accuracy of the recursion is 1e-10. For an ill-conditioned arm no result in
    # double precision is better than its rounding times the condition number.
    limit = max(1e-10, EPSILON * number)
    assert np.linalg.norm(scale * (found - exact)) < limit * np.linalg.norm(scale * exact)


@pytest.mark.sampled("100", "102", "104", "105", "107", "109")
@pytest.mark.parametrize("seed", range(100, 110))
def test_accelerations_of_reduced_links(seed):
    """The oracle takes the reduced shapes of the links as its basis."""
    d = drawn(seed, reduced=True)
    oracle = LagrangianOracle(d.arm.spec, basis=shapes_of(d.arm))
    exact = oracle.acceleration(d.q, d.qd, d.torque, d.tip_force)
    found = d.arm.forward_dynamics(d.q, d.qd, d.torque, d.tip_force)
    number, scale = condition(oracle.mass_matrix(d.q))
    limit = max(1e-10, EPSILON * number)
    assert np.linalg.norm(scale * (found - exact)) < limit * np.linalg.norm(scale * exact)


@pytest.mark.sampled("0", "9", "17", "26", "34", "43")
@pytest.mark.parametrize("seed", SEEDS)
def test_mass_matrix(seed):
    d = drawn(seed)
    oracle = LagrangianOracle(d.arm.spec, basis=shapes_of(d.arm), precision=np.float64)
    exact = oracle.mass_matrix(d.q)
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    # Relative to the bound of an entry of a positive definite matrix; sums of a few dozen products.
    np.testing.assert_allclose(d.arm.mass_matrix(d.q) / scale, exact / scale, rtol=0, atol=1e-13)


@pytest.mark.sampled("0", "8", "16", "26", "34", "42")
@pytest.mark.parametrize("seed", FEWER)
def test_bias_force(seed):
    """Velocity products, gravity, stiffness and damping."""
    d, oracle, q, qd, _ = case(seed)
    exact = oracle.bias_force(q, qd)
    found = to_modal(d.arm, oracle).T @ d.arm.bias_force(d.q, d.qd)
    # Relative to the largest forces that cancel in it: elastic ones of every element.
    terms = abs(oracle.stiffness) @ abs(q) + abs(oracle.damping) @ abs(qd) + abs(exact)
    assert abs(found - exact).max() < 1e-12 * terms.max()


@pytest.mark.parametrize("seed", SEEDS)
def test_energy_and_tip(seed):
    d, oracle, q, qd, _ = case(seed)
    energy = d.arm.energy(d.q, d.qd)
    exact = oracle.energy(q, qd)
    # Rounding of the modal basis, as for the mass matrix; energies are single numbers.
    np.testing.assert_allclose(energy[:3], exact, rtol=1e-12, atol=1e-12 * max(map(abs, exact)))
    # Sum from left to right; `sum` compensates its rounding from Python 3.12 on.
    assert energy.total == energy.kinetic + energy.strain + energy.gravity
    # Rounding of positions of a few metres.
    np.testing.assert_allclose(d.arm.tip(d.q), oracle.tip(q), rtol=0, atol=1e-14 * 50)
    step = 1e-4  # fourth-order differences: truncation and rounding are both near 1e-11
    ahead, behind, far, back = (np.array(oracle.tip(q + k * step * qd)) for k in (1, -1, 2, -2))
    velocity = (8 * (ahead - behind) - (far - back)) / (12 * step)
    np.testing.assert_allclose(d.arm.tip_velocity(d.q, d.qd), velocity, rtol=0, atol=1e-8)


@pytest.mark.thorough
def test_random_arms_have_every_kind_of_option():
    arms = [case(seed)[0].arm for seed in SEEDS]
    assert len(arms) >= 40
    assert {arm.n_joints for arm in arms} == {1, 2, 3, 4}
    assert {arm.spec.theory for arm in arms} == {"linear", "second_order"}
    links = [link for arm in arms for link in arm.spec.links]
    assert {link.flexible for link in links} == {True, False}
    assert {getattr(link.damping, "kind", None) for link in links} == {None, "modal", "rayleigh"}
    assert any(arm.assembly.bodies > arm.n_joints for arm in arms)  # a payload beside the tip


@pytest.mark.thorough_cases("208")
@pytest.mark.parametrize("seed", range(200, 212))
def test_links_with_large_bending(seed):
    """By 40 % of the length, so that the terms of higher order matter."""
    d = drawn(seed, theory="second_order", rigid=False, elements=2)
    oracle = LagrangianOracle(d.arm.spec, basis=shapes_of(d.arm))
    q, qd = d.q.copy(), d.qd.copy()
    elastic = modal_parts(d.arm)
    q[elastic] *= 20.0
    exact = oracle.mass_matrix(q)
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    # The tolerances are those of the tests above.
    np.testing.assert_allclose(d.arm.mass_matrix(q) / scale, exact / scale, rtol=0, atol=1e-13)
    bias = oracle.bias_force(q, qd)
    np.testing.assert_allclose(
        d.arm.bias_force(q, qd), bias, rtol=0, atol=1e-11 * np.abs(bias).max()
    )
    np.testing.assert_allclose(
        d.arm.energy(q, qd)[:3], oracle.energy(q, qd), rtol=1e-12, atol=1e-12 * abs(bias).max()
    )
    wanted = oracle.acceleration(q, qd, d.torque, d.tip_force)
    found = d.arm.forward_dynamics(q, qd, d.torque, d.tip_force)
    units = np.sqrt(np.diag(exact))
    assert np.linalg.norm(units * (found - wanted)) < 1e-10 * np.linalg.norm(units * wanted)
