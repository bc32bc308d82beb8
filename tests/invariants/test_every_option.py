"""Laws that hold for every arm, with random options."""

from dataclasses import replace

import numpy as np
import pytest

import flexarm as fa
from random_options import busy

SEEDS = range(1000, 1030)


def drawn(seed):
    """Draw an arm with all options except those that change its energy from outside."""
    b = busy(seed, theory=["linear", "second_order"][seed % 2])
    return replace(b, loads=[], tip_force=np.zeros(3), base_acceleration=np.zeros(2))


def lossless(arm):
    """Return the same arm without damping and friction."""
    links = [link.replace(damping=None) for link in arm.spec.links]
    joints = []
    for joint in arm.spec.joints:
        limits = joint.limits and joint.limits.replace(damping=0.0)
        joints.append(joint.replace(damping=0.0, friction=None, limits=limits, winding=None))
    return fa.Arm(arm.spec.replace(links=links, joints=joints))


@pytest.mark.parametrize("seed", SEEDS)
def test_mass_matrix_is_symmetric_positive_and_the_derivative_of_inverse_dynamics(seed):
    b = drawn(seed)
    M = b.arm.mass_matrix(b.q)
    scale = np.sqrt(np.outer(np.diag(M), np.diag(M)))
    assert np.max(abs(M - M.T) / scale) < 1e-14  # sums of the same terms in another order
    bias = b.arm.bias_force(b.q, b.qd)
    columns = [b.arm.inverse_dynamics(b.q, b.qd, unit) - bias for unit in np.eye(b.arm.dof)]
    # The bias is subtracted, which leaves rounding of its size; stiff modes make it large.
    slack = 1e-12 + 1e-15 * np.max(abs(bias)) / np.sqrt(np.diag(M).min())
    assert np.max(abs(np.array(columns) - M) / scale) < slack
    assert np.linalg.eigvalsh(M / scale).min() > 0.0


@pytest.mark.parametrize("seed", SEEDS)
def test_inverse_of_forward_dynamics_is_the_torque(seed):
    b = busy(seed, theory=["linear", "second_order"][seed % 2])
    acting = (b.tip_force, b.loads, b.base_acceleration)
    qdd = b.arm.forward_dynamics(b.q, b.qd, b.torque, *acting)
    force = b.arm.inverse_dynamics(b.q, b.qd, qdd, *acting)
    wanted = np.zeros(b.arm.dof)
    wanted[b.arm.joint_index] = b.torque
    M = b.arm.mass_matrix(b.q)
    # The terms are forces that cancel in the sum, times the rounding of the accelerations.
    size = abs(M) @ abs(qdd) + abs(b.arm.bias_force(b.q, b.qd)) + 10.0
    assert np.max(abs(force - wanted) / size) < 1e-11


@pytest.mark.parametrize("seed", SEEDS)
def test_energy_changes_by_motors_and_losses_only(seed):
    b = drawn(seed)
    qdd = b.arm.forward_dynamics(b.q, b.qd, b.torque)
    losses = b.arm.bias_force(b.q, b.qd) - lossless(b.arm).bias_force(b.q, b.qd)
    power = b.qd[b.arm.joint_index] @ b.torque - b.qd @ losses

    def total(t):
        q = b.q + t * b.qd + 0.5 * t * t * qdd
        return b.arm.energy(q, b.qd + t * qdd).total

    # Richardson extrapolation; the step is short compared with the period of the stiffest mode.
    h = 2e-3 / np.sqrt(b.arm.assembly.constants.w2.max(initial=1e3))
    first = (total(h) - total(-h)) / (2 * h)
    second = (total(2 * h) - total(-2 * h)) / (4 * h)
    rate = (4.0 * first - second) / 3.0
    scale = abs(b.qd[b.arm.joint_index]) @ abs(b.torque) + abs(b.qd @ losses)
    rounding = 1e-14 * abs(total(0.0)) / h
    # Inertial forces cancel; for the stiffest arm, whose mass matrix has a condition number of 4e8,
    # the recursion leaves 3e-12 of them.
    rounding += 2e-12 * abs(b.qd) @ abs(b.arm.mass_matrix(b.q)) @ abs(qdd)
    assert abs(rate - power) < 1e-5 * scale + rounding + 1e-9


@pytest.mark.parametrize("seed", SEEDS)
def test_exact_derivatives_equal_differences(seed):
    b = busy(seed, theory=["linear", "second_order"][seed % 2])
    acting = (b.tip_force, b.loads, b.base_acceleration)
    exact = b.arm.derivatives(b.q, b.qd, b.torque, *acting)
    rng = np.random.default_rng(seed)
    dq, dqd = rng.normal(size=(2, b.arm.dof)) * 1e-3
    dtorque = rng.normal(size=b.arm.n_joints)

    def moved(h):
        state = b.q + h * dq, b.qd + h * dqd
        return b.arm.forward_dynamics(*state, b.torque + h * dtorque, *acting)

    wanted = exact.q @ dq + exact.qd @ dqd + exact.torque @ dtorque
    errors = []
    for h in (1e-3, 1e-4, 1e-5):
        found = (8 * (moved(h) - moved(-h)) - (moved(2 * h) - moved(-2 * h))) / (12 * h)
        errors.append(np.linalg.norm(found - wanted))
    size = np.linalg.norm(moved(0.0)) + np.linalg.norm(wanted)
    # Differences have an error of a power of their step, plus rounding over the step; one of three
    # steps is suitable.
    assert min(errors) < 1e-7 * size
