"""Multisines: their rates, their own coefficients, and wrong arguments."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.simulation.histories.multisine import rates_of


def test_rates_contain_the_rise():
    torque = fa.multisine(4.0, (0.5, 30.0), 0.003, rise=0.5)
    times = np.linspace(0.01, 1.0, 100)
    central = (torque(times + 1e-6) - torque(times - 1e-6)) / 2e-6
    # Rates reach 0.13 N m/s, and the differences have an error of 1e-8 N m/s.
    np.testing.assert_allclose(rates_of(torque, times), central, atol=1e-7)


def test_multisines_of_own_coefficients():
    own = fa.Multisine(2.0, [1, 3], np.array([[1.0, 0.0], [0.5j, 2.0]]))
    np.testing.assert_allclose(own(0.0), [1.0, 2.0])
    np.testing.assert_allclose(own(0.25), [np.sqrt(0.5) - 0.5 * np.sqrt(0.5), -np.sqrt(2.0)])
    assert own.scaled([2.0, 1.0]).coefficients[1, 0] == 1j
    for wrong in ([[1.0]], np.full((2, 1), np.nan * 1j), "x", np.zeros((2, 0))):
        with pytest.raises(fa.InputError, match="coefficients"):
            fa.Multisine(2.0, [1, 3], wrong)
    with pytest.raises(fa.InputError, match="whole numbers from 1"):
        fa.Multisine(2.0, [0.5], [[1.0]])
    with pytest.raises(fa.InputError, match="the highest one 100000"):
        fa.multisine(2.0, (1e9, 2e9), 0.1)
    with pytest.raises(fa.InputError, match="rate must be greater than 3 Hz"):
        own.samples(2.0, 1.0)
