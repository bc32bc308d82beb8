"""Stops over time: impacts without loss, and with Hunt and Crossley's loss in closed form.

With I w' = -k p (1 + c w), p' = w, the rate w over the penetration p obeys w dw / (1 + c w) = -(k /
I) p dp. In at v and out at -u, both at p = 0: c v - ln(1 + c v) = -c u - ln(1 - c u).
"""

import sys
import warnings

import numpy as np
import pytest
from scipy.optimize import brentq

import flexarm as fa
from arms import soft_rod

INERTIA = 1.0  # of a rod of 3 kg and 1 m about its end
STIFFNESS = 2e3


def arm(damping=0.0, flexible=False, **joint):
    limits = fa.JointLimits(lower=-0.5, upper=0.5, stiffness=STIFFNESS, damping=damping)
    link = fa.Link(
        length=1.0,
        mass_per_length=3.0,
        flexible=flexible,
        flexural_rigidity=60.0 if flexible else None,
    )
    return fa.Arm(links=[link], joints=[fa.Joint(limits=limits, **joint)])


def blow(of, rate):
    """Return angle and rate, 1 kHz, of an arm that hits its upper stop."""
    soon_after = 0.5 / abs(rate) + 0.15
    result = fa.simulate(of, soon_after, initial_rate=[rate], rate=1000, rtol=1e-9, atol=1e-11)
    return result.joint_angle.values[:, 0], result.joint_rate.values[:, 0]


def rebound(damping, rate):
    """Return the rate (> 0) at which a rigid arm leaves a stop after contact at ``rate``."""
    taken = damping * rate - np.log1p(damping * rate)
    return brentq(
        lambda u: -damping * u - np.log1p(-damping * u) - taken, 0.0, (1.0 - 1e-12) / damping
    )


@pytest.mark.parametrize("rate", [3.0, -3.0])
def test_impact_without_damping_conserves_energy(rate):
    angle, rates = blow(arm(), rate)
    assert abs(angle).max() == pytest.approx(0.5 + 3.0 * np.sqrt(INERTIA / STIFFNESS), rel=1e-4)
    # The corner is rounded over 1e-9 rad, and conservative: only the integrator's error remains.
    assert rates[-1] == pytest.approx(-rate, rel=1e-7)
    assert np.all(np.sign(rate) * np.diff(rates) <= 1e-9)


@pytest.mark.parametrize("damping", [0.05, 0.2, 1.0])
@pytest.mark.parametrize("rate", [1.5, 4.0])
def test_restitution_of_hunt_and_crossley(damping, rate):
    _, rates = blow(arm(damping), rate)
    # Across the corner, 1e-9 rad wide, the integrator loses a few digits.
    assert -rates[-1] == pytest.approx(rebound(damping, rate), rel=1e-5)


def test_restitution_falls_with_damping_and_with_speed():
    def restitution(damping, rate):
        return -blow(arm(damping), rate)[1][-1] / rate

    by_damping = [restitution(damping, 3.0) for damping in (0.01, 0.1, 0.3, 1.0)]
    assert np.all(np.diff(by_damping) < 0.0)
    by_rate = [restitution(0.2, rate) for rate in (1.5, 3.0, 6.0)]
    assert np.all(np.diff(by_rate) < 0.0)
    # For small losses 1 - 2/3 c v.
    assert restitution(0.01, 3.0) == pytest.approx(1.0 - 2 / 3 * 0.03, rel=1e-3)


def test_stop_force_is_never_negative():
    """Also where a motor pulls the arm off the stop faster than the stop springs back."""
    of = arm(1.0, stiffness=0.0)
    result = fa.simulate(
        of,
        0.3,
        torque=lambda t: [-400.0 * (t > 0.02)],
        initial=[0.45],
        initial_rate=[4.0],
        rate=5000,
    )
    pushed = result.joint_moment.values[:, 0] - result.torque.values[:, 0]
    upper = result.joint_angle.values[:, 0] > 0.0
    # Rounding of the corner, of the subtracted torques, and 1e-6 of the rise.
    assert pushed[upper].max() < 1e-3
    assert pushed[~upper].min() > -1e-3
    assert pushed.min() < -50.0
    released = upper & (result.joint_angle.values[:, 0] > 0.5) & (abs(pushed) < 1e-3)
    assert released.sum() >= 2  # the case occurs


