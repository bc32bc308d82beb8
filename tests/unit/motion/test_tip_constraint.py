"""The constraint of a flexible tip to its path: values, derivatives, and dependent joints."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.motion.dynamics.dynamics_along import TipConstraint, dynamics_along
from flexarm.simulation.inversion.torques import CorrectedTorque, spline_knots, spline_values


def an_arm(links):
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.6, "elements": 1}
    return fa.Arm(links=[fa.Link(length=0.8, **rod)] * links)


def a_motion(arm):
    n = arm.n_joints
    return fa.joint_motion(arm, [0.2, 0.6, 0.6][:n], [0.8, 0.9, 0.5][:n], 1.0)


def misses(constraint, t, q):
    still = np.zeros((1, q.size))
    along = dynamics_along(constraint.arm, q[None], still, still)
    value, by = constraint.misses(np.array([t]), q[None], along)
    return value[0], by[0]


@pytest.mark.parametrize("links", [1, 2, 3])
def test_values_and_derivatives(links):
    arm = an_arm(links)
    motion = a_motion(arm)
    constraint = TipConstraint(arm, motion)
    constraint.check()
    straight = arm.rest(motion.joint_angle(0.4))
    value, _ = misses(constraint, 0.4, straight)
    np.testing.assert_allclose(value, np.zeros(links), atol=1e-14)
    q = straight + 0.02 * np.random.default_rng(1).standard_normal(arm.dof)
    value, by = misses(constraint, 0.4, q)
    if links > 1:
        np.testing.assert_allclose(value[:2], arm.tip(q)[:2] - motion.tip(0.4), atol=1e-14)
    for j, unit in enumerate(np.eye(arm.dof)):
        # Differences of second order over 1e-5: 1e-10 of their own.
        up, down = (misses(constraint, 0.4, q + s * 1e-5 * unit)[0] for s in (1, -1))
        np.testing.assert_allclose(by[:, j], (up - down) / 2e-5, atol=1e-8)


def test_one_joint_of_three_follows_the_rigid_motion():
    """The pair of joints for which the tip's Jacobian is least singular determines the tip."""
    arm = an_arm(3)
    constraint = TipConstraint(arm, a_motion(arm))
    _, by = misses(constraint, 0.0, arm.rest([0.2, 0.6, 0.6]))
    led = [k for k, place in enumerate(arm.joint_index) if by[2, place] != 0.0]
    assert led == [1]


def test_corrected_torque_starts_and_ends_smoothly():
    arm = an_arm(2)
    rigid = fa.rigid_torque(arm, a_motion(arm))
    knots = spline_knots(-0.5, 1.5, 0.1)
    coefficients = np.random.default_rng(2).standard_normal((len(knots) - 4, 2))
    coefficients[:2], coefficients[-2:] = coefficients[0], coefficients[-1]
    torque = CorrectedTorque(rigid, knots, coefficients)
    np.testing.assert_allclose(torque(-2.0), coefficients[0])
    np.testing.assert_allclose(torque(9.0), coefficients[-1])
    step = 1e-6
    for end in (-0.5, 1.5):
        # Value and slope are continuous: the difference has second order in the step.
        assert np.abs(torque(end + step) - torque(end - step)).max() < 1e-8
    t = np.array([0.2, 0.7])
    np.testing.assert_allclose(torque(t) - rigid(t), spline_values(knots, t) @ coefficients)
