"""Short features of functions of time are found by comparison, or given in ``breaks``."""

import numpy as np
import pytest

import flexarm as fa
from arms import unit_link
from flexarm.simulation.histories.piecewise import PiecewiseCubic, function_history, sampled_torque

#: Between two of the points that are evaluated first in runs of two seconds, 1.0031 and 1.0078.
ON, OFF = 1.0051, 1.0062
FINE = {"rtol": 1e-9, "atol": 1e-11}


class Pulse:
    """The given numbers between two times, and zeros before and after."""

    def __init__(self, row, on=ON, off=OFF, breaks=()):
        self.row, self.on, self.off, self.breaks = np.asarray(row), on, off, breaks

    def __call__(self, t):
        return self.row * (self.on <= t < self.off)


def ramp(pulse, end):
    """Return rate and angle at ``end``, s, after an acceleration pulse of a unit inertia."""
    rate = pulse.row[0] * (pulse.off - pulse.on)
    return rate, rate * (end - 0.5 * (pulse.on + pulse.off))


# Samples that end before the run -----------------------------------------------------------------


@pytest.mark.parametrize("interpolation", ["cubic", "linear", "hold"])
@pytest.mark.parametrize("rate", [10.0, 1000.0])
def test_last_sample_is_held_to_the_end(interpolation, rate):
    """A cubic beyond its last sample gave 17 N m from samples of 1 N m."""
    count = int(rate)
    samples = np.where(np.random.default_rng(3).uniform(-1, 1, count) < 0.0, -1.0, 1.0)
    samples[-3:] = 1.0, -1.0, 1.0
    history = sampled_torque(samples[:, None], rate, 1.0, 1, interpolation)
    after = np.linspace((count - 1) / rate, 1.0, 50)
    np.testing.assert_allclose(history.at(after), 1.0, rtol=0, atol=1e-12)
    result = fa.simulate(
        unit_link(), 1.0, torque=samples[:, None], rate=rate, torque_interpolation=interpolation
    )
    assert result.torque.values[-1, 0] == pytest.approx(1.0, abs=1e-12)


def test_spline_overshoots_its_samples_as_documented():
    """11 % at a jump; at most 1.55 times the largest sample, and 1.97 times near the ends.

    The last two are the largest sum of the absolute values of the splines through one sample.
    """
    times = np.linspace(0.0, 1.0 - 1 / 60, 5901)
    jump = np.repeat([[0.0], [1.0]], 30, axis=0)
    assert sampled_torque(jump, 60.0, 1.0, 1, "cubic").at(times).max() == pytest.approx(
        1.108, abs=1e-3
    )
    rng = np.random.default_rng(5)
    middle, ends = 0.0, 0.0
    for _ in range(200):
        samples = np.where(rng.uniform(-1, 1, 60) < 0.0, -1.0, 1.0)
        values = abs(sampled_torque(samples[:, None], 60.0, 1.0, 1, "cubic").at(times))
        middle = max(middle, values[1000:-1000].max())
        ends = max(ends, values.max())
    assert 1.4 < middle < 1.55
    assert 1.8 < ends < 1.98


def test_history_that_ends_before_the_run_is_held():
    line = PiecewiseCubic(
        np.array([0.0, 0.5]), np.array([[[0.0], [2.0], [0.0], [0.0]]]), np.zeros(0)
    )
    result = fa.simulate(unit_link(), 1.0, torque=line, **FINE)
    # 1 N m at 0.5 s: half of that until then, 1 N m afterwards.
    assert result.joint_rate.values[-1, 0] == pytest.approx(0.25 + 0.5, abs=1e-9)


# Breaks of functions -----------------------------------------------------------------------------


def shaken(**options):
    """Return the angle after a shock of the base, given as a table or as a function."""
    arm = fa.Arm(
        links=[fa.Link(length=1.0, elements=1, flexural_rigidity=105.0, mass_per_length=0.6)],
        joints=[fa.Joint(hub_inertia=0.1)],
    )
    return fa.simulate(arm, 2.0, rate=10.0, rtol=1e-6, **options).joint_angle.values[-1, 0]


@pytest.mark.parametrize("given_by", ["by the function", "by the call"])
def test_breaks_of_a_base_acceleration_are_used(given_by):
    """When they were ignored, the shock was missed."""
    table = ([ON, ON, OFF, OFF], [[0, 0], [0, 500], [0, 500], [0, 0]])
    known = (ON, OFF)
    if given_by == "by the function":
        found = shaken(base_acceleration=Pulse([0.0, 500.0], breaks=known))
    else:
        found = shaken(base_acceleration=Pulse([0.0, 500.0]), breaks=known)
    assert found == pytest.approx(shaken(base_acceleration=table), rel=1e-5)
    assert abs(found) > 0.1


