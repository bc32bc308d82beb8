"""The matrices of a separation between the breaks of its motion, as Chebyshev series.

They are analytic functions of time between two breaks, so a few dozen evaluations of the kernels
give them at all times with an error close to rounding.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.linear.small_deviations.along import Separation

_FIRST, _MOST = 32, 256
#: A series is long enough if its last coefficients are below this fraction of the largest.
_DIGITS = 1e-10


class SmoothMatrices:
    """M, D, K (T, k, k) and r (T, k) of a separation at any times, from Chebyshev series."""

    def __init__(self, model: Separation) -> None:
        self._model = model
        motion = model.motion
        # Before and after the motion the matrices are constant, so one evaluation suffices.
        self._rest = [
            self._packed(np.array([t])) for t in (motion.start_time - 1.0, motion.end_time)
        ]
        self._breaks = np.array(motion.breaks)
        self._series = [
            self._fit(a, b) for a, b in zip(self._breaks[:-1], self._breaks[1:], strict=True)
        ]

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return M, D, K and r at times (T,)."""
        k = self._model.kept.size
        packed = np.empty((times.size, 3 * k * k + k))
        packed[times < self._breaks[0]] = self._rest[0]
        packed[times >= self._breaks[-1]] = self._rest[1]
        for a, b, series in zip(self._breaks[:-1], self._breaks[1:], self._series, strict=True):
            own = (times >= a) & (times < b)
            scaled = (2.0 * times[own] - a - b) / (b - a)
            packed[own] = chebyshev.chebvander(scaled, len(series) - 1) @ series
        M, D, K = packed[:, : 3 * k * k].reshape(-1, 3, k, k).transpose(1, 0, 2, 3)
        return M, D, K, packed[:, 3 * k * k :]

    def _packed(self, times: FloatArray) -> FloatArray:
        parts = self._model.at(times).deviation[:4]
        return np.concatenate([part.reshape(times.size, -1) for part in parts], axis=1)

    def _fit(self, a: float, b: float) -> FloatArray:
        count = _FIRST
        while True:
            places = chebyshev.chebpts1(count)
            values = self._packed(0.5 * (a + b) + 0.5 * (b - a) * places)
            # Chebyshev polynomials are orthogonal over these points, so no system is solved.
            series = chebyshev.chebvander(places, count - 1).T @ values * (2.0 / count)
            series[0] *= 0.5
            scale = np.max(np.abs(series), axis=0)
            k = self._model.kept.size
            scale = np.maximum(scale, 1e-3 * np.max(scale[-k:], initial=0.0))
            last = np.max(np.abs(series[-3:]) / np.maximum(scale, np.max(scale) * 1e-12))
            if last < _DIGITS or count >= _MOST:
                return np.asarray(series)
            count *= 2
