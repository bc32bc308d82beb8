"""Forward and inverse dynamics are one linear relation in two directions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flexarm as fa
from arm_states import changed, drawn, modal_parts

EPSILON = np.finfo(float).eps
seeds = st.integers(0, 10**6)


def condition(M):
    """Return the condition number of a mass matrix without the scale of units."""
    scale = np.sqrt(np.diag(M))
    return np.linalg.cond(M / np.outer(scale, scale))


@settings(max_examples=60)
@given(seeds, st.booleans())
def test_inverse_of_forward_is_the_torque_without_modal_forces(seed, reduced):
    d = drawn(seed, reduced=reduced)
    qdd = d.arm.forward_dynamics(d.q, d.qd, d.torque, d.tip_force)
    force = d.arm.inverse_dynamics(d.q, d.qd, qdd, d.tip_force)
    wanted = np.zeros(d.arm.dof)
    wanted[d.arm.joint_index] = d.torque
    # The required accuracy of the recursion is 1e-10, here of the inertia forces in balance.
    terms = abs(d.arm.mass_matrix(d.q)) @ abs(qdd)
    scale = np.sqrt(np.diag(d.arm.mass_matrix(d.q)))
    size = np.linalg.norm(terms / scale)
    assert np.linalg.norm((force - wanted) / scale) < 1e-10 * size


@settings(max_examples=100)
@given(seeds)
def test_forward_of_inverse_is_the_acceleration(seed):
    """The accelerations have no modal forces, because other torques cause them."""
    d = drawn(seed)
    qdd = d.arm.forward_dynamics(d.q, d.qd, 2.0 * d.torque - 1.0)
    force = d.arm.inverse_dynamics(d.q, d.qd, qdd)
    found = d.arm.forward_dynamics(d.q, d.qd, force[d.arm.joint_index])
    M = d.arm.mass_matrix(d.q)
    scale = np.sqrt(np.diag(M))
    # Rounding of qdd leaves small modal forces, which forward dynamics sets to zero. A light mode
    # has a visible acceleration from them, which is part of the tolerance.
    force[d.arm.joint_index] = 0.0
    answer = np.linalg.solve(M / np.outer(scale, scale), force / scale)
    # The required accuracy of the recursion is 1e-10; the largest error of 3000 arms is 2e-11.
    missed = scale * (found - qdd) + answer
    assert np.linalg.norm(missed) < 1e-10 * np.linalg.norm(scale * qdd)


@settings(max_examples=60)
@given(seeds, st.booleans())
def test_mass_matrix_is_the_derivative_of_inverse_dynamics(seed, reduced):
    d = drawn(seed, reduced=reduced)
    M = d.arm.mass_matrix(d.q)
    zero = np.zeros(d.arm.dof)
    level = changed(d.arm, gravity=(0.0, 0.0))
    stiff = level.inverse_dynamics(d.q, zero, zero)
    columns = [level.inverse_dynamics(d.q, zero, unit) - stiff for unit in np.eye(d.arm.dof)]
    scale = np.sqrt(np.outer(np.diag(M), np.diag(M)))
    # The stiffness forces are subtracted, which leaves their rounding.
    rounding = 1e-13 + 4.0 * EPSILON * abs(stiff).max() / scale.min()
    np.testing.assert_allclose(np.array(columns).T / scale, M / scale, rtol=0, atol=rounding)


@settings(max_examples=60)
@given(seeds)
def test_inverse_dynamics_is_mass_times_acceleration_plus_bias(seed):
    d = drawn(seed)
    M, bias = d.arm.mass_matrix(d.q), d.arm.bias_force(d.q, d.qd)
    found = d.arm.inverse_dynamics(d.q, d.qd, d.qdd)
    terms = abs(M) @ abs(d.qdd) + abs(bias)
    # Sums of at most a hundred products in another order.
    assert np.all(abs(found - M @ d.qdd - bias) < 1e-12 * terms.max())


@settings(max_examples=20)
@given(seeds)
def test_many_states_in_one_call_equal_single_calls(seed):
    d = drawn(seed)
    factors = np.linspace(0.2, 1.0, 5)[:, None]
    q, qd, qdd = factors * d.q, factors * d.qd, factors * d.qdd
    forces = d.arm.inverse_dynamics_many(q, qd, qdd)
    single = [d.arm.inverse_dynamics(*state) for state in zip(q, qd, qdd, strict=True)]
    np.testing.assert_array_equal(forces, single)


@settings(max_examples=40)
@given(seeds)
def test_tip_force_acts_by_the_transposed_jacobian(seed):
    """Virtual work: the generalised force is the transposed Jacobian of the tip's pose."""
    d = drawn(seed)
    zero = np.zeros(d.arm.dof)
    free = d.arm.inverse_dynamics(d.q, zero, zero)
    loaded = d.arm.inverse_dynamics(d.q, zero, zero, d.tip_force)
    jacobian = np.array([d.arm.tip_velocity(d.q, unit) for unit in np.eye(d.arm.dof)]).T
    exact = -d.tip_force @ jacobian
    # The difference of two forces has the rounding of the larger one.
    rounding = 1e-13 * abs(exact).max() + 4.0 * EPSILON * abs(free).max()
    np.testing.assert_allclose(loaded - free, exact, rtol=0, atol=rounding)
    by_forward = d.arm.forward_dynamics(d.q, d.qd, d.torque, (*d.tip_force[:2], 0.0))
    np.testing.assert_array_equal(
        by_forward, d.arm.forward_dynamics(d.q, d.qd, d.torque, d.tip_force[:2])
    )


def chain(links, theory):
    """Return equal links, each with a static deflection of a few millimetres under its load."""
    link = fa.Link(length=1.0, flexural_rigidity=50.0, mass_per_length=0.5, elements=2)
    return fa.Arm(links=[link] * links, theory=theory, gravity=(0.0, -9.81))


@pytest.mark.thorough_cases("256-linear", "256-second_order")
@pytest.mark.parametrize("theory", ["linear", "second_order"])
@pytest.mark.parametrize("links", [1, 2, 3, 5, 8, 16, 32, 64, 128, 256])
def test_chains_of_every_length(links, theory):
    arm = chain(links, theory)
    rng = np.random.default_rng(links)
    q, qd = 0.3 * rng.normal(size=(2, arm.dof))
    elastic = modal_parts(arm)
    stiffest = np.sqrt(np.concatenate([link.w2 for link in arm.assembly.links]))
    q[elastic], qd[elastic] = 0.02 * q[elastic] / stiffest, 0.1 * qd[elastic]
    torque = rng.normal(size=links)
    qdd = arm.forward_dynamics(q, qd, torque)
    force = arm.inverse_dynamics(q, qd, qdd)
    wanted = np.zeros(arm.dof)
    wanted[arm.joint_index] = torque
    scale = np.sqrt(np.diag(arm.mass_matrix(q)))
    bias = arm.bias_force(q, qd)
    # Inertia of a chain grows with the cube of its length: forces of outboard links pass through
    # every joint, with their rounding.
    size = np.linalg.norm(scale * qdd) + np.linalg.norm(bias / scale)
    assert np.linalg.norm((force - wanted) / scale) < 1e-11 * size
    dense = np.linalg.solve(arm.mass_matrix(q), wanted - bias)
    limit = max(1e-10, 10 * EPSILON * condition(arm.mass_matrix(q)))
    assert np.linalg.norm(scale * (qdd - dense)) < limit * np.linalg.norm(scale * dense)
