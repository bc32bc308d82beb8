"""Predicted readings of sensors and their derivatives, against differences of ``Arm.tip``."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from arms import chain
from flexarm.control.filters.predicted_readings import PredictedReadings
from flexarm.linear.step_derivatives.sampled_step import FreeParameters

ANGLE = fa.Instrument("joint_angle", noise=1e-4)
POINTS = [
    fa.Sensor("position", 2),
    fa.Sensor("velocity", 2),
    fa.Sensor("acceleration", 2),
    fa.Sensor("acceleration", 2, frame="link"),
]
TORQUE = np.array([1.5, -0.8])


def arm_with(payload=0.3):
    rod = {"flexural_rigidity": [40.0, 20.0], "mass_per_length": [0.5, 0.4], "modes": [1, None]}
    joints = [{"hub_inertia": 0.05, "damping": 0.1}, {"mass": 0.2, "hub_inertia": 0.02}]
    more = {"gravity": (0.0, -9.81), "theory": "second_order", "elements": 1}
    payload = fa.Payload(mass=payload, inertia=0.01, offset=(0.05, 0.02))
    return chain((1.0, 0.7), joints, payload=payload, **rod, **more)


def state_of(arm):
    q = arm.from_nodal([0.4, -0.8], [[[0.01, 0.02]], [[0.006, 0.012]]])
    qd = arm.from_nodal([1.2, -0.7], [[[0.05, 0.1]], [[-0.04, -0.05]]])
    return np.concatenate([q, qd])


def predicted(arm, x, torque=TORQUE, change=0.0):
    """Return readings of the four points and the joints, with their derivatives."""
    instruments = [*(fa.Instrument(point, noise=1e-3) for point in POINTS), ANGLE]
    readings = PredictedReadings(arm, instruments)
    return readings.predict(x, torque, FreeParameters(arm, ["payload.mass"]).at(np.array([change])))


@pytest.fixture(scope="module")
def arm():
    return arm_with()


@pytest.fixture(scope="module")
def x(arm):
    return state_of(arm)


def test_values_equal_the_motion_of_the_tip(arm, x):
    """The tip along q + t qd + t^2 qdd / 2, by central differences of fourth order."""
    q, qd = x.reshape(2, -1)
    qdd = arm.forward_dynamics(q, qd, TORQUE)
    step = 1e-3
    times = step * np.arange(-2, 3)
    path = np.array([arm.tip(q + t * qd + t**2 / 2 * qdd)[:2] for t in times])
    velocity = np.array([1, -8, 0, 8, -1]) @ path / (12 * step)
    acceleration = np.array([-1, 16, -30, 16, -1]) @ path / (12 * step**2)
    found = predicted(arm, x).values
    np.testing.assert_allclose(found[0:2], path[2], rtol=0, atol=1e-13)
    # Truncation: step^4 times the fifth and sixth derivatives of a motion of a few rad/s.
    np.testing.assert_allclose(found[2:4], velocity, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found[4:6], acceleration, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(found[8:], arm.joint_angles(q))
    # The accelerometer on the link turns with it and reads gravity too.
    assert np.hypot(*found[6:8]) == pytest.approx(np.hypot(*(found[4:6] - [0.0, -9.81])), rel=1e-12)


def test_derivatives_by_the_state_are_limits_of_differences(arm, x):
    by = predicted(arm, x).state
    for k in range(x.size):
        step = 1e-5 * np.eye(x.size)[k]  # accelerations of 10 m/s^2 to 1e-13: 1e-7 over the step
        slope = (predicted(arm, x + step).values - predicted(arm, x - step).values) / 2e-5
        np.testing.assert_allclose(by[:, k], slope, rtol=1e-5, atol=1e-5 * abs(slope).max())


def test_derivatives_by_the_torque_equal_differences(arm, x):
    """Accelerations are linear in it, so the size of the difference does not matter."""
    by = predicted(arm, x).torque
    for joint in range(2):
        more = predicted(arm, x, TORQUE + 2.0 * np.eye(2)[joint]).values
        change = (more - predicted(arm, x).values) / 2.0
        np.testing.assert_allclose(by[:, joint], change, rtol=1e-10, atol=1e-10)
        assert abs(by[4:6, joint]).max() > 0.1
        assert not by[:4, joint].any()


def test_derivative_by_the_payload_equals_differences_of_arms(arm, x):
    by = predicted(arm, x).parameters[:, 0]
    step = 1e-4
    heavy, light = (predicted(arm_with(0.3 + s), x).values for s in (step, -step))
    np.testing.assert_allclose(by, (heavy - light) / (2 * step), rtol=1e-6, atol=1e-6)
    assert abs(by[4:6]).max() > 0.1
    # The same by ``change``, the mass that a filter has estimated.
    np.testing.assert_allclose(predicted(arm, x, change=step).values, heavy, rtol=1e-11)
