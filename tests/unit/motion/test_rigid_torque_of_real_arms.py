"""Rigid torques with the package's arms: published peaks, and arms that follow their motion."""

import numpy as np
import pytest

from flexarm.arm.arm import Arm
from flexarm.model import Joint, Link, Payload
from flexarm.motion import joint_motion, line_motion, rigid_torque


def uniform_link(length):
    return Link(length=length, flexural_rigidity=105.0, mass_per_length=0.61732, elements=1)


@pytest.fixture(scope="module")
def published_arm():
    return Arm(links=[uniform_link(1.4142), uniform_link(1.0)])


@pytest.fixture(scope="module")
def heavy_arm():
    return Arm(
        links=[uniform_link(1.0), uniform_link(0.8), uniform_link(0.6)],
        joints=[Joint(hub_inertia=0.1), Joint(mass=1.5, damping=0.2), Joint(hub_inertia=0.02)],
        payload=Payload(mass=0.7, inertia=0.01, offset=(0.05, 0.02)),
        gravity=(0.0, -9.81),
    )


def test_published_peaks(published_arm):
    motion = line_motion(published_arm, [2.0, 1.0], [1.0, 2.0], 1.0)
    torque = rigid_torque(published_arm, motion)(np.linspace(0.0, 1.0, 10001))
    # Printed to a hundredth.
    np.testing.assert_allclose(torque.max(axis=0), [11.21, 1.63], rtol=0, atol=5e-3)
    np.testing.assert_allclose(torque.min(axis=0), [-8.87, -1.90], rtol=0, atol=5e-3)


def test_zero_outside_the_motion_without_gravity(published_arm):
    motion = line_motion(published_arm, [2.0, 1.0], [1.0, 2.0], 1.0)
    torque = rigid_torque(published_arm, motion)
    assert np.all(torque([-1.0, 1.0, 2.0]) == 0.0)


@pytest.mark.parametrize("profile", ["quintic", "trapezoidal"])
def test_rigid_model_has_the_accelerations_of_the_motion(heavy_arm, profile):
    motion = line_motion(heavy_arm, [1.6, 0.5], [0.4, 1.7], 1.2, profile=profile)
    torque = rigid_torque(heavy_arm, motion)
    rigid_counterpart = heavy_arm.rigid()
    for t in [-0.5, 0.0, 0.2, 0.7, 1.1, 1.2, 2.0]:
        state = motion.state(t)
        acceleration = rigid_counterpart.forward_dynamics(state.angle, state.rate, torque(t))
        # Rounding of torques of 50 N m over inertias of 0.02 kg m^2.
        np.testing.assert_allclose(acceleration, state.acceleration, rtol=0, atol=1e-10)


def test_torque_outside_the_motion_balances_gravity(heavy_arm):
    motion = joint_motion(heavy_arm, [0.2, 0.4, -0.3], [1.0, 0.0, 0.5], 1.0)
    torque = rigid_torque(heavy_arm, motion)
    still = np.zeros(3)
    for t, posture in [(-1.0, [0.2, 0.4, -0.3]), (5.0, [1.0, 0.0, 0.5])]:
        weight = heavy_arm.rigid().inverse_dynamics(posture, still, still)
        np.testing.assert_allclose(torque(t), weight, rtol=1e-14)
        assert np.min(np.abs(weight)) > 0.1


def test_tip_is_that_of_the_rigid_model(heavy_arm):
    motion = line_motion(heavy_arm, [1.6, 0.5], [0.4, 1.7], 1.2, elbow="down")
    for t in [0.0, 0.5, 1.2]:
        tip = heavy_arm.rigid().tip(motion.joint_angle(t))
        np.testing.assert_allclose(motion.tip(t), tip[:2], rtol=0, atol=1e-14)
