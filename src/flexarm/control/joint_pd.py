"""Independent joint control: a spring and a damper at every motor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from flexarm.control.base import Controller, FloatArray, Measurement, Reference
from flexarm.control.feedforward import SampledFeedforward
from flexarm.errors import InputError, Problem, check_array, shown


class JointPD(Controller):
    """Proportional and derivative feedback of each joint angle, plus a feedforward torque.

    Args:
        proportional: gain (N m/rad), one number or one per joint, not negative.
        derivative: gain (N m s/rad), likewise.
        sample_time: s, positive.
        feedforward: function of time that gives torques (joints,) N m, such as
            ``rigid_torque(arm, motion)``; None for none.

    Without a reference it holds the angles of its first measurement.

    Raises:
        InputError: a gain is negative or not finite, or the sample time is not positive.
    """

    name = "joint_pd"

    def __init__(
        self,
        proportional: ArrayLike,
        derivative: ArrayLike,
        sample_time: float = 1e-3,
        feedforward: Callable[[float], ArrayLike] | None = None,
    ) -> None:
        self.proportional = _gain("proportional", proportional)
        self.derivative = _gain("derivative", derivative)
        if not (np.isfinite(sample_time) and sample_time > 0):
            raise InputError(
                Problem("JointPD", "sample_time", "be a positive time", shown(sample_time))
            )
        self.sample_time = float(sample_time)
        self.feedforward = feedforward
        self._held: FloatArray | None = None
        self._ahead: SampledFeedforward | None = None

    def reset(self) -> None:
        """Forget the angles held."""
        self._held = None
        self._ahead = None

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        if reference is None:
            if self._held is None:
                self._held = measurement.joint_angle.copy()
            angle, rate = self._held, 0.0 * self._held
        else:
            angle, rate = reference.joint_angle(t), reference.joint_rate(t)
        torque: FloatArray = self.proportional * (angle - measurement.joint_angle)
        torque = torque + self.derivative * (rate - measurement.joint_rate)
        if self.feedforward is not None:
            torque = torque + self._sampled()(t)
        return torque

    def _sampled(self) -> SampledFeedforward:
        if self._ahead is None:
            assert self.feedforward is not None
            self._ahead = SampledFeedforward(self.feedforward, self.sample_time)
        return self._ahead


def _gain(name: str, value: ArrayLike) -> FloatArray:
    shape = np.shape(value)
    gain = check_array("JointPD", name, value, shape[:1])
    if not np.all(np.isfinite(gain) & (gain >= 0)):
        raise InputError(Problem("JointPD", name, "hold finite gains >= 0", shown(value)))
    return gain
