"""Passive torques of joints: spring, dry friction and stops, in forward and inverse dynamics."""

import numpy as np
import pytest
from hypothesis import given

import flexarm as fa
from arms import unit_link
from strategies import between

FRICTION = fa.Friction(coulomb=2.0, static=3.5, stribeck_rate=0.2, smoothing_rate=0.01)
STOPS = fa.JointLimits(lower=-0.5, upper=1.0, stiffness=400.0, damping=0.3)
rates = between(-50.0, 50.0)


def arm(**joint):
    """A rigid link of unit inertia on a joint."""
    return unit_link(joint)


def torque(of, angle, rate):
    """Return the passive torque of the joint, which is the acceleration of a unit inertia."""
    return float(of.forward_dynamics([angle], [rate], [0.0])[0])


def test_joint_without_springs_has_no_passive_torque():
    assert torque(arm(), 0.7, -3.0) == 0.0


def test_inverse_dynamics_has_the_same_torque():
    of = arm(damping=0.4, stiffness=5.0, rest_angle=0.2, friction=FRICTION, limits=STOPS)
    for angle in (-0.9, 0.1, 1.2):
        for rate in (-2.0, 0.0, 0.5):
            needed = of.inverse_dynamics([angle], [rate], [0.0])[0]
            assert needed == pytest.approx(-torque(of, angle, rate), rel=1e-14)


def test_spring_and_damper():
    of = arm(damping=0.4, stiffness=5.0, rest_angle=0.2)
    assert torque(of, 0.5, -3.0) == pytest.approx(-5.0 * 0.3 + 0.4 * 3.0, rel=1e-14)
    assert of.energy([0.5], [0.0]).strain == pytest.approx(5.0 * 0.3**2 / 2, rel=1e-14)
    assert of.stiffness_matrix([0.5])[0, 0] == 5.0
    assert of.damping_matrix()[0, 0] == 0.4


@pytest.mark.parametrize("rate", [0.003, 0.02, 0.1, 0.2, 0.5, 2.0, 40.0])
def test_friction_equals_its_formula(rate):
    level = 2.0 + 1.5 * np.exp(-((rate / 0.2) ** 2))
    of = arm(friction=FRICTION)
    expected = level * np.tanh(rate / 0.01)
    # 1e-12: near rest 1 - exp(-2x) loses a few digits of so small a number.
    assert torque(of, 0.3, rate) == pytest.approx(-expected, rel=1e-12)
    assert torque(of, 0.3, -rate) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("rate", [0.003, 0.02, 0.1, 0.5, 2.0, 40.0])
def test_friction_of_each_direction(rate):
    """Levels of both directions, and a smooth change between them over a tenth of the width."""
    both = {"coulomb": 2.0, "static": 3.5, "stribeck_rate": 0.2, "viscous": 0.4}
    of = arm(friction=fa.Friction(**both, coulomb_negative=1.2, viscous_negative=0.7))
    rise = 1.5 * np.exp(-((rate / 0.2) ** 2))
    for way in (1.0, -1.0):
        sign = np.tanh(way * rate / 0.02)
        level = 2.0 * (1 + sign) / 2 + 1.2 * (1 - sign) / 2 + rise
        viscous = 0.4 * (1 + sign) / 2 + 0.7 * (1 - sign) / 2
        expected = level * sign + viscous * way * rate
        assert torque(of, 0.3, way * rate) == pytest.approx(-expected, rel=1e-12)
    if rate > 0.2:  # ten smoothing rates: the other direction has a share of exp(-20)
        assert torque(of, 0.3, rate) == pytest.approx(-(2.0 + rise + 0.4 * rate), rel=1e-8)
        assert torque(of, 0.3, -rate) == pytest.approx(1.2 + rise + 0.7 * rate, rel=1e-8)


@pytest.mark.thorough
@given(rates, between(0.0, 3.0), between(0.0, 3.0))
def test_friction_of_any_two_directions_never_drives(rate, coulomb, viscous):
    friction = fa.Friction(
        coulomb=coulomb, viscous=viscous, coulomb_negative=3.0 - coulomb, viscous_negative=1.0
    )
    assert torque(arm(friction=friction), 0.0, rate) * rate <= 0.0


