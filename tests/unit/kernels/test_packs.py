"""Packs of eight numbers: every operation is that of single numbers, to the last bit."""

import math

import numpy as np
import pytest

from flexarm.kernels.compilation.cache import compiled, merged
from flexarm.kernels.compilation.numbers import cos, exp, sin, sqrt, tanh
from flexarm.kernels.compilation.packs import LANES, Packs

pytestmark = pytest.mark.compiled
#: Results of ``operations``.
COUNT = 12


@merged
def operations(x, y, row, results):
    results[row, 0] = x + y - 2.0 * x
    results[row, 1] = (1.0 - x) / (3.0 + y * y)
    results[row, 2] = max(x, y) + max(0.0, x)
    results[row, 3] = abs(-y) * 7
    results[row, 4] = sqrt(abs(x))
    results[row, 5] = exp(-x * x)
    results[row, 6] = tanh(y)
    results[row, 7] = sin(x)
    results[row, 8] = cos(x)
    total = 0.0
    for k in range(3):
        total += k * x * y
    results[row, 9] = total
    total -= x
    total *= y
    total /= 3.0
    results[row, 10] = total
    results[row, 11] = 4.0


@compiled
def over_rows(x, y, results, rows):
    for row in range(rows):
        operations(x[row], y[row], row, results)


def numbers(seed, size):
    return np.random.default_rng(seed).normal(size=(20, LANES)) * size


@pytest.mark.parametrize("size", [1.0, 1e-3, 30.0])
def test_lanes_are_single_numbers(size):
    x, y = numbers(1, size), numbers(2, size)
    together = Packs.zeros(20, COUNT)
    over_rows(Packs(x), Packs(y), together, 20)
    for lane in range(LANES):
        alone = np.zeros((20, COUNT))
        over_rows(x[:, lane].copy(), y[:, lane].copy(), alone, 20)
        np.testing.assert_array_equal(together.array[..., lane], alone)
    assert together.array[0, 9, 0] == pytest.approx(3.0 * x[0, 0] * y[0, 0], rel=1e-15)


def test_a_lane_does_not_influence_the_others():
    x, y = numbers(3, 1.0), numbers(4, 1.0)
    before = Packs.zeros(20, COUNT)
    over_rows(Packs(x), Packs(y), before, 20)
    x[:, 2], y[:, 2] = np.nan, np.inf
    after = Packs.zeros(20, COUNT)
    over_rows(Packs(x), Packs(y), after, 20)
    others = np.arange(LANES) != 2
    np.testing.assert_array_equal(before.array[..., others], after.array[..., others])
    assert np.isnan(after.array[:, 0, 2]).all()


@compiled
def turned(angles, sines, cosines):
    for k in range(angles.shape[0]):
        sines[k] = sin(angles[k])
        cosines[k] = cos(angles[k])


@pytest.mark.parametrize("most", [1e-8, 1.0, 10.0, 1e6])
def test_sine_and_cosine(most):
    angles = np.random.default_rng(5).uniform(-most, most, 5000)
    angles[:3] = 0.0, most, -most
    sines, cosines = np.zeros((2, 5000))
    turned(angles, sines, cosines)
    # Three doublings multiply rounding errors of 1e-16 by eight; the reduction is exact to 1e6 rad.
    np.testing.assert_allclose(sines, np.sin(angles), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(cosines, np.cos(angles), rtol=0.0, atol=1e-15)
    if most < 1e-6:  # small angles keep their relative accuracy
        np.testing.assert_allclose(sines, angles, rtol=4e-16, atol=0.0)


def test_sine_and_cosine_are_analytic():
    angles = np.linspace(-9.0, 9.0, 200) + 1e-30j
    sines, cosines = np.zeros((2, 200), dtype=complex)
    turned(angles, sines, cosines)
    np.testing.assert_allclose(sines.imag / 1e-30, np.cos(angles.real), rtol=0.0, atol=2e-15)
    np.testing.assert_allclose(cosines.imag / 1e-30, -np.sin(angles.real), rtol=0.0, atol=2e-15)


def test_angles_that_are_not_finite():
    sines, cosines = np.zeros((2, 3))
    turned(np.array([math.nan, math.inf, -math.inf]), sines, cosines)
    assert np.isnan(sines).all()
    assert np.isnan(cosines).all()


@pytest.mark.parametrize("array", [np.zeros((2, 7)), np.zeros((2, 8), int), np.zeros((8, 2)).T])
def test_other_arrays_are_not_packs(array):
    with pytest.raises(ValueError, match="contiguous float64 arrays, 8 to a number"):
        Packs(array)
