"""Reference tabulated at the controller's sample times, to avoid an evaluation at each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.contract.base import Reference
from flexarm.integrate.base import FloatArray
from flexarm.motion import Motion

_LONGEST = 1e8  # limit on the sample times of a run, given by the memory
#: Methods of a reference that are tabulated, in addition to the motion of the joints.
_MORE = ("contact_force", "holding_torque", "normal", "pressing_torque", "tip")


class SampledReference:
    """Reference that is evaluated for all sample times in one call.

    One call of a motion for a thousand times is a thousand times as fast as a thousand calls, and
    controllers evaluate the reference at every sample time. For other times, and for methods
    that are not tabulated, the reference itself is called.
    """

    vectorized = True

    def __init__(self, reference: Any, sample_time: float, duration: float) -> None:
        self._reference = reference
        self._sample_time = sample_time
        if not duration / sample_time <= _LONGEST:
            rule = f"be at least {duration / _LONGEST:.3g} s for a duration of {duration:.6g} s"
            raise InputError(Problem("controller.sample_time", rule, shown(sample_time)))
        self._schedule = np.arange(int(np.ceil(duration / sample_time)) + 1) * sample_time
        self._tables: dict[str, FloatArray] = {}
        if isinstance(reference, Motion):
            angle, rate, acceleration = reference.state(self._schedule)
            self._tables |= {"joint_angle": angle, "joint_rate": rate}
            self._tables["joint_acceleration"] = acceleration

    def _look_up(self, name: str, t: ArrayLike) -> Any:
        # Only times that equal a sample time exactly have the tabulated value.
        if isinstance(t, float) or np.ndim(t) == 0:
            k = round(float(t) / self._sample_time)  # type: ignore[arg-type]
            if 0 <= k < len(self._schedule) and k * self._sample_time == t:
                table = self._tables.get(name)
                if table is None:
                    table = np.asarray(getattr(self._reference, name)(self._schedule))
                    self._tables[name] = table
                return table[k]
        elif name in self._tables:
            times = np.asarray(t, dtype=np.float64)
            samples = np.rint(times / self._sample_time)
            inside = (samples >= 0.0) & (samples < len(self._schedule))
            if np.all(inside & (samples * self._sample_time == times)):
                return self._tables[name][samples.astype(np.intp)]
        return getattr(self._reference, name)(t)

    def joint_angle(self, t: ArrayLike) -> FloatArray:
        """Joint angles (joints,) or (T, joints) at t, rad."""
        found: FloatArray = self._look_up("joint_angle", t)
        return found

    def joint_rate(self, t: ArrayLike) -> FloatArray:
        """Joint rates (joints,) or (T, joints) at t, rad/s."""
        found: FloatArray = self._look_up("joint_rate", t)
        return found

    def joint_acceleration(self, t: ArrayLike) -> FloatArray:
        """Joint accelerations (joints,) or (T, joints) at t, rad/s^2."""
        found: FloatArray = self._look_up("joint_acceleration", t)
        return found

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # copies and pickles look these up before `_reference` is set
            raise AttributeError(name)
        if name in _MORE and hasattr(self._reference, name):
            return lambda t: self._look_up(name, t)
        return getattr(self._reference, name)


def sampled_reference(
    reference: Reference | None, sample_time: float, duration: float
) -> Reference | None:
    """Tabulate a vectorized reference at the sample times; return any other one unchanged."""
    if getattr(reference, "vectorized", False):
        return SampledReference(reference, sample_time, duration)
    return reference
