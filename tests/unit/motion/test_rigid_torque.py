"""Rigid torques along a motion: the published peaks, static parts, breaks and shapes."""

from dataclasses import dataclass

import numpy as np
import pytest
from motion_checks import Links, smooth_times

from flexarm.base.errors import InputError
from flexarm.motion import joint_motion, line_motion, rigid_torque

# Uniform rods in closed form: A = m1 L1^2 / 3 + m2 L1^2, B = m2 L2^2 / 3, C = m2 L1 L2 / 2.
A, B, C = 1.8166144527, 0.2057733333, 0.4365069720
MASS_PER_LENGTH = 0.61732


@dataclass
class TwoRods(Links):
    """The published two-link arm made rigid, as the textbook's double pendulum.

    In absolute angles a1, a2: A a1'' + C cos(a1 - a2) a2'' + C sin(a1 - a2) a2'^2 = tau1 - tau2
    and B a2'' + C cos(a1 - a2) a1'' - C sin(a1 - a2) a1'^2 = tau2, plus the weight along -y.
    """

    gravity: float = 0.0

    def rigid(self):
        return self

    def inverse_dynamics_many(self, q, qd, qdd):
        (a1, a2), (w1, w2), (e1, e2) = (np.cumsum(x, axis=1).T for x in (q, qd, qdd))
        l1, l2 = self.lengths
        m1, m2 = MASS_PER_LENGTH * self.lengths
        second = B * e2 + C * np.cos(a1 - a2) * e1 - C * np.sin(a1 - a2) * w1**2
        second = second + self.gravity * m2 / 2 * l2 * np.cos(a2)
        first = A * e1 + C * np.cos(a1 - a2) * e2 + C * np.sin(a1 - a2) * w2**2 + second
        first = first + self.gravity * (m1 / 2 + m2) * l1 * np.cos(a1)
        return np.stack([first, second], axis=1)


@pytest.fixture
def motion():
    return line_motion(Links(), [2.0, 1.0], [1.0, 2.0], 1.0)


def test_published_peaks(motion):
    torque = rigid_torque(TwoRods(), motion)(np.linspace(0.0, 1.0, 10001))
    # Printed to a hundredth.
    np.testing.assert_allclose(torque.max(axis=0), [11.21, 1.63], rtol=0, atol=5e-3)
    np.testing.assert_allclose(torque.min(axis=0), [-8.87, -1.90], rtol=0, atol=5e-3)


def test_twice_the_duration_needs_a_quarter_of_the_torque(motion):
    slow = line_motion(Links(), [2.0, 1.0], [1.0, 2.0], 2.0)
    t = np.linspace(0.0, 1.0, 101)
    np.testing.assert_allclose(
        rigid_torque(TwoRods(), slow)(2 * t),
        rigid_torque(TwoRods(), motion)(t) / 4,
        rtol=0,
        atol=1e-12,
    )


def test_zero_outside_the_motion_without_gravity(motion):
    torque = rigid_torque(TwoRods(), motion)
    assert np.all(torque([-np.inf, -1.0, 1.0, 1.5, np.inf]) == 0.0)


def test_torque_outside_the_motion_balances_gravity():
    motion = joint_motion(Links(), [0.0, 0.0], [np.pi / 2, 0.0], 1.0, start_time=1.0)
    torque = rigid_torque(TwoRods(gravity=9.81), motion)([0.0, 3.0])
    l1, l2 = Links().lengths
    m1, m2 = MASS_PER_LENGTH * Links().lengths
    elbow = 9.81 * m2 * l2 / 2
    shoulder = elbow + 9.81 * (m1 / 2 + m2) * l1
    np.testing.assert_allclose(torque, [[shoulder, elbow], [0.0, 0.0]], rtol=0, atol=1e-14)


def test_shapes_and_attributes(motion):
    torque = rigid_torque(TwoRods(), motion)
    t = np.linspace(-0.5, 1.5, 12)
    assert torque(t).shape == (12, 2)
    assert torque(0.3).shape == (2,)
    np.testing.assert_allclose(torque(t)[5], torque(t[5]), rtol=0, atol=1e-13)
    assert torque.joints == 2
    assert torque.breaks == motion.breaks == (0.0, 1.0)


def test_torque_jumps_at_breaks_only():
    motion = line_motion(Links(), [2.0, 1.0], [1.0, 2.0], 1.0, profile="trapezoidal")
    torque = rigid_torque(TwoRods(), motion)
    for time in torque.breaks:
        assert np.max(np.abs(torque(time) - torque(np.nextafter(time, -1.0)))) > 0.5
    t = smooth_times(torque.breaks, away=1e-6)
    # Between breaks the torque changes by less than 100 N m/s.
    assert np.max(np.abs(torque(t + 1e-7) - torque(t))) < 1e-5


def test_motion_of_another_arm_is_rejected():
    motion = joint_motion(Links((1.0, 1.0, 1.0)), [0, 0, 0], [1, 1, 1], 1.0)
    with pytest.raises(
        InputError, match=r"rigid_torque: motion must have the number of joints of the arm \(2\)"
    ):
        rigid_torque(TwoRods(), motion)
