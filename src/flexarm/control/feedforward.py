"""A torque function of time, computed for many sample times in one go."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from flexarm.hardware.measurement import FloatArray

#: Sample times computed in one go.
_AHEAD = 512


class SampledFeedforward:
    """The values of a function of time at the sample times of a controller.

    Functions that take many times, such as ``rigid_torque`` makes, cost a thousand times as much
    asked one by one: they are asked for ``_AHEAD`` sample times at once. Any other function, and
    any other time, is asked directly.

    Args:
        function: of time (s), gives torques (joints,) N m; with an attribute ``vectorized`` that is
            true it also takes times (T,) and gives (T, joints).
        sample_time: s.
        later: s, how long after a sample time the function is read for it.
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
            return np.asarray(self._function(t + self._later), dtype=np.float64)
        if not self._first <= k < self._first + len(self._values):
            self._first = k
            times = np.arange(k, k + _AHEAD) * self._sample_time + self._later
            self._values = np.asarray(self._function(times))  # type: ignore[arg-type]
        now: FloatArray = self._values[k - self._first]
        return now