@pytest.mark.thorough
def test_flexible_arm_between_two_stops_conserves_energy():
    """Over many impacts the sum of bending, stop and kinetic energy is constant."""
    of = arm(flexible=True)
    start = of.rest([0.0])
    rates = np.zeros(of.dof)
    rates[0] = 1.2
    result = fa.simulate(of, 3.0, initial=start, initial_rate=rates, rate=1000, rtol=1e-10)
    energy = (result.kinetic_energy + result.strain_energy).values
    assert np.ptp(result.joint_angle.values) > 1.0
    assert np.ptp(result.strain_energy.values) > 0.2 * energy[0]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


@pytest.mark.thorough
def test_damped_arm_comes_to_rest_at_its_stop():
    limits = fa.JointLimits(lower=-0.5, upper=0.5, stiffness=STIFFNESS, damping=2.0)
    link = fa.Link(length=1.0, mass_per_length=3.0, flexible=False)
    of = fa.Arm(links=[link], joints=[fa.Joint(limits=limits, damping=20.0)], gravity=(0.0, -9.81))
    result = fa.simulate(of, 5.0, rate=100)
    rest = fa.equilibrium(of, [-0.5], torque=[0.0]).q[0]
    assert result.joint_angle.values[-1, 0] == pytest.approx(rest, abs=1e-6)
    assert rest < -0.5


def bouncing(friction=None):
    """Return a soft light rod that a torque pushes against its stop: six impacts in 2 s."""
    limits = fa.JointLimits(lower=-0.5, upper=0.5, stiffness=1e4, damping=0.1)
    return soft_rod(limits=limits, friction=friction)


def pushed(of, **settings):
    return fa.simulate(of, 2.0, torque=lambda t: [1.0], rate=500.0, **settings)


def test_default_settings_are_accurate_over_six_impacts():
    """1e-6 of the reach; the impacts amplify errors by 5e5, and the error once was 9 mm."""
    exact = pushed(bouncing(), rtol=1e-13, atol=1e-15)
    inside = np.diff((np.abs(exact.joint_angle.values[:, 0]) > 0.5).astype(int)) > 0
    assert inside.sum() == 6
    result = pushed(bouncing())
    assert np.linalg.norm((result.tip - exact.tip).values, axis=1).max() < 1e-6
    assert result.rtol == 1e-12
    assert result.warning == ""


def changing(t):
    return 1.0 + 0.3 * np.sin(9.0 * t)


def test_loads_are_interpolated_as_accurately_as_the_second_run_requires():
    """Impacts amplify errors of the load as those of the steps: once it was 8e-6 m."""
    changing = fa.Load(
        link=1, station=0.3, force=(0.0, 1.5), factor=lambda t: 1.0 + 0.3 * np.sin(9.0 * t)
    )
    settings = {"loads": [changing], "rate": 500.0}
    exact = fa.simulate(bouncing(), 2.0, rtol=1e-13, atol=1e-15, **settings)
    inside = np.diff((np.abs(exact.joint_angle.values[:, 0]) > 0.5).astype(int)) > 0
    assert inside.sum() == 4
    result = fa.simulate(bouncing(), 2.0, **settings)
    assert np.linalg.norm((result.tip - exact.tip).values, axis=1).max() < 1e-6
    assert result.rtol == 1e-12
    assert result.warning == ""


@pytest.mark.parametrize("name", ["dormand_prince_8", "kennedy_carpenter_5"])
def test_steps_end_at_the_corner_of_a_stop(name):
    """A rigid arm without loss amplifies no errors, so the tolerance determines the error."""
    for rtol in (1e-6, 1e-8):
        result = fa.simulate(
            arm(), 0.4, initial_rate=[3.0], rate=1000, integrator=name, rtol=rtol, atol=rtol / 100
        )
        # A few steps follow the impact; without their ends at the corner the error is 20 times as
        # large.
        assert result.joint_rate.values[-1, 0] == pytest.approx(-3.0, rel=15.0 * rtol)


def doubtful(result, exact, allowed):
    """Return whether a result has a warning; assert that it has one if its error is too large."""
    error = np.linalg.norm((result.tip - exact.tip).values, axis=1).max()
    warned = "impacts on joint stops amplify errors" in result.warning
    assert warned or error <= allowed, f"{error:.1e} m without a warning"
    return warned


@pytest.fixture(scope="module")
def exact_bounces():
    return pushed(bouncing(), rtol=1e-13, atol=1e-15)


