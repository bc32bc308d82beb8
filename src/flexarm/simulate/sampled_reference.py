"""A motion looked up at the controller's sample times instead of computed at each."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.control import Reference
from flexarm.integrate.base import FloatArray
from flexarm.motion import Motion


class SampledReference:
    """The same motion, evaluated for all sample times in one go.

    A motion computes a thousand times as fast as it answers a thousand single questions, and
    controllers ask at every sample. At other times it asks the motion itself, as for anything
    else that the motion knows.
    """

    def __init__(self, motion: Motion, sample_time: float, duration: float) -> None:
        self._motion = motion
        self._sample_time = sample_time
        ticks = np.arange(int(np.ceil(duration / sample_time)) + 1) * sample_time
        self._state = motion.state(ticks)

    def _index(self, t: float) -> int | None:
        k = round(t / self._sample_time)
        on_tick = 0 <= k < len(self._state.angle) and k * self._sample_time == t
        return k if on_tick else None

    def joint_angle(self, t: float) -> FloatArray:
        """Joint angles (joints,) at time t, rad."""
        k = self._index(t)
        return self._motion.joint_angle(t) if k is None else self._state.angle[k]

    def joint_rate(self, t: float) -> FloatArray:
        """Joint rates (joints,) at time t, rad/s."""
        k = self._index(t)
        return self._motion.joint_rate(t) if k is None else self._state.rate[k]

    def joint_acceleration(self, t: float) -> FloatArray:
        """Joint accelerations (joints,) at time t, rad/s^2."""
        k = self._index(t)
        return self._motion.joint_acceleration(t) if k is None else self._state.acceleration[k]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._motion, name)


def sampled_reference(
    reference: Reference | None, sample_time: float, duration: float
) -> Reference | None:
    """Look a motion up at sample times; leave a user's own reference as it is."""
    if isinstance(reference, Motion):
        return SampledReference(reference, sample_time, duration)
    return reference
