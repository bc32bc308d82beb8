"""Prescribed performance: joint control with bounds of the errors, without a model of the arm."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.base.arguments import check_numbers
from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.control.contract.base import Arrays, FloatArray, Measurement, Step
from flexarm.control.laws.joint.joint_laws import JointFollower
from flexarm.model.drives.controllers import PrescribedPerformanceParameters

#: Default decay rate of the bounds, relative to that of the errors.
_DECAY = 0.125


class PrescribedPerformance(JointFollower, PrescribedPerformanceParameters):
    """Joint control that keeps angle errors within bounds that decrease exponentially.

    Near zero errors it is `JointPD` with the gains ``bandwidth`` times ``damping`` and ``damping``.
    Towards its bound, the gain from an angle error to a requested rate grows, and so does the gain
    from the rate error to the torque. If they grow without limit, in continuous time, no bound is
    exceeded on an arm with damped links, whatever its payload and friction. A sampled loop is
    stable only up to certain gains, so both grow up to ``gain_limit`` times their values at zero,
    and a bound can be exceeded. The bounds are those of the joints: stiff joints damp the links
    little.

    Without a reference the controller keeps the angles of its first measurement.

    The attribute ``bound_exceeded`` of results is the number of samples ``outside``; ``simulate``
    warns if there are any.

    Raises:
        InputError: if a number is out of range, or ``start_bound`` is less than ``bound``.
    """

    vectorized = True
    references: ClassVar[str] = "BechlioulisRovithakis2008 BechlioulisRovithakis2014"

    def __post_init__(self) -> None:
        from scipy.optimize import brentq

        super().__post_init__()
        if self.start_bound is None:
            self.start_bound = self.bound
        if self.decay is None:
            self.decay = _DECAY * float(np.min(self.bandwidth))
        start, end = np.size(self.start_bound), np.size(self.bound)
        if start != end and 1 not in (start, end):
            rule = f"have length {end}, one value for each joint"
            raise InputError(Problem("start_bound", rule, str(start)))
        if np.any(self.start_bound < self.bound):
            raise InputError(Problem("start_bound", "be at least bound", shown(self.start_bound)))
        self._angle_end = math.sqrt(1.0 - 1.0 / self.gain_limit)
        self._rate_end = brentq(lambda x: _torque_slope(x) - self.gain_limit, 0.0, self._angle_end)

    @property
    def outside(self) -> int:
        """Number of samples of the last run with a measured angle error outside its bound."""
        return int(self.memory.get("outside", 0))

    @public_call
    def angle_bound(self, t: ArrayLike) -> FloatArray:
        """Return the bounds (T, joints) rad of the angle errors at times (T,) s.

        The shape is (T, 1) with one bound for all joints.

        Raises:
            InputError: if t does not consist of numbers.
        """
        fading = np.exp(-self.decay * check_numbers("t", t))[..., None]
        found: FloatArray = self.bound + (self.start_bound - self.bound) * fading
        return found

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        error = inputs["reference_angle"] - readings.joint_angle
        start = np.ones((*error.shape[:-1], 1))
        bound = self.bound + start * (self.start_bound - self.bound)
        return {"fading": start, "outside": 0, "_first": _largest(error / bound)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        # Not the excess itself, because an analysis of the loop varies its memory below zero, too.
        bound = self.bound + memory["fading"] * (self.start_bound - self.bound)
        after = dict(memory, fading=np.exp(-self.decay * self.sample_time) * memory["fading"])
        ratio = (inputs["reference_angle"] - readings.joint_angle) / bound
        after["outside"] = memory["outside"] + (_largest(ratio) > 1.0)
        near, beyond = _split(ratio, self._angle_end)
        grown = np.arctanh(near) + self.gain_limit * beyond
        requested = inputs["reference_rate"] + self.bandwidth * bound * grown
        ratio = (requested - readings.joint_rate) / self.rate_bound
        near, beyond = _split(ratio, self._rate_end)
        grown = np.arctanh(near) / (1.0 - near * near) + self.gain_limit * beyond
        torque: FloatArray = self.damping * self.rate_bound * grown
        if self.feedforward is not None:
            torque = torque + inputs["feedforward"]
        return after, torque

    def report(self) -> dict[str, float]:
        """Return the number of samples outside the bound, and the first error over its bound."""
        return {
            "bound_exceeded": self.outside,
            "bound_first_ratio": float(self.memory.get("_first", 0.0)),
        }


def _largest(ratio: FloatArray) -> Any:
    """Return the largest ratio of each run; 0 for symbols, which are not counted."""
    return np.abs(ratio).max(axis=-1) if ratio.dtype.kind == "f" else 0.0


def _split(ratio: FloatArray, end: float) -> tuple[FloatArray, FloatArray]:
    """Return the parts of a ratio within ``end``, and beyond it."""
    near = np.minimum(np.maximum(ratio, -end), end)
    return near, ratio - near


def _torque_slope(x: float) -> float:
    """Return the derivative of artanh(x) / (1 - x^2)."""
    return (1.0 + 2.0 * x * math.atanh(x)) / (1.0 - x * x) ** 2
