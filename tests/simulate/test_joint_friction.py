"""Dry friction over time: a link that slows down, and one that creeps instead of sticking."""

import numpy as np
import pytest

import flexarm as fa
from arms import table_one_arm
from flexarm.model.paths import number_at, with_number

INERTIA = 2.0 / 3.0  # of a rod of 2 kg and 1 m about its end


def arm(gravity=(0.0, 0.0), **friction):
    link = fa.Link(length=1.0, mass_per_length=2.0, flexible=False)
    joint = fa.Joint(friction=fa.Friction(**friction))
    return fa.Arm(links=[link], joints=[joint], gravity=gravity)


def test_coulomb_friction_gives_a_constant_deceleration():
    of = arm(coulomb=1.5)
    result = fa.simulate(of, 2.0, initial_rate=[3.0], rate=100)
    t, rate = result.time.values, result.joint_rate.values[:, 0]
    stop = 3.0 * INERTIA / 1.5  # s
    moving = t < stop - 0.1
    # Until it creeps: below ten times the smoothing rate friction is less than Coulomb's level.
    np.testing.assert_allclose(rate[moving], 3.0 - 1.5 / INERTIA * t[moving], rtol=1e-6)
    assert abs(rate[t > stop + 0.1]).max() < 0.01
    assert np.all(np.diff(rate) < 1e-6)  # and never turns back, except for the integrator's error


def test_work_of_friction_is_the_lost_energy():
    of = arm(coulomb=1.0, static=1.8, stribeck_rate=0.3, gravity=(0.0, -9.81))
    result = fa.simulate(of, 1.5, initial=[0.5], rate=2000, rtol=1e-9)
    energy = (result.kinetic_energy + result.gravity_energy).values
    rate = result.joint_rate.values[:, 0]
    # Friction is the joint's torque on its link, because the motor torque is zero.
    power = result.joint_moment.values[:, 0] * rate
    assert np.all(power <= 1e-12)
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * 5e-4)])
    # The trapezoidal rule at 2 kHz, across reversals of a few milliseconds.
    np.testing.assert_allclose(energy - energy[0], work, rtol=0, atol=2e-3 * abs(work[-1]))
    assert work[-1] < -1.0


@pytest.mark.parametrize("part", [0.2, 0.6, 0.95])
def test_joint_creeps_below_static_friction(part):
    """At the settled rate the formula balances the torque; it is too small to be visible."""
    of = arm(coulomb=1.0, static=2.0, stribeck_rate=0.5, smoothing_rate=1e-3)
    torque = part * 2.0
    result = fa.simulate(of, 0.05, torque=lambda t: [torque], rate=1000)
    settled = result.joint_rate.values[-1, 0]
    # Stribeck's term reduces the static level by a part in 1e5 at so low a rate.
    assert settled == pytest.approx(1e-3 * np.arctanh(part), rel=1e-3)


def test_joint_slides_above_static_friction():
    of = arm(coulomb=1.0, static=2.0, stribeck_rate=0.5, smoothing_rate=1e-3)
    result = fa.simulate(of, 4.0, torque=lambda t: [2.1], rate=100)
    rate = result.joint_rate.values[:, 0]
    # A sliding joint has Coulomb's level.
    slope = np.diff(rate)[-50:] * 100
    np.testing.assert_allclose(slope, (2.1 - 1.0) / INERTIA, rtol=1e-4)


def test_sticking_joint_clamps_a_flexible_link():
    """Static friction exceeds the torque of the vibration: clamped frequency, to a part."""
    link = fa.Link(length=1.0, flexural_rigidity=20.0, mass_per_length=0.5, elements=4)
    stuck = fa.Joint(hub_inertia=0.05, friction=fa.Friction(coulomb=5.0, smoothing_rate=1e-3))
    of = fa.Arm(links=[link], joints=[stuck])
    start = of.rest([0.0])
    start[1] = 0.005
    result = fa.simulate(of, 1.0, initial=start, rate=4000)
    bend = result.link_tip_deflection.values[:, 0]
    crossings = np.flatnonzero(np.diff(np.sign(bend)))
    period = 2 * np.diff(result.time.values[crossings]).mean()
    clamped = fa.modes(of).frequency_hz[0]
    assert 1.0 / period == pytest.approx(clamped, rel=2e-3)


def rubbing_rods(smoothing_rate, **rubbing):
    """Two flexible rods on heavy hubs with friction, and their torque."""
    friction = fa.Friction(coulomb=0.5, smoothing_rate=smoothing_rate, **rubbing)
    return table_one_arm(joints=[fa.Joint(hub_inertia=0.05, friction=friction)] * 2)


