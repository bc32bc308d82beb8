"""Torques tabulated at sample times equal those of the function."""

import numpy as np
import pytest

from flexarm.control.contract.base import SampledFeedforward


class Waves:
    def __init__(self, vectorized):
        self.vectorized, self.calls = vectorized, 0

    def __call__(self, t):
        self.calls += 1
        return np.stack([np.sin(t), np.cos(3.0 * np.asarray(t))], axis=-1)


@pytest.mark.parametrize("vectorized", [True, False])
def test_tabulated_torques_equal_the_function_at_and_between_sample_times(vectorized):
    wave = Waves(vectorized)
    sampled = SampledFeedforward(wave, 0.003)
    times = [*(k * 0.003 for k in range(1200)), 0.0005, 0.003, -1.0]
    for t in times:
        # The same function of an array and of a number may differ in the last digit.
        np.testing.assert_allclose(sampled(t), [np.sin(t), np.cos(3 * t)], rtol=0, atol=1e-15)
    assert wave.calls < 10 if vectorized else wave.calls == len(times)
