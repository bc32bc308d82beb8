"""The stored coefficients equal SciPy's to the last bit."""

import numpy as np
import pytest
from scipy.integrate import DOP853

from flexarm.integrate.explicit_runge_kutta import dop853


@pytest.mark.parametrize("name", ["B", "C", "D", "E3", "E5", "A_EXTRA", "C_EXTRA"])
def test_coefficients(name):
    np.testing.assert_array_equal(np.array(getattr(dop853, name)), getattr(DOP853, name))


def test_weights_of_the_stages():
    for stored, row in zip(dop853.A, DOP853.A, strict=True):
        np.testing.assert_array_equal(stored, row[: len(stored)])
        assert not np.any(row[len(stored) :])