@pytest.mark.parametrize("given_by", ["by the function", "by the call"])
@pytest.mark.parametrize("what", ["torque", "load", "prescribed"])
def test_breaks_of_every_function_of_time_are_used(what, given_by):
    """Features of a millisecond and less in two seconds, with samples every 0.1 s."""
    known = (ON, ON + 1e-3)
    pulse = Pulse([300.0], ON, ON + 1e-3, known if given_by == "by the function" else ())
    options = {} if given_by == "by the function" else {"breaks": known}
    rate, angle = ramp(pulse, 2.0)
    if what == "torque":
        options["torque"] = pulse
    elif what == "load":

        def factor(t):
            return float(pulse(t)[0])

        factor.breaks = pulse.breaks
        options["loads"] = [fa.Load(1, moment=1.0, factor=factor)]
    else:

        def acceleration(t):
            return float(pulse(t)[0])

        acceleration.breaks = pulse.breaks

        def speed(t):
            return rate * np.clip((t - ON) / 1e-3, 0.0, 1.0)

        def place(t):
            since = np.clip(t - ON, 0.0, 1e-3)
            return 150.0 * since**2 + rate * max(t - ON - 1e-3, 0.0)

        options["prescribed"] = {1: fa.PrescribedAngle(place, speed, acceleration)}
    result = fa.simulate(unit_link(), 2.0, rate=10.0, **options, **FINE)
    assert result.joint_angle.values[-1, 0] == pytest.approx(angle, abs=1e-8)


def test_breaks_of_an_added_torque_are_used():
    arm = unit_link()
    motion = fa.joint_motion(arm, [0.0], [0.0], 2.0)
    pulse = Pulse([300.0], ON, ON + 1e-3)
    result = fa.simulate_separated(
        arm, motion, added_torque=pulse, breaks=(ON, ON + 1e-3), rate=10.0, rtol=1e-6
    )
    assert result.joint_angle.values[-1, 0] == pytest.approx(ramp(pulse, 2.0)[1], rel=1e-5)


def test_breaks_of_a_plant_are_used():
    pulse = Pulse([0.0, 300.0], 0.203, 0.204)
    ends = []
    for options in (
        {"base_acceleration": pulse, "breaks": (0.203, 0.204)},
        {"base_acceleration": ([0.203, 0.203, 0.204, 0.204], [[0, 0], [0, 300], [0, 300], [0, 0]])},
    ):
        plant = fa.Plant(unit_link(), 0.1, duration=0.5, **options)
        for _ in range(5):
            plant.step([0.0])
        ends.append(plant.q[0])
    assert ends[0] == pytest.approx(ends[1], rel=1e-6)
    assert abs(ends[0]) > 0.01


# Features without breaks -------------------------------------------------------------------------


@pytest.mark.parametrize("on", np.random.default_rng(0).uniform(1.0, 5.0, 5))
def test_pulse_as_long_as_a_sample_is_found(on):
    """A millisecond in ten seconds was missed 39 times in 40."""
    pulse = Pulse([100.0], on, on + 1.001e-3)
    result = fa.simulate(unit_link(), 10.0, torque=pulse, rate=1000.0, **FINE)
    rate, angle = ramp(pulse, 10.0)
    assert result.joint_rate.values[-1, 0] == pytest.approx(rate, rel=1e-6)
    assert result.joint_angle.values[-1, 0] == pytest.approx(angle, rel=1e-6)


def test_train_of_pulses_is_followed():
    """Two hundred pulses of 2 ms; none is at the points that are evaluated first."""

    def torque(t):
        return [1.0 if (t % 0.01) < 0.002 else 0.0]

    result = fa.simulate(unit_link(), 2.0, torque=torque, **FINE)
    assert result.joint_rate.values[-1, 0] == pytest.approx(0.4, rel=1e-6)


def test_result_states_the_shortest_feature():
    arm = unit_link()
    function = fa.simulate(arm, 2.0, torque=lambda t: [np.sin(t)], rate=1000.0)
    assert function.shortest_feature == pytest.approx(1e-3, rel=1e-9)
    # At low rates the points of the cubics determine it: a quarter of a 64th of the run.
    coarse = fa.simulate(arm, 2.0, torque=lambda t: [np.sin(t)], rate=10.0)
    assert coarse.shortest_feature == pytest.approx(2.0 / 256.0, rel=1e-9)
    # A long run has 20 000 instants at most.
    long = function_history(lambda t: [0.0], 100.0, 1, 1e-9, spacing=1e-4)
    assert long.shortest_feature == pytest.approx(100.0 / 20_000, rel=1e-9)
    exact = fa.simulate(arm, 1.0, torque=np.ones((1001, 1)), rate=1000.0)
    assert exact.shortest_feature == 0.0
    loop = fa.simulate(arm, 0.01, controller=fa.JointPD(1.0, 1.0))
    assert loop.shortest_feature == 0.0
    load = fa.Load(1, moment=1.0, factor=lambda t: t)
    loaded = fa.simulate(arm, 1.0, loads=[load], prescribed={1: fa.PrescribedAngle.hold(0.0)})
    assert loaded.shortest_feature == pytest.approx(1e-3, rel=1e-9)


def test_breaks_shorten_the_resolved_features():
    """Pieces end at breaks, so that seven points lie between any two of them."""
    seen = []

    def torque(t):
        seen.append(t)
        return np.zeros(1)

    function_history(torque, 1.0, 1, 1e-9, breaks=(0.5001, 0.5002))
    inside = [t for t in seen if 0.5001 < t < 0.5002]
    assert len(inside) == 7


def test_comparison_does_not_change_an_accurate_history():
    def torque(t):
        return [np.sin(5.0 * t) if t < 0.7 else 2.0]

    plain = function_history(torque, 1.0, 1, 1e-9)
    compared = function_history(torque, 1.0, 1, 1e-9, spacing=1e-3)
    np.testing.assert_array_equal(plain.breaks, compared.breaks)
    np.testing.assert_array_equal(plain.coefficients, compared.coefficients)
    np.testing.assert_array_equal(plain.stops, compared.stops)