def strokes(of, **settings):
    """Simulate torques that move both joints and then let them stick."""
    return fa.simulate(
        of,
        0.3,
        torque=lambda t: np.array([4.0, 1.5]) * np.sin(8.0 * np.pi * t) * (t < 0.25),
        breaks=[0.25],
        rate=200.0,
        **settings,
    )


@pytest.mark.sampled("rubbing0")
@pytest.mark.compiled
@pytest.mark.parametrize("rubbing", [{}, {"static": 0.8, "coulomb_negative": 0.3, "viscous": 0.1}])
def test_steep_friction_is_implicit(rubbing):
    """The explicit method must follow the settling of a sticking joint, the implicit one not."""
    of = rubbing_rods(1e-3, **rubbing)
    explicit, chosen = (strokes(of, integrator=name) for name in ("dormand_prince_8", "auto"))
    assert chosen.integrator == "kennedy_carpenter_5"
    assert "friction implicit" in chosen.integrator_reason
    assert chosen.evaluations < 0.3 * explicit.evaluations
    # The tip error of the default tolerances.
    np.testing.assert_allclose(chosen.tip, explicit.tip, rtol=0, atol=1e-6 * 2.4142)


@pytest.mark.thorough
@pytest.mark.compiled
def test_evaluations_hardly_depend_on_the_smoothing_rate():
    """Those of an explicit method are inversely proportional to it.

    Below, the rate errors that ``rtol`` permits exceed the smoothing rate: the slope at the start
    of a step is then that of a sliding joint, and the steps become short without it.
    """
    few, many = (strokes(rubbing_rods(rate)).evaluations for rate in (1e-2, 1e-4))
    assert many < 3.0 * few
    limit = rubbing_rods(1e-6)
    with pytest.warns(fa.AccuracyWarning, match=r"joints\[0\]\.friction\.smoothing_rate \(1e-06"):
        loose = strokes(limit, rtol=1e-7)
    tight = strokes(limit, rtol=1e-8, atol=1e-10)
    assert tight.evaluations < 12.0 * few
    assert tight.evaluations < 0.3 * loose.evaluations


@pytest.mark.thorough
@pytest.mark.compiled
def test_sensitivities_through_steep_friction_equal_differences():
    """Both joints stick, slide and turn back at a smoothing rate of 0.001 rad/s."""
    of, path = rubbing_rods(1e-3), "joints[{}].friction.coulomb"
    how = {"torque": lambda t: np.array([4.0, 1.5]) * np.sin(8.0 * np.pi * t), "rate": 100.0}
    paths = [path.format(0), path.format(1), "links[0].flexural_rigidity"]
    found = fa.sensitivities(of, 0.15, paths, channels=["tip", "joint_angle"], **how)
    assert found.attrs["integrator"] == "kennedy_carpenter_5"
    exact = how | {"integrator": "kennedy_carpenter_5", "rtol": 1e-11, "atol": 1e-13}
    for k, name in enumerate(paths):
        value = number_at("path", of.spec, name)
        more, less = (
            fa.simulate(fa.Arm(with_number(of.spec, name, factor * value)), 0.15, **exact)
            for factor in (1.0 + 1e-4, 1.0 - 1e-4)
        )
        for channel in ("tip", "joint_angle"):
            wanted = (more[channel] - less[channel]).values / (2e-4 * value)
            # Observed: 7e-5, the error of the default tolerances; that of differences is 1e-6.
            error = np.abs(found[channel].values[k] - wanted).max()
            assert error < 3e-4 * np.abs(wanted).max(), (name, channel)


@pytest.mark.compiled
def test_friction_of_slow_motion_is_treated_as_damping():
    """Far below the smoothing rate friction is linear, so both runs take the same steps."""
    rod = fa.Link(length=1.0, flexural_rigidity=20.0, mass_per_length=0.5, modes=2)
    friction = fa.Friction(
        coulomb=3e4, coulomb_negative=1e4, static=3.5e4, stribeck_rate=1e3, smoothing_rate=10.0,
        viscous=400.0, viscous_negative=200.0,
    )  # fmt: skip
    slope = (2e4 + 5e3) / 10.0 + 300.0  # at rest, both directions have the same share
    drive = {"torque": lambda t: [np.sin(20.0 * t)], "rate": 100.0}
    rubs, damped = (
        fa.simulate(
            fa.Arm(links=[rod], joints=[joint]), 0.5, integrator="kennedy_carpenter_5", **drive
        )
        for joint in (fa.Joint(friction=friction), fa.Joint(damping=slope))
    )
    assert rubs.evaluations == pytest.approx(damped.evaluations, rel=0.02)
    # The rate is below 4e-4 rad/s: the directions differ by 1e-5 of the friction.
    np.testing.assert_allclose(rubs.tip, damped.tip, rtol=0, atol=1e-8)
