"""Optimal motions against closed forms: bang-bang torques, and least squared torque."""

import numpy as np
import pytest
from scipy.optimize import fsolve

import flexarm as fa
from arms import chain

#: Time-optimal torques of two masses and a spring, all 1, for a move by 1 with forces up to 1:
#: Q. Liu and B. Wie, Robust time-optimal control of uncertain flexible spacecraft, J. Guidance,
#: Control, and Dynamics 15 (1992) 597-604. They switch at these times and end at the last.
LIU_WIE = (1.003, 2.109, 3.215, 4.218)
BAR = {"length": 1.0, "flexible": False}


def rod(**kwargs):
    """Return a hub with a flexible rod of one mode, and a payload."""
    link = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "modes": 1}
    return chain([1.0], [0.1], payload=0.2, **link, **kwargs)


def switches(motion):
    """Return the times at which the torque changes its sign."""
    samples = np.linspace(0.0, motion.duration, 4000, endpoint=False)
    return samples[1:][np.diff(np.sign(motion.torque(samples)[:, 0])) != 0.0]


def test_rigid_link_accelerates_and_brakes_with_the_largest_torque():
    arm = fa.Arm(links=[fa.Link(mass_per_length=3.0, **BAR)])
    motion = fa.optimal_motion(arm, [0.2], [1.2], limits=fa.MotionLimits(torque=2.0))
    # J theta = tau T^2 / 4 with J = 1. The switch is on a node, and IPOPT's tolerance is 1e-7.
    assert motion.duration == pytest.approx(2.0 * np.sqrt(1.0 / 2.0), rel=1e-6)
    assert switches(motion) == pytest.approx([motion.duration / 2.0], abs=1e-3)
    np.testing.assert_allclose(motion.joint_angle([0.0, 9.0]).ravel(), [0.2, 1.2], atol=1e-12)


@pytest.mark.thorough
def test_two_masses_and_a_spring_equal_the_published_switching_times():
    rotors = fa.Joint(hub_inertia=1.0, rotor_inertia=1.0, stiffness=1.0)
    arm = fa.Arm(links=[fa.Link(mass_per_length=1e-9, **BAR)], joints=[rotors])
    motion = fa.optimal_motion(arm, [0.0], [1.0], limits=fa.MotionLimits(torque=1.0), intervals=80)
    # A switch within an interval, here of 0.053 s, costs 2e-5 of the duration.
    assert motion.duration == pytest.approx(LIU_WIE[-1], rel=1e-3)
    assert switches(motion) == pytest.approx(LIU_WIE[:-1], abs=motion.duration / 80)
    assert motion.remaining.residual_vibration < 1e-8


def test_flexible_link_has_the_duration_of_the_bang_bang_torque_of_its_mode():
    """For small angles; J. Z. Ben-Asher, J. A. Burns and E. M. Cliff, J. Guidance, Control, and
    Dynamics 15 (1992) 360-367.

    From its middle on, the torque is positive for a, then negative up to the end at b. The mode
    remains at rest if 1 - 2 cos(w a) + cos(w b) = 0, and J theta = tau (b^2 - 2 a^2).
    """
    arm, theta, torque = rod(), 0.02, 0.5
    w = 2.0 * np.pi * fa.modes(arm, joints="free").frequency_hz[-1]
    rigid = arm.rigid()
    least = 2.0 * np.sqrt(rigid.mass_matrix([0.0])[0, 0] * theta / torque)

    def missing(ab):
        a, b = ab
        return [
            1.0 - 2.0 * np.cos(w * a) + np.cos(w * b),
            (b**2 - 2.0 * a**2) / (0.25 * least**2) - 1.0,
        ]

    a, b = fsolve(missing, [0.2 * least, 0.55 * least])
    assert 0.0 < a < b
    np.testing.assert_allclose(missing([a, b]), 0.0, atol=1e-9)
    limits = fa.MotionLimits(torque=torque)
    motion = fa.optimal_motion(arm, [0.0], [theta], limits=limits)
    # 40 intervals; second-order terms of 0.02 rad are below 1e-4.
    assert motion.duration == pytest.approx(2.0 * b, rel=1e-3)
    fast = fa.optimal_motion(rigid, [0.0], [theta], limits=limits, plant=arm)
    assert fast.duration == pytest.approx(least, rel=1e-6)
    assert fast.remaining.residual_vibration > 1e-3
    assert motion.remaining.residual_vibration < 1e-5 * fast.remaining.residual_vibration


def test_least_squared_torque_of_a_rigid_link_is_linear_in_time():
    """J theta = 1 and T = 2: 6 J theta / T^2 at the start, minus that at the end."""
    arm = fa.Arm(links=[fa.Link(mass_per_length=3.0, **BAR)])
    motion = fa.optimal_motion(arm, [0.0], [1.0], "energy", duration=2.0)
    middle = (np.arange(40) + 0.5) / 40
    # Constant in each interval, the optimum follows the line at the middles to 1 / N^2.
    np.testing.assert_allclose(
        motion.torque(2.0 * middle)[:, 0], 1.5 * (1.0 - 2.0 * middle), atol=2e-3
    )
