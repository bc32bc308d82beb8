"""Filters of records: their responses, and the same effect on measured and simulated values."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.identification.record import Path, coefficients

RATE = 2000.0
TIMES = np.arange(2001) / RATE
ALL = np.ones(TIMES.size, dtype=bool)


def through(item, values):
    return Path(TIMES, ALL, 0.0, [item]).measured(values)


@pytest.mark.parametrize("order", [1, 2])
def test_step_response_is_that_of_the_continuous_filter(order):
    step = (TIMES > 0.1).astype(float)
    found = through(fa.Filter("low_pass", cutoff=10.0, order=order), step)
    w, late = 2 * np.pi * 10.0, np.maximum(TIMES - 0.1 - 0.5 / RATE, 0.0)
    exact = 1.0 - np.exp(-w * late)
    if order == 2:
        a = w / np.sqrt(2.0)
        exact = 1.0 - np.exp(-a * late) * (np.cos(a * late) + np.sin(a * late))
    # The step lies between two samples, and Tustin's rule has second order.
    assert np.abs(found - exact).max() < 0.5 * w / RATE
    high = through(fa.Filter("high_pass", cutoff=10.0, order=1), step)
    low = through(fa.Filter("low_pass", cutoff=10.0, order=1), step)
    np.testing.assert_allclose(high + low, step, atol=1e-12)


@pytest.mark.parametrize("kind", ["low_pass", "high_pass"])
@pytest.mark.parametrize("order", [1, 2])
def test_amplitude_at_the_cutoff_frequency(kind, order):
    from scipy.signal import freqz

    item = fa.Filter(kind, cutoff=20.0, order=order)
    _, response = freqz(*coefficients(item, RATE), worN=[20.0], fs=RATE)
    # Tustin's rule shifts the cutoff frequency by (w T)^2 / 12.
    assert np.abs(response[0]) == pytest.approx(np.sqrt(0.5), rel=1e-3)


def test_gain_and_mean():
    values = 3.0 + np.sin(TIMES)
    np.testing.assert_allclose(through(fa.Filter("gain", factor=2.0), values), 2.0 * values)
    assert through(fa.Filter("remove_mean"), values).mean() == pytest.approx(0.0, abs=1e-12)


def test_recorded_filters_and_delays_act_on_simulated_values_only():
    values = np.sin(2 * np.pi * 3.0 * TIMES)
    recorded = fa.Filter("low_pass", cutoff=5.0, recorded=True)
    path = Path(TIMES, ALL, 0.01, [recorded])
    np.testing.assert_array_equal(path.measured(values), values)
    late = np.where(TIMES < 0.01, 0.0, np.sin(2 * np.pi * 3.0 * (TIMES - 0.01)))
    wanted = through(fa.Filter("low_pass", cutoff=5.0), late)
    # Cubic interpolation at this rate; the kink at 0.01 s lies on a sample.
    np.testing.assert_allclose(path.simulated(values[:, None])[:, 0], wanted, atol=1e-9)


def test_values_with_gaps_are_treated_alike():
    values = np.sin(40.0 * TIMES)
    valid = (TIMES < 0.4) | (TIMES > 0.47)
    filters = [fa.Filter("high_pass", cutoff=3.0, order=2), fa.Filter("remove_mean")]
    path = Path(TIMES, valid, 0.0, filters)
    measured = path.measured(np.where(valid, values, 1e6))
    np.testing.assert_allclose(measured, path.simulated(values[:, None])[:, 0], atol=1e-12)
    assert np.abs(measured).max() < 2.0
