"""Consistency test of a filter: its innovations against their covariance."""

from __future__ import annotations

from functools import cache

import numpy as np

from flexarm.base.arguments import check_number
from flexarm.base.errors import InconsistentEstimateWarning, warn_caller
from flexarm.control.hardware.measurement import FloatArray

#: Number of samples over which normalised innovations squared are averaged.
WINDOW = 100
#: Probability that a consistent filter fails the test in a given window.
_FALSE_ALARM = 1e-9


@cache
def largest_ratio(size: int) -> float:
    """Return the limit of the mean normalised innovation squared of ``size`` readings.

    Its expected value is one.
    """
    from scipy.stats import chi2

    return float(chi2.isf(_FALSE_ALARM, size)) / size


def band(size: int, probability: float) -> tuple[float, float]:
    """Return the central interval of a chi-squared variable of ``size``, divided by its mean.

    Raises:
        InputError: if the probability is not between 0 and 1.
    """
    from scipy.stats import chi2

    inside = check_number("probability", probability, lambda p: 0.0 < p < 1.0, "be within 0 and 1")
    low, high = chi2.ppf([0.5 - 0.5 * inside, 0.5 + 0.5 * inside], size) / size
    return float(low), float(high)


def innovation_covariance(
    P: FloatArray, moved: FloatArray, H: FloatArray, felt: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the covariance S of readings, that of their errors R, and N of state and errors.

    The error of the torque affects both the state and the accelerometers, so their errors are
    correlated by N (s, readings).

    Args:
        P: (s, s), covariance of the state. H: (readings, s), derivative by the state.
        moved, felt: (s, joints), (readings, joints), changes of state and readings by the error of
            the torque relative to its deviation. variance: (readings,) of the instruments.
    """
    N, R = moved @ felt.T, np.diag(variance) + felt @ felt.T
    return H @ P @ H.T + H @ N + N.T @ H.T + R, R, N


def squared_innovation(missed: FloatArray, covariance: FloatArray) -> float:
    """Return the normalised innovation squared of the difference of readings and prediction."""
    return float(missed @ np.linalg.solve(covariance, missed))


class InnovationTest:
    """Test of the mean normalised innovation squared over a window against its distribution.

    Args:
        name: of the filter, for its warning.

    Attributes:
        ratio: mean over the last ``WINDOW`` samples, about one if the filter is consistent; NaN
            before there are as many.
        worst: largest ratio so far, or NaN.
        passed: whether all windows so far were within their distribution.

    Y. Bar-Shalom, X. R. Li and T. Kirubarajan, Estimation with Applications to Tracking and
    Navigation, 2001, section 5.4. Ratios far below one pass the test: the noise is then smaller
    than specified, and so are the errors.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._last, self._sizes = np.zeros(WINDOW), np.zeros(WINDOW, dtype=int)
        self._count = 0
        self.ratio = self.worst = np.nan
        self.passed = True

    def add(self, squared: float, size: int) -> None:
        """Add the normalised innovation squared of a sample with ``size`` readings.

        Warns:
            InconsistentEstimateWarning: if a window is outside its distribution, for the first
                one only.
        """
        place = self._count % WINDOW
        self._last[place], self._sizes[place] = squared, size
        self._count += 1
        if self._count < WINDOW:
            return
        count = int(self._sizes.sum())
        self.ratio = float(self._last.sum()) / count
        self.worst = float(np.fmax(self.worst, self.ratio))
        if self.passed and self.ratio > largest_ratio(count):
            self.passed = False
            text = (
                f"{self._name}: over {WINDOW} samples the squared innovations are "
                f"{self.ratio:.3g} times as large as the covariance allows, so the errors of the "
                "estimates exceed its covariance. Correct the arm, or raise torque_noise or the "
                "noise of the instruments."
            )
            warn_caller(text, InconsistentEstimateWarning)