def test_friction_falls_from_its_peak_to_coulombs_level():
    """Stribeck: the maximum is slightly above the smoothing rate, then friction falls to its level
    in motion."""
    of = arm(friction=FRICTION)
    sweep = np.linspace(0.0, 1.0, 1001)
    friction = np.array([-torque(of, 0.0, rate) for rate in sweep])
    peak = int(np.argmax(friction))
    assert 0.01 < sweep[peak] < 0.05
    assert 3.4 < friction[peak] < 3.5
    assert np.all(np.diff(friction[:peak]) > 0.0)
    assert np.all(np.diff(friction[peak:]) <= 0.0)
    assert friction[-1] == pytest.approx(2.0, rel=1e-9)


def test_default_static_friction_is_coulombs():
    sweep = np.linspace(0.0, 1.0, 101)
    of = arm(friction=fa.Friction(coulomb=2.0))
    assert all(np.diff([-torque(of, 0.0, rate) for rate in sweep]) >= 0.0)


@given(rates)
def test_friction_never_accelerates(rate):
    power = torque(arm(friction=FRICTION), 0.0, rate) * rate
    assert power <= 0.0
    assert power >= -3.5 * abs(rate)


@given(between(-3.0, 3.0), rates)
def test_stop_torques_have_one_sign(angle, rate):
    of = arm(limits=STOPS)
    given_torque = torque(of, angle, rate)
    # The corner is rounded over 1e-9 rad: half of that, times the stiffness and the rise.
    rounding = 400.0 * 1e-9 * (1.0 + 0.3 * abs(rate))
    if angle < STOPS.lower:
        assert given_torque >= -rounding
    elif angle > STOPS.upper:
        assert given_torque <= rounding
    else:
        assert abs(given_torque) <= rounding


@pytest.mark.parametrize(
    ("angle", "rate", "expected"),
    [
        (1.25, 0.0, -100.0),
        (1.25, 2.0, -160.0),  # on the way in the torque is larger
        (1.25, -2.0, -40.0),
        (1.25, -4.0, 0.0),  # the joint leaves faster than the stop follows
        (-0.75, 0.0, 100.0),
        (-0.75, -2.0, 160.0),
        (-0.75, 4.0, 0.0),
        (0.99, 5.0, 0.0),
        (-0.49, -5.0, 0.0),
    ],
)
def test_stops_equal_their_formula(angle, rate, expected):
    # The roundings of both corners, 1e-9 rad and 1e-6 of the rise, at this stiffness.
    assert torque(arm(limits=STOPS), angle, rate) == pytest.approx(expected, abs=1e-4)


def test_stops_store_the_energy_of_their_springs():
    of = arm(limits=STOPS)
    assert of.energy([1.25], [0.0]).strain == pytest.approx(400.0 * 0.25**2 / 2, rel=1e-9)
    assert of.energy([-0.6], [0.0]).strain == pytest.approx(400.0 * 0.1**2 / 2, rel=1e-9)
    assert of.energy([0.5], [0.0]).strain == pytest.approx(0.0, abs=1e-12)
    assert of.stiffness_matrix([1.25])[0, 0] == pytest.approx(400.0, rel=1e-9)
    assert of.stiffness_matrix([0.5])[0, 0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("rate", [0.0, 1e-4, 0.05, 3.0, 10.0, 1e3, 1e6])
def test_derivatives_are_finite_and_correct_at_every_rate(rate):
    """The complex numbers for derivatives must not overflow far from rest."""
    of = arm(friction=FRICTION)
    slope = of.derivatives([0.0], [rate], [0.0]).qd[0, 0]
    step = max(1e-7, 1e-7 * rate)
    expected = (torque(of, 0.0, rate + step) - torque(of, 0.0, rate - step)) / (2 * step)
    # Central differences: truncation by (step / smoothing)^2, rounding by 1e-16 / step.
    assert slope == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_two_joints_have_separate_laws():
    link = fa.Link(length=1.0, mass_per_length=3.0, flexible=False)
    joints = [fa.Joint(stiffness=5.0, friction=FRICTION), fa.Joint(limits=STOPS, rest_angle=9.0)]
    of = fa.Arm(links=[link, link], joints=joints)
    needed = of.inverse_dynamics([0.3, 1.25], [2.0, 0.0], [0.0, 0.0])
    bare = fa.Arm(links=[link, link]).inverse_dynamics([0.3, 1.25], [2.0, 0.0], [0.0, 0.0])
    np.testing.assert_allclose(needed - bare, [5.0 * 0.3 + 2.0, 100.0], rtol=1e-9)
