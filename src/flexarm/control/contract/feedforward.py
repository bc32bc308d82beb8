"""Feedforward torques, evaluated for many sample times in one call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.control.hardware.measurement import FloatArray


def numbers(values: Any) -> FloatArray:
    """Return values as an array of floats; an array of symbols of exported code is kept."""
    symbolic = getattr(values, "symbolic", False)
    array: FloatArray = values if symbolic else np.asarray(values, dtype=np.float64)
    return array


#: Number of sample times evaluated in one call.
_AHEAD = 512


class SampledFeedforward:
    """Feedforward torque of a controller at its sample times.

    Vectorized functions, such as those from ``rigid_torque``, are evaluated for ``_AHEAD`` sample
    times at once, because one call per sample takes a thousand times as long. Other functions are
    called directly, and so are vectorized functions at other times.

    Args:
        function: function of time (s) that returns torques (joints,) N m; if its attribute
            ``vectorized`` is true, it also takes times (T,) and returns (T, joints).
        sample_time: s.
        later: s, offset that is added to the sample time before the function is evaluated.
    """

    def __init__(
        self, function: Callable[[float], ArrayLike], sample_time: float, later: float = 0.0
    ) -> None:
        self._function = function
        self._sample_time = sample_time
        self._later = later
        self._many = bool(getattr(function, "vectorized", False))
        self._first = 0
        self._values: FloatArray = np.zeros((0, 0))

    def __call__(self, t: float) -> FloatArray:
        """Return the torques (joints,) N m at time t (s)."""
        k = round(t / self._sample_time)
        if not self._many or k < 0 or k * self._sample_time != t:
            return numbers(self._function(t + self._later))
        if not self._first <= k < self._first + len(self._values):
            self._first = k
            times = np.arange(k, k + _AHEAD) * self._sample_time + self._later
            self._values = np.asarray(self._function(times))  # type: ignore[arg-type]
        now: FloatArray = self._values[k - self._first]
        return now
