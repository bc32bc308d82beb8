"""Every timing law runs from rest at 0 to rest at 1, with consistent derivatives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm.motion.timing import TIMING_LAWS, TimingLaw, quintic, timing_law, trapezoidal

LAWS = [*TIMING_LAWS.values(), trapezoidal(0.5), trapezoidal(0.01)]


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_runs_from_rest_to_rest(law):
    s, ds, dds = law([-np.inf, -1.0, 0.0, 1.0, 2.0, np.inf])
    assert s.tolist() == [0, 0, 0, 1, 1, 1]
    assert ds.tolist() == [0] * 6
    assert np.delete(dds, 2).tolist() == [0] * 5  # at u = 0 a ramp has an acceleration
    just_before = law(np.nextafter(1.0, 0.0))
    # Rounding: the quintic's coefficients have a sum of 31, and s'' is up to 101 (ramp 0.01).
    assert abs(just_before.s - 1.0) < 1e-14
    assert abs(just_before.ds) < 1e-13


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_derivatives_by_complex_step(law):
    step = 1e-30  # no cancellation: the error is the rounding of the polynomial
    piece = np.repeat(np.arange(len(law.coefficients)), 11)
    local = np.concatenate([np.linspace(0.0, width, 11) for width in np.diff(law.breaks)])
    value = law.on_pieces(piece, local + 1j * step)
    exact = law.on_pieces(piece, local)
    np.testing.assert_allclose(value.s.imag / step, exact.ds, rtol=0, atol=1e-13)
    np.testing.assert_allclose(value.ds.imag / step, exact.dds, rtol=1e-14, atol=1e-12)


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_path_fraction_covers_the_path_once(law):
    u = np.linspace(0.0, 1.0, 1001)
    s, ds, _ = law(u)
    assert np.all(np.diff(s) >= 0.0)
    # Trapezoidal rule on 1000 panels: error at most max|s'''| / 12e6 = 5e-6 for the quintic and, at
    # a kink between panels, max|s''| / 8e6 = 1.3e-5 for the short ramp.
    assert np.trapezoid(ds, u) == pytest.approx(1.0, abs=2e-5)


def test_quintic_equals_the_printed_one():
    u = np.linspace(0.0, 1.0, 101)
    s, ds, dds = quintic()(u)
    np.testing.assert_allclose(s, 10 * u**3 - 15 * u**4 + 6 * u**5, rtol=0, atol=1e-14)
    np.testing.assert_allclose(ds, 30 * u**2 * (1 - u) ** 2, rtol=0, atol=1e-13)
    np.testing.assert_allclose(dds, 60 * u * (1 - u) * (1 - 2 * u), rtol=0, atol=1e-12)


@settings(deadline=None)
@given(st.floats(1e-6, 0.5))
def test_trapezoid_has_constant_rate_between_its_ramps(ramp):
    law = trapezoidal(ramp)
    assert law.breaks[1] == ramp
    top = law(np.array([ramp, 0.5, 1.0 - ramp])).ds
    np.testing.assert_allclose(top, 1.0 / (1.0 - ramp), rtol=1e-9)  # 1 - ramp rounds, over ramp
    assert law(0.5).s == pytest.approx(0.5, abs=1e-15)


def test_acceleration_at_a_break_is_that_of_the_following_piece():
    law = trapezoidal(0.25)
    _, _, dds = law(np.array(law.breaks))
    height = 1.0 / (0.75 * 0.25)
    np.testing.assert_allclose(dds, [height, 0.0, -height, 0.0], rtol=1e-15)


def test_law_of_a_user_is_accepted():
    cubic = TimingLaw("cubic", (0.0, 1.0), ((0.0, 0.0, 3.0, -2.0),))
    assert timing_law(cubic) is cubic
    assert cubic(0.5).s == 0.5
