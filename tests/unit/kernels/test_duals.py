"""Dual numbers: values are those of single numbers, derivatives those of complex steps."""

import numpy as np
import pytest

from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.compilation.duals import DIRECTIONS, Duals, zeros_like
from flexarm.kernels.compilation.numbers import cos, exp, log, positive_part, real, sin, sqrt, tanh

pytestmark = pytest.mark.compiled
#: Results of ``operations``.
COUNT = 16
STEP = 1e-30
#: Rounding of a dozen operations, relative to the largest number in them.
ROUNDING = 1e-14


@compiled
def operations(x, y, results):
    results[0] = x[0] + y[0] - 2.0 * x[0]
    results[1] = (1.0 - x[0]) / (3.0 + y[0] * y[0])
    results[2] = 2.0 / y[0]
    results[3] = -y[0] * 7
    results[4] = sqrt(x[0] * x[0] + 1.0)
    results[5] = exp(-x[0] * x[0])
    results[6] = tanh(y[0])
    results[7] = sin(x[0])
    results[8] = cos(x[0])
    results[9] = log(x[0] * x[0] + 0.1)
    results[10] = positive_part(y[0], 0.1)
    total = 0.0
    for k in range(3):
        total += k * x[0] * y[0]
    results[11] = total
    total -= x[0]
    total *= y[0]
    total /= 3.0
    results[12] = total
    results[13] = 4.0
    results[14] = real(x[0])
    results[15] = y[0] if real(x[0]) > 0.0 else x[0]


def numbers(seed, size):
    rng = np.random.default_rng(seed)
    return size * rng.normal(size=1), rng.normal(size=(DIRECTIONS, 1))


@pytest.mark.parametrize("size", [1.0, 1e-3, 30.0])
def test_operations(size):
    for seed in range(10):
        pair = [numbers(2 * seed + k, size) for k in range(2)]
        plain, duals = np.zeros(COUNT), Duals.zeros(COUNT)
        operations(*(value for value, _ in pair), plain)
        operations(*(Duals.of(*one) for one in pair), duals)
        np.testing.assert_array_equal(duals.value, plain)
        for k in range(DIRECTIONS):
            found = np.zeros(COUNT, dtype=complex)
            operations(*(value + 1j * STEP * slopes[k] for value, slopes in pair), found)
            wanted = found.imag / STEP
            np.testing.assert_allclose(
                duals.slopes[k], wanted, rtol=0, atol=ROUNDING * max(1.0, np.abs(wanted).max())
            )


@compiled
def decisions(x, y, results):
    results[0] = max(x[0], y[0]) + max(0.0, x[0])
    results[1] = min(x[0], y[0]) - min(x[0], 1.0)
    results[2] = abs(x[0])
    results[3] = 1.0 if x[0] < y[0] else 0.0
    results[4] = 1.0 if x[0] >= 0.0 else 0.0
    results[5] = 1.0 if x[0] != x[0] else 0.0


@pytest.mark.parametrize(("x", "y"), [(0.3, 0.7), (0.7, 0.3), (-2.0, 0.5)])
def test_decisions_follow_the_values(x, y):
    results, dx, dy = Duals.zeros(6), np.ones((1, 1)), np.full((1, 1), 10.0)
    operands = [Duals.of(np.array([v]), d) for v, d in ((x, dx), (y, dy))]
    decisions(*operands, results)
    larger, smaller = (10.0, 1.0) if y > x else (1.0, 10.0)
    assert results.slopes[0].tolist() == [
        larger + (1.0 if x > 0 else 0.0), smaller - 1.0, 1.0 if x > 0 else -1.0, 0.0, 0.0, 0.0,
    ]  # fmt: skip
    assert results.value[3:].tolist() == [float(x < y), float(x >= 0.0), 0.0]


@compiled
def through_parts(x, results):
    for k in range(x.shape[0]):
        part = x[k]
        for j in range(part.shape[0]):
            results[j, k] = part[j] * 2.0


def test_parts_and_shapes_of_arrays():
    given = Duals(np.arange(2 * 3 * (1 + DIRECTIONS), dtype=float).reshape(2, 3, -1))
    results = zeros_like(given, 3, 2)
    through_parts(given, results)
    np.testing.assert_array_equal(results.array, 2.0 * given.array.swapaxes(0, 1))
    assert given.shape == (2, 3)
    assert given.slopes.shape == (DIRECTIONS, 2, 3)


def test_other_arrays_are_refused():
    with pytest.raises(ValueError, match="contiguous"):
        Duals(np.zeros((2, DIRECTIONS)))
