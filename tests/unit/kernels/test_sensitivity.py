"""Exact Jacobians by complex perturbation of the kernels, against differences and other methods."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_states import changed, drawn, exact_derivative, parts, state_array, tip_loads
from flexarm.kernels.recursion.articulated_body import forward_dynamics

seeds = st.integers(0, 10**6)


def complex_accelerations(arm, state, torque, tip_force=(0.0, 0.0, 0.0)):
    """Return accelerations (dof,) at a complex state (2, dof)."""
    sizes, constants, work = parts(arm, complex)
    tau = arm.padded_torque(np.asarray(torque)).astype(complex)
    loads = tip_loads(arm, np.asarray(tip_force, dtype=float))
    forward_dynamics(sizes, constants, state_array(arm, *state).astype(complex), tau, loads, work)
    return arm.unpadded(work.acceleration)


def moderate(seed):
    """Return an arm with moderate accelerations, so that differences have enough digits."""
    return drawn(seed, links=2, elements=2)


@settings(max_examples=40)
@given(seeds)
def test_jacobians_equal_directional_derivatives(seed):
    """Column by column inside the kernel, along one direction here: exact to rounding."""
    d = drawn(seed)
    rng = np.random.default_rng(seed)
    by = d.arm.derivatives(d.q, d.qd, d.torque)
    assert by.q.shape == by.qd.shape == (d.arm.dof, d.arm.dof)
    assert by.torque.shape == (d.arm.dof, d.arm.n_joints)
    dq, dqd = rng.normal(size=(2, d.arm.dof))
    dtau = rng.normal(size=d.arm.n_joints)
    state, direction = np.stack([d.q, d.qd]), np.stack([dq, dqd])
    along = exact_derivative(lambda s: complex_accelerations(d.arm, s, d.torque), state, direction)
    wanted = by.q @ dq + by.qd @ dqd
    terms = abs(by.q) @ abs(dq) + abs(by.qd) @ abs(dqd) + 1e-6
    # Both use the same perturbed kernel: rounding, amplified by a nearly singular M.
    assert np.all(abs(along - wanted) <= 1e-10 * terms.max())
    lever = exact_derivative(lambda tau: complex_accelerations(d.arm, state, tau), d.torque, dtau)
    terms = abs(by.torque) @ abs(dtau)
    assert np.all(abs(lever - by.torque @ dtau) <= 1e-10 * terms.max())


@settings(max_examples=40)
@given(seeds)
def test_jacobians_are_the_limits_of_differences(seed):
    d = moderate(seed)
    by = d.arm.derivatives(d.q, d.qd, d.torque)
    rng = np.random.default_rng(seed)
    # Changes in proportion to the values, so that stiff modes are changed very little.
    dq, dqd = np.stack([d.q, d.qd]) * rng.normal(size=(2, d.arm.dof))
    dtau = rng.normal(size=d.arm.n_joints)

    def found(t):
        return d.arm.forward_dynamics(d.q + t * dq, d.qd + t * dqd, d.torque + t * dtau)

    step = 1e-4  # truncation of fourth order; rounding of the accelerations over the step
    near, far = found(step) - found(-step), found(2 * step) - found(-2 * step)
    slope = (8 * near - far) / (12 * step)
    wanted = by.q @ dq + by.qd @ dqd + by.torque @ dtau
    size = abs(wanted).max() + 1e-10 / step * abs(found(0.0)).max()
    np.testing.assert_allclose(slope, wanted, rtol=0, atol=1e-6 * size)


@settings(max_examples=40)
@given(seeds)
def test_jacobians_at_rest_are_mass_stiffness_and_damping(seed):
    """A straight arm at rest without gravity: M qdd = -K dq - D dqd + torque."""
    d = drawn(seed, gravity=False)
    q, zero = d.arm.rest(d.state.angles), np.zeros(d.arm.dof)
    by = d.arm.derivatives(q, zero, np.zeros(d.arm.n_joints))
    M = d.arm.mass_matrix(q)
    K, D = d.arm.stiffness_matrix(q), d.arm.damping_matrix()
    scale = np.sqrt(np.diag(M))
    pairs = [
        (by.q, -K, abs(K).max()),
        (by.qd, -D, abs(D).max() + 1e-9),
        (by.torque, np.eye(d.arm.dof)[:, d.arm.joint_index], 1.0),
    ]
    for jacobian, force, size in pairs:
        missed = (M @ jacobian - force) / scale[:, None]
        inertia = np.linalg.norm(scale[:, None] * jacobian)
        # Rounding of accelerations, times their inertia.
        assert np.linalg.norm(missed) <= 1e-10 * (inertia + size / scale.min())


def test_stiffness_by_gravity_depends_on_the_posture():
    d = changed(drawn(11, theory="second_order", rigid=False).arm, gravity=(0.0, -9.81))
    up, down = (d.rest([angle, *np.zeros(d.n_joints - 1)]) for angle in (np.pi / 2, -np.pi / 2))
    standing, hanging = d.stiffness_matrix(up), d.stiffness_matrix(down)
    assert np.linalg.eigvalsh(hanging)[0] > 0 > np.linalg.eigvalsh(standing)[0]
    assert np.all(np.diag(hanging) > np.diag(standing))  # by the weight, second order
