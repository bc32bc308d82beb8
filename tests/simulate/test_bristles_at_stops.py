"""Friction with bristles at stops, contacts, events and changes, compared with SciPy."""

import numpy as np
import pytest

import flexarm as fa
from bristled_joints import NUMBERS, lugre, turning

#: Stiffness (N m/rad or N/m) and damping (s/rad or s/m) of the stops and of the wall.
STIFFNESS, DAMPING = 500.0, 0.5
#: Range of the joint, rad, and distance of the wall, m.
REACH = 0.1


def alternating(t):
    return np.sin(2.0 * np.pi * t)


def pressed(depth, rate):
    """The law of Hunt and Crossley for both, at a depth and its rate."""
    return STIFFNESS * max(depth, 0.0) * max(1.0 + DAMPING * rate, 0.0)


def by_stops(angle, rate):
    return pressed(-REACH - angle, -rate) - pressed(angle - REACH, rate)


def by_wall(angle, rate):
    """The torque of a wall above the link, which has a length of 1 m."""
    lever = np.cos(angle)
    return -pressed(np.sin(angle) - REACH, lever * rate) * lever


STOPS = {"lower": -REACH, "upper": REACH, "stiffness": STIFFNESS, "damping": DAMPING}
WALL = fa.Contact(fa.Wall((0.0, REACH), (0.0, -1.0)), STIFFNESS, damping=DAMPING)
#: The arm, the arguments of a run and the torque of the obstacle.
OBSTACLES = {
    "stops": (lambda: turning(limits=fa.JointLimits(**STOPS)), {}, by_stops),
    "contact": (turning, {"contacts": [WALL]}, by_wall),
}


@pytest.mark.parametrize("name", OBSTACLES)
def test_impacts(name):
    """The joint slides into the obstacle, is pressed against it and leaves it."""
    make, acting, push = OBSTACLES[name]
    result = fa.simulate(make(), 1.0, torque=lambda t: [alternating(t)], rate=1000.0, **acting)
    angle, rate, z = lugre(alternating, result.time.values, push=push)
    assert angle.max() > REACH + 0.01
    assert (np.diff(angle > REACH) != 0).sum() >= 2
    # The default tolerance of 1e-7 of the angle in each step; an impact multiplies earlier errors.
    np.testing.assert_allclose(result.joint_angle.values[:, 0], angle, rtol=0, atol=1e-6)
    np.testing.assert_allclose(result.joint_rate.values[:, 0], rate, rtol=0, atol=2e-5)
    np.testing.assert_allclose(result.bristle_deflection.values[:, 0], z, rtol=0, atol=1e-7)


def test_event_and_change_of_a_sliding_joint():
    """The joint slides when an event changes its friction, and continues with its deflection."""
    later = {**NUMBERS, "coulomb": 0.3, "bristle_stiffness": 8000.0}
    keys = "coulomb", "bristle_stiffness"
    changes = [fa.Change(f"joints[0].friction.{key}", at="passed", to=later[key]) for key in keys]
    arm = turning()
    result = fa.simulate(
        arm, 1.0, torque=lambda t: [alternating(t)], rate=1000.0,
        events=[fa.joint_event(arm, 1, 0.2, name="passed")], changes=changes,
    )  # fmt: skip
    at, times = result.event_time.values[0], result.time.values
    rows = times < at
    before = lugre(alternating, np.append(times[rows], at))
    assert before[0, -1] == pytest.approx(0.2, abs=1e-6)
    assert abs(before[1, -1]) > 1.0
    after = lugre(alternating, np.append(at, times[~rows]), numbers=later, start=before[:, -1])
    angle, rate, z = np.hstack([before[:, :-1], after[:, 1:]])
    # As above. A change without effect on the state of the bristles causes 3e-3 rad.
    np.testing.assert_allclose(result.joint_angle.values[:, 0], angle, rtol=0, atol=1e-6)
    np.testing.assert_allclose(result.joint_rate.values[:, 0], rate, rtol=0, atol=2e-5)
    np.testing.assert_allclose(result.bristle_deflection.values[:, 0], z, rtol=0, atol=1e-7)
