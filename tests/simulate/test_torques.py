"""Torques as samples, with each interpolation, and as functions of time."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

import flexarm as fa
from arms import unit_link
from constant_torques import parabolas
from flexarm.simulation.histories.piecewise import (
    PiecewiseCubic,
    find_kinks,
    function_history,
    sampled_torque,
)
from strategies import between


def end_of(result):
    return result.joint_angle.values[-1, 0], result.joint_rate.values[-1, 0]


# Samples -----------------------------------------------------------------------------------------

RNG = np.random.default_rng(3)
SAMPLES = RNG.normal(size=(41, 2))
RATE = 40.0


def test_hold_keeps_each_sample_until_the_next():
    history = sampled_torque(SAMPLES, RATE, 1.0, 2, "hold")
    times = np.array([0.0, 0.01, 0.024999, 0.025, 0.03, 0.999, 1.0])
    index = [0, 0, 0, 1, 1, 39, 40]
    np.testing.assert_array_equal(history.at(times), SAMPLES[index])
    np.testing.assert_allclose(history.stops, np.arange(1, 41) / RATE, rtol=1e-15)


def test_hold_stops_only_where_the_torque_changes():
    samples = np.repeat([[1.0], [2.0]], [10, 11], axis=0)
    history = sampled_torque(samples, 20.0, 1.0, 1, "hold")
    np.testing.assert_array_equal(history.stops, [0.5])


def test_linear_interpolates_the_samples():
    history = sampled_torque(SAMPLES, RATE, 1.0, 2, "linear")
    times = np.linspace(0.0, 1.0, 333)
    wanted = [np.interp(times, np.arange(41) / RATE, column) for column in SAMPLES.T]
    np.testing.assert_allclose(history.at(times), np.transpose(wanted), rtol=0, atol=1e-13)


def test_linear_stops_only_at_bends():
    ramp = np.minimum(np.arange(21.0), 12.0)[:, None]
    history = sampled_torque(ramp, 20.0, 1.0, 1, "linear")
    np.testing.assert_array_equal(history.stops, [12 / 20])


def test_cubic_is_the_spline_of_smooth_samples():
    times = np.arange(101) / 100.0
    samples = np.stack([np.sin(7 * times), np.exp(-times)], axis=1)
    history = sampled_torque(samples, 100.0, 1.0, 2, "cubic")
    fine = np.linspace(0.0, 1.0, 777)
    np.testing.assert_allclose(
        history.at(fine), CubicSpline(times, samples)(fine), rtol=0, atol=1e-13
    )
    # h^4/384 of the fourth derivative, and more near the ends.
    exact = np.stack([np.sin(7 * fine), np.exp(-fine)], axis=1)
    np.testing.assert_allclose(history.at(fine), exact, rtol=0, atol=1e-6)
    assert history.stops.size == 0


def test_cubic_passes_every_sample_and_extends_beyond_the_last():
    history = sampled_torque(SAMPLES, RATE, 1.0, 2, "cubic")
    np.testing.assert_allclose(history.at(np.arange(41) / RATE), SAMPLES, rtol=0, atol=1e-12)
    shorter = sampled_torque(SAMPLES[:40], RATE, 1.0, 2, "cubic")
    assert np.all(np.isfinite(shorter.at(np.array([1.0]))))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
def test_few_samples(count, interpolation):
    samples = SAMPLES[:count]
    history = sampled_torque(samples, float(count), 1.0, 2, interpolation)
    times = np.arange(count) / count
    np.testing.assert_allclose(history.at(times), samples, rtol=0, atol=1e-12)


@settings(max_examples=60)
@given(st.integers(3, 96), st.integers(3, 96), between(0.5, 20.0), between(-30, 30))
def test_kinks_are_found_at_their_times_only(first, second, frequency, slope):
    """Smooth samples with a bend at two of them, twenty times as sharp as the curvature."""
    times = np.arange(100) / 1000.0
    assume(abs(first - second) > 4 and abs(slope) > 20.0 * frequency**2 / 1000.0 + 1e-3)
    bends = np.maximum(times - times[first], 0.0) + np.maximum(times - times[second], 0.0)
    samples = np.sin(frequency * times) + slope * bends
    np.testing.assert_array_equal(find_kinks(samples[:, None]), sorted([first, second]))
    assert find_kinks(np.sin(frequency * times)[:, None]).size == 0
    assert find_kinks(np.zeros((100, 1))).size == 0


def test_spline_does_not_oscillate_at_a_kink():
    """A triangle, divided at its corner, consists of two straight lines."""
    times = np.arange(201) / 200.0
    samples = (1.0 - 2.0 * abs(times - 0.5))[:, None]
    history = sampled_torque(samples, 200.0, 1.0, 1, "cubic")
    np.testing.assert_array_equal(history.stops, [0.5])
    fine = np.linspace(0.0, 1.0, 1999)
    np.testing.assert_allclose(
        history.at(fine)[:, 0], 1.0 - 2.0 * abs(fine - 0.5), rtol=0, atol=1e-13
    )


@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
def test_run_integrates_its_samples(interpolation):
    """Rate and angle of a unit inertia: first and second integral of the interpolation."""
    samples = np.cumsum(SAMPLES[:, :1], axis=0)
    history = sampled_torque(samples, RATE, 1.0, 1, interpolation)
    result = fa.simulate(
        unit_link(),
        1.0,
        torque=samples,
        rate=RATE,
        torque_interpolation=interpolation,
        rtol=1e-10,
        atol=1e-12,
    )
    np.testing.assert_allclose(result.torque.values, samples, rtol=0, atol=1e-11)
    node, weight = np.polynomial.legendre.leggauss(4)
    starts = np.arange(40) / RATE
    points = starts[:, None] + (node + 1) / 2 / RATE
    values = history.at(points.ravel()).reshape(points.shape)
    rate = values @ weight / 2 / RATE
    # A random walk in cubic pieces is rough, and the integrator does not stop at every knot.
    close = 1e-6 if interpolation == "cubic" else 1e-11
    assert result.joint_rate.values[-1, 0] == pytest.approx(rate.sum(), abs=close)
    angle = ((1.0 - points) * values) @ weight / 2 / RATE
    assert result.joint_angle.values[-1, 0] == pytest.approx(angle.sum(), abs=close)


# Functions of time -------------------------------------------------------------------------------


@pytest.mark.thorough
@settings(max_examples=30)
@given(
    st.lists(between(0.001, 0.999), min_size=1, max_size=4),
    st.lists(between(-5.0, 5.0), min_size=5, max_size=5),
    st.booleans(),
)
def test_jumps_at_irregular_times(places, values, closed):
    """A function with jumps at any times, of either sign, is as accurate as with given breaks."""
    edges = np.concatenate([[0.0], np.sort(places), [1.0]])
    assume(np.all(np.diff(edges[1:-1]) > 1 / 30))  # closer ones need ``breaks``
    # A jump below the tolerance of the run is no jump for it.
    values = np.round(values[: len(edges) - 1], 3)
    side = "left" if closed else "right"

    def torque(t):
        return [values[np.searchsorted(edges[1:-1], t, side=side)]]

    result = fa.simulate(unit_link(), 1.0, torque=torque, rate=10.0)
    # The jump is located to 1e-12 of the duration; the rest is rounding.
    np.testing.assert_allclose(end_of(result), parabolas(edges, values, 1.0), rtol=0, atol=2e-11)


@pytest.mark.parametrize("place", [1.0, 0.5, 1 / 3, 1 / 64, 0.1, 1e-9, 1.0 - 1e-9])
@pytest.mark.parametrize("closed", [True, False])
def test_jumps_at_special_times(place, closed):
    """At ends of its own pieces, at samples, and near the ends."""

    def torque(t):
        return [1.0 if (t <= place if closed else t < place) else -2.0]

    result = fa.simulate(unit_link(), 1.0, torque=torque, rate=10.0)
    wanted = parabolas([0.0, place, 1.0], [1.0, -2.0], 1.0)
    np.testing.assert_allclose(end_of(result), wanted, rtol=0, atol=2e-11)


def test_close_jumps_are_given_by_breaks():
    class Pulse:
        """One for a ten thousandth of a second."""

        breaks = (0.70001, 0.70011)

        def __call__(self, t):
            return [1e4 if 0.70001 <= t < 0.70011 else 0.0]

    result = fa.simulate(unit_link(), 1.0, torque=Pulse(), rate=10.0)
    np.testing.assert_allclose(
        end_of(result), parabolas([0.0, 0.70001, 0.70011, 1.0], [0.0, 1e4, 0.0], 1.0), atol=1e-9
    )


class Sine:
    """sin(frequency t + phase), for one time or for many."""

    vectorized = True

    def __init__(self, frequency, phase):
        self.frequency, self.phase = frequency, phase

    def __call__(self, times):
        return np.sin(self.frequency * times + self.phase)[..., None]


@pytest.mark.thorough
@settings(max_examples=20)
@given(between(1.0, 300.0), between(-3.0, 3.0))
def test_smooth_functions_are_interpolated_to_the_runs_tolerance(frequency, phase):
    torque = Sine(frequency, phase)
    history = function_history(torque, 1.0, 1, 1e-9)
    times = np.linspace(0.0, 1.0, 1001)
    exact = np.sin(frequency * times + phase)
    # Tested at three points of each piece: between them the error of a cubic is hardly larger.
    np.testing.assert_allclose(history.at(times)[:, 0], exact, rtol=0, atol=3e-9)
    assert history.stops.size == 0
    result = fa.simulate(unit_link(), 1.0, torque=torque, rate=10.0)
    rate = (np.cos(phase) - np.cos(frequency + phase)) / frequency
    # The run's tolerance per step, 1e-9 of the rate and more.
    assert result.joint_rate.values[-1, 0] == pytest.approx(rate, abs=1e-7)


def test_vectorized_function_is_called_once_for_many_times():
    calls = []

    class Vectorized:
        vectorized = True

        def __call__(self, times):
            calls.append(np.shape(times))
            return np.stack([np.sin(times), np.cos(times)], axis=1)

    history = function_history(Vectorized(), 2.0, 2, 1e-8)
    assert len(calls) < 30
    assert all(len(shape) == 1 for shape in calls)
    plain = function_history(lambda t: [np.sin(t), np.cos(t)], 2.0, 2, 1e-8)
    times = np.linspace(0, 2, 50)
    np.testing.assert_allclose(history.at(times), plain.at(times), rtol=0, atol=1e-14)


@pytest.mark.parametrize("row", [np.zeros(1), [0.0]], ids=["array", "list"])
def test_function_may_return_the_same_row_object_each_time(row):
    def torque(t):
        row[0] = np.sin(t)
        return row

    history = function_history(torque, 1.0, 1, 1e-9)
    plain = function_history(lambda t: (np.sin(t),), 1.0, 1, 1e-9)
    times = np.linspace(0.0, 1.0, 50)
    np.testing.assert_array_equal(history.at(times), plain.at(times))


def test_masked_row_among_arrays_is_rejected():
    def torque(t):
        return np.ma.masked_array([1.0], mask=[t > 0.5])

    with pytest.raises(fa.InputError, match=r"torque\(.*is a masked array"):
        fa.simulate(unit_link(), 1.0, torque=torque)


def test_wrong_value_before_a_failure_is_reported_first():
    def torque(t):
        if t > 0.6:
            raise ArithmeticError("too late")
        return (1.0,) if t < 0.3 else (np.nan,)

    with pytest.raises(fa.InputError, match=r"torque\(0\.3\d*\)\[0\] must be finite"):
        fa.simulate(unit_link(), 1.0, torque=torque)


def test_torque_history_and_constant():
    history = sampled_torque(SAMPLES[:, :1], RATE, 1.0, 1, "linear")
    direct = fa.simulate(unit_link(), 1.0, torque=history)
    again = fa.simulate(
        unit_link(), 1.0, torque=SAMPLES[:, :1], rate=RATE, torque_interpolation="linear"
    )
    assert end_of(direct) == pytest.approx(end_of(again), abs=1e-12)
    steady = fa.simulate(unit_link(), 1.0, torque=PiecewiseCubic.constant(np.array([2.0])))
    np.testing.assert_allclose(end_of(steady), [1.0, 2.0], rtol=1e-13)
    free = fa.simulate(unit_link(), 1.0, initial_rate=[0.5])
    np.testing.assert_allclose(end_of(free), [0.5, 0.5], rtol=1e-13)


def test_constant_tip_force():
    """A force with a constant direction on a rotating link: the energy equals its work."""
    arm = unit_link()
    result = fa.simulate(arm, 1.0, tip_force=(2.0, -1.0, 0.3), rtol=1e-11, atol=1e-13)
    tip = result.tip.values
    work = (tip - tip[0]) @ [2.0, -1.0] + 0.3 * (result.tip_angle.values - 0.0)
    np.testing.assert_allclose(result.kinetic_energy.values, work, rtol=0, atol=1e-10)
    with pytest.raises(fa.InputError, match="tip_force"):
        fa.simulate(arm, 1.0, tip_force=[1.0])


@pytest.mark.parametrize("place", [0.4, 0.42])
def test_breaks_divide_the_cubic_through_samples(place):
    """``find_kinks`` takes the small bend for curvature: a cubic across it would oscillate."""
    rate, times = 20.0, np.arange(21) / 20.0

    def bent(t):
        return np.sin(3.0 * t) + 3.0 * np.maximum(t - 0.4, 0.0)

    fine = np.linspace(0.0, 1.0, 2001)
    errors = [
        np.abs(
            sampled_torque(bent(times)[:, None], rate, 1.0, 1, "cubic", given).at(fine)[:, 0]
            - bent(fine)
        )
        for given in ((), (place,))
    ]
    near = (fine > 0.4) & (fine < 0.45)
    assert errors[1][~near].max() < 0.1 * errors[0][~near].max()
    # Between two samples a straight line has an error of h^2 / 8 times the curvature.
    assert errors[1][near].max() < (1e-4 if place == 0.4 else 9.0 * 0.05**2 / 8)


def tone(t):
    """Return a torque of 33 kHz, N m."""
    return 2.0 * np.sin(2.0 * np.pi * 33e3 * np.asarray(t))[..., None]


tone.vectorized = True


def test_fast_vibration_is_not_taken_for_noise():
    """A sine of 1650 periods requires more cubics than noise may have."""
    history = function_history(tone, 0.05, 1, 1e-7)
    times = np.random.default_rng(0).uniform(0.0, 0.05, 1000)
    # The tested points have errors below 1e-9 of the largest value, those between at most tenfold.
    np.testing.assert_allclose(history.at(times), tone(times), atol=2e-8)
    assert not history.stops.size


def test_vibration_with_too_many_periods_is_refused(monkeypatch):
    monkeypatch.setattr("flexarm.simulation.histories.piecewise._MOST_OF_SMOOTH", 60_000)
    with pytest.raises(fa.InputError, match=r"vary less over the run.*Shorten the run"):
        function_history(tone, 0.05, 1, 1e-7)


@pytest.mark.parametrize("smooth", [0.0, 1.0])
def test_noise_as_a_function_of_time_is_refused(smooth):
    random = np.random.default_rng(0)

    def torque(t):
        noise = 1e-3 * random.standard_normal(np.shape(t))
        return (noise + smooth * np.sin(2.0 * np.pi * 5e3 * np.asarray(t)))[..., None]

    torque.vectorized = True
    with pytest.raises(fa.InputError, match="give noise as samples at a rate"):
        function_history(torque, 0.05, 1, 1e-7)