@pytest.mark.sampled("dormand_prince_8")
@pytest.mark.parametrize("name", ["dormand_prince_8", "kennedy_carpenter_5"])
def test_errors_through_impacts_fall_with_any_tolerance(name, exact_bounces):
    """At one repetition for the default tolerances alone, rtol = 1e-8 once erred by 3e-4 m."""
    for rtol in (1e-3, 1e-5, 1e-8, 1e-10, 1e-12):
        result = pushed(bouncing(), integrator=name, rtol=rtol, atol=rtol / 100)
        # Ten times the relative tolerance is the promise, 1e-5 of the reach is not visible.
        assert not doubtful(result, exact_bounces, max(10.0 * rtol, 1e-5))


@pytest.mark.sampled("1e-13")
@pytest.mark.parametrize("rtol", [1e-5, 1e-7, 1e-9, 1e-13])
def test_motion_that_no_tolerance_determines_gives_a_warning(rtol):
    """After 3.5 s, rounding errors are amplified to centimetres, so no tolerance helps."""
    settings = {"torque": lambda t: [1.0], "rate": 500.0, "rtol": rtol, "atol": rtol / 100}
    with pytest.warns(fa.AccuracyWarning, match="Do not rely on this result after that time"):
        result = fa.simulate(bouncing(), 3.5, **settings)
    begin = float(result.warning.partition("from t = ")[2].partition(" s")[0])
    assert 1.0 < begin < 3.5


def test_fixed_steps_through_impacts_are_compared_with_half_the_step(exact_bounces):
    for step in (1e-3, 1e-4):
        with pytest.warns(fa.AccuracyWarning, match="use a shorter step or integrator='auto'"):
            assert doubtful(pushed(bouncing(), step=step), exact_bounces, 1e-3)
    calm = fa.simulate(arm(), 0.1, initial_rate=[1.0], step=1e-4)  # meets no stop
    assert (calm.warning, calm.evaluations) == ("", 4001)


@pytest.mark.sampled("1e-07-True")
@pytest.mark.parametrize(("rtol", "warns"), [(1e-7, True), (1e-12, False)])
def test_errors_of_closed_loops_through_impacts_are_estimated(rtol, warns):
    """A loop is executed again at another tolerance, and its result remains."""
    controller = fa.JointPD(0.0, 0.0, feedforward=lambda t: [1.0])
    settings = {"controller": controller, "rate": 500.0}
    exact = fa.simulate(bouncing(), 2.5, rtol=1e-13, atol=1e-15, **settings)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = fa.simulate(bouncing(), 2.5, rtol=rtol, atol=rtol / 100, **settings)
    assert doubtful(result, exact, 1e-5) is warns
    assert len(caught) == warns
    assert result.rtol == rtol


@pytest.mark.parametrize(("share", "warns"), [(0.9e-5, False), (1.1e-5, True)])
def test_warning_begins_at_a_hundred_thousandth_of_the_reach(share, warns, monkeypatch):
    limits = fa.JointLimits(lower=-0.04, upper=0.04, stiffness=STIFFNESS)
    links = [fa.Link(length=2.0, mass_per_length=1.0, flexible=False)]
    long = fa.Arm(links=links, joints=[fa.Joint(limits=limits)])
    module = sys.modules["flexarm.simulation.run.impacts"]
    monkeypatch.setattr(module, "_error_of_finer", lambda apart, *_: np.full(len(apart), share))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = fa.simulate(long, 0.1, initial_rate=[1.0])
    assert result.impact_steps > 0
    assert [str(one.message).startswith("impacts on joint stops") for one in caught] == (
        [True] if warns else []
    )


def test_events_of_a_second_run_are_reported_once():
    stop = fa.joint_event(bouncing(), 1, "upper", direction=1)
    end = fa.joint_event(bouncing(), 1, -0.2, direction=-1, terminal=True, name="back")
    result = pushed(bouncing(), events=[stop, end])
    exact = pushed(bouncing(), events=[stop, end], rtol=1e-13, atol=1e-15)
    assert result.event_name.values.tolist() == exact.event_name.values.tolist()
    assert result.ended_by == exact.ended_by
    np.testing.assert_allclose(result.event_time, exact.event_time, rtol=0, atol=1e-6)
    assert result.sizes["time"] == exact.sizes["time"]


def test_closed_loop_reports_steps_with_impacts():
    """Its result keeps the requested tolerance."""
    controller = fa.JointPD(0.0, 0.0, feedforward=lambda t: [1.0])
    loop = fa.simulate(bouncing(), 0.5, controller=controller, rate=500.0)
    assert loop.impact_steps >= 1
    assert loop.rtol == 1e-7
    assert fa.simulate(arm(), 0.05, initial_rate=[1.0]).impact_steps == 0
