"""The rigid model at its tip, against formulas of a chain and the methods of the arm."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.control.design.rigid_model import TaskSpace
from flexarm.motion.geometry.inverse_kinematics import rigid_chain, tip_jacobian, tip_jacobian_rate

ROD = {"mass_per_length": 0.5, "flexural_rigidity": 30.0}


def arm_of(lengths, **more):
    links = [fa.Link(length=length, elements=1, **ROD) for length in lengths]
    return fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.02)] * len(lengths), **more)


ARMS = {
    "one": arm_of([0.8]),
    "two, hanging": arm_of([0.8, 0.6], gravity=(0.0, -9.81), payload=fa.Payload(mass=0.2)),
    "three": arm_of([0.8, 0.6, 0.5]),
    "bent": fa.Arm(
        links=[fa.Link(length=length, elements=1, **ROD) for length in (0.8, 0.3, 0.6)],
        joints=[
            fa.Joint(hub_inertia=0.02),
            fa.Joint(fixed=True, rest_angle=0.4),
            fa.Joint(hub_inertia=0.02),
        ],
    ),
}
every = pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)


def state_of(arm):
    rng = np.random.default_rng(3)
    return rng.uniform(-1.0, 1.0, arm.n_joints) + 0.3, rng.uniform(-2.0, 2.0, arm.n_joints)


@every
def test_kinematics_equal_those_of_a_chain(arm):
    angle, rate = state_of(arm)
    chain = rigid_chain(arm)
    for _ in range(2):  # a second evaluation does not depend on the first one
        position, velocity, bias = TaskSpace(arm).at(angle, rate).motion
        J = tip_jacobian(chain.lengths, angle + chain.offset)
        J_rate = tip_jacobian_rate(chain.lengths, angle + chain.offset, rate)
        found = TaskSpace(arm).at(angle, rate)
        # Rounding of sums of metres, and of rates up to a few per second squared.
        np.testing.assert_allclose(position, chain.tip(angle), atol=1e-14)
        np.testing.assert_allclose(found.jacobian, J, atol=1e-14)
        np.testing.assert_allclose(velocity, J @ rate, atol=1e-14)
        np.testing.assert_allclose(bias, J_rate @ rate, atol=1e-13)


@every
def test_dynamics_equal_those_of_the_rigid_arm(arm):
    angle, rate = state_of(arm)
    rigid = arm.rigid()
    found = TaskSpace(arm).at(angle, rate)
    q, qd = rigid.rest(angle), rigid.rest(rate) - rigid.rest(0.0 * rate)
    joints = rigid.joint_index
    M, h = rigid.mass_matrix(q), rigid.bias_force(q, qd)
    np.testing.assert_allclose(found.mass, M[np.ix_(joints, joints)], rtol=1e-13)
    np.testing.assert_allclose(found.bias_torque, h[joints], rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("name", ["two, hanging", "three", "bent"])
def test_torque_gives_the_wanted_tip_acceleration(name):
    """(F.1), by the forward dynamics of the rigid arm with the given force on the tip."""
    arm = ARMS[name]
    angle, rate = state_of(arm)
    task, rigid = TaskSpace(arm), arm.rigid()
    wanted, push = (1.5, -2.0), (3.0, 4.0)
    posture, added = np.linspace(0.5, -0.5, arm.n_joints), np.linspace(0.1, 0.3, arm.n_joints)
    state = task.at(angle, rate)
    torque = task.torque(state, wanted, push, posture, added) - added
    q, qd = rigid.rest(angle), rigid.rest(rate) - rigid.rest(0.0 * rate)
    # The surface reacts with the same force.
    found = rigid.forward_dynamics(q, qd, torque, tip_force=(-push[0], -push[1]))
    found = found[rigid.joint_index]
    # Accurate to the damping of the pseudo-inverse: a millionth of the trace of J J'.
    J = state.jacobian
    missing = np.array(wanted) - state.motion[2] - J @ posture
    damped = 1e-6 * np.trace(J @ J.T) / np.linalg.eigvalsh(J @ J.T)[0]
    off = J @ found + state.motion[2] - wanted
    assert np.linalg.norm(off) < 1.01 * damped * np.linalg.norm(missing)
    # The posture determines the motion that the tip leaves free.
    free = np.eye(arm.n_joints) - np.linalg.pinv(state.jacobian) @ state.jacobian
    np.testing.assert_allclose(free @ found, free @ posture, atol=1e-4)


def test_straight_arm_gives_bounded_torques():
    arm = arm_of([0.8, 0.6])
    task = TaskSpace(arm)
    still = np.zeros(2)
    torque = task.torque(task.at(still, still), (1.0, 1.0), (0.0, 0.0), still, still)
    assert np.all(np.isfinite(torque))
    assert abs(torque).max() < 10.0
