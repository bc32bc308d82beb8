"""Sums of stages: the same numbers for arrays, packs and complex arrays."""

import numpy as np
import pytest

from flexarm.integrate.sums import combine
from flexarm.kernels.compilation.cache import compiled, undecorated
from flexarm.kernels.compilation.packs import LANES, Packs
from flexarm.kernels.layout import Sizes


@compiled
def combined(sizes, state, stages, weights, row, count, h, out):
    combine(sizes, state, stages, weights, row, count, h, out)


def sizes_of(bodies, modes):
    nothing, order = (np.zeros(0) for _ in range(6)), np.zeros((bodies, 2), np.int16)
    return Sizes(np.zeros(bodies), np.zeros(modes), *nothing, order, np.zeros((0, 3), np.int16))


def in_lanes(array):
    """Return packs whose lanes are all an array."""
    return Packs(np.repeat(array[..., None], LANES, axis=-1))


@pytest.mark.compiled
@pytest.mark.parametrize(("bodies", "modes"), [(1, 0), (1, 1), (1, 3), (2, 1), (2, 4), (3, 5)])
def test_sums_do_not_depend_on_the_number_type(bodies, modes):
    rng = np.random.default_rng(bodies + 10 * modes)
    shape, count, row, h = (2, bodies, 1 + modes), 4, 2, 0.3
    state, stages = rng.normal(size=shape), rng.normal(size=(count + 1, *shape))
    weights, sizes = rng.normal(size=(3, count)), sizes_of(bodies, modes)
    kept = state.copy()
    guarded = np.full(2 + state.size, np.pi)  # a store beyond the array would change its ends
    out = guarded[1:-1].reshape(shape)
    combined(sizes, state, stages, weights, row, count, h, out)
    np.testing.assert_array_equal(state, kept)
    np.testing.assert_array_equal(guarded[[0, -1]], np.pi)
    packs = Packs.zeros(*shape)
    combined(sizes, in_lanes(state), in_lanes(stages), weights, row, count, h, packs)
    np.testing.assert_array_equal(out[..., None] + np.zeros(LANES), packs.array)
    complex_out = np.zeros(shape, complex)
    turned = stages * (1.0 + 2.0j)
    combined(sizes, 1j * state, turned, weights, row, count, h, complex_out)
    np.testing.assert_allclose(complex_out.real, out - state, rtol=0, atol=1e-14)
    np.testing.assert_allclose(complex_out.imag, 2.0 * out - state, rtol=0, atol=1e-14)
    plain = np.zeros(shape)
    undecorated(combine)(sizes, state, stages, weights, row, count, h, plain)
    # Sums of four products of numbers of order one, whose products are fused in compiled code.
    np.testing.assert_allclose(out, plain, rtol=0, atol=1e-14)
