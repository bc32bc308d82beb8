"""Independent joint control: proportional and derivative feedback at every joint."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.control.contract.base import FloatArray, Measurement, Reference
from flexarm.control.laws.joint.follower import JointFollower
from flexarm.model.drives.joint import JointPDParameters


class JointPD(JointFollower, JointPDParameters):
    """Proportional and derivative feedback of each joint angle, plus a feedforward torque.

    Without a reference the controller keeps the angles of its first measurement.

    Raises:
        InputError: if a gain is negative or not finite, or the sample time is not positive.
    """

    memory = ()
    vectorized = True

    feedforward: Callable[[float], ArrayLike] | None = Field(default=None)  # also by position

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        angle, rate = self._desired(t, measurement, reference)
        torque: FloatArray = self.proportional * (angle - measurement.joint_angle)
        torque = torque + self.derivative * (rate - measurement.joint_rate)
        if self.feedforward is not None:
            torque = torque + self._fed_forward(t)
        return torque
