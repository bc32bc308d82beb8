"""The path from a quantity to its record: delay, filters, gaps; all of it is linear."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexarm.integrate.base import FloatArray
from flexarm.model.identification.records import Filter


class Path:
    """Treatment of one channel of a record, the same for measured and simulated values.

    Delay and filters with ``recorded`` act on simulated values only, because the record contains
    them. Then gaps of the record (not ``valid``) are filled by straight lines in both, so that the
    remaining filters have the same effect on both.
    """

    def __init__(
        self, times: FloatArray, valid: NDArray[np.bool_], delay: float, filters: Sequence[Filter]
    ) -> None:
        self._times, self._valid, self._delay = times, valid, delay
        self._rate = (times.size - 1) / (times[-1] - times[0])
        self._recorded = [item for item in filters if item.recorded]
        self._applied = [item for item in filters if not item.recorded]

    def measured(self, values: FloatArray) -> FloatArray:
        """Return the values (samples,) of a record after the filters that it does not contain."""
        return self._after(values[:, None])[:, 0]

    def simulated(self, values: FloatArray) -> FloatArray:
        """Return simulated values (samples, runs) as the record would contain them."""
        return self._after(self._through(self._late(values), self._recorded))

    def _late(self, values: FloatArray) -> FloatArray:
        if self._delay == 0.0:
            return values
        from scipy.interpolate import CubicSpline

        before = np.maximum(self._times - self._delay, self._times[0])
        return np.asarray(CubicSpline(self._times, values)(before))

    def _after(self, values: FloatArray) -> FloatArray:
        if not self._applied:
            return values
        if not self._valid.all():
            from scipy.interpolate import make_interp_spline

            known = self._times[self._valid]
            line = make_interp_spline(known, values[self._valid], k=1)
            values = np.asarray(line(np.clip(self._times, known[0], known[-1])))
        return self._through(values, self._applied)

    def _through(self, values: FloatArray, filters: Sequence[Filter]) -> FloatArray:
        for item in filters:
            values = _filtered(item, values, self._rate)
        return values


def _filtered(item: Filter, values: FloatArray, rate: float) -> FloatArray:
    if item.kind == "gain":
        assert item.factor is not None
        return item.factor * values
    if item.kind == "remove_mean":
        return np.asarray(values - values.mean(axis=0))
    from scipy.signal import lfilter, lfilter_zi

    numerator, denominator = coefficients(item, rate)
    start = lfilter_zi(numerator, denominator)[:, None] * values[0]
    return np.asarray(lfilter(numerator, denominator, values, axis=0, zi=start)[0])


def without_phase(values: FloatArray, cutoff: float, rate: float, order: int) -> FloatArray:
    """Filter values (samples,) by Butterworth's low-pass of ``order`` forwards and backwards."""
    from scipy.signal import butter, sosfiltfilt

    sections = butter(order, cutoff, fs=rate, output="sos")
    return np.asarray(sosfiltfilt(sections, values, padlen=min(15, values.size - 1)))


def coefficients(item: Filter, rate: float) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator of a low-pass or high-pass filter sampled at a rate (Hz)."""
    from scipy.signal import bilinear

    assert item.cutoff is not None
    w = 2.0 * np.pi * item.cutoff
    if item.order == 1:
        denominator = [1.0 / w, 1.0]
        numerator = [1.0] if item.kind == "low_pass" else [1.0 / w, 0.0]
    else:
        denominator = [1.0 / w**2, 2.0 * item.damping / w, 1.0]
        numerator = [1.0] if item.kind == "low_pass" else [1.0 / w**2, 0.0, 0.0]
    found: tuple[FloatArray, FloatArray] = bilinear(numerator, denominator, rate)
    return found
