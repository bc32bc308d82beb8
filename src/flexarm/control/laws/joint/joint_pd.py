"""Independent joint control: proportional and derivative feedback at every joint."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.control.contract.base import Arrays, FloatArray, Measurement
from flexarm.control.laws.joint.follower import JointFollower
from flexarm.model.drives.controllers import JointPDParameters


class JointPD(JointFollower, JointPDParameters):
    """Proportional and derivative feedback of each joint angle, plus a feedforward torque.

    Without a reference the controller keeps the angles of its first measurement.

    Raises:
        InputError: if a gain is negative or not finite, or the sample time is not positive.
    """

    vectorized = analytic = True

    feedforward: Callable[[float], ArrayLike] | None = Field(default=None)  # also by position

    def step(
        self, memory: Arrays, readings: Measurement, inputs: Arrays
    ) -> tuple[Arrays, FloatArray]:
        """See ``Controller.step``."""
        torque: FloatArray = self.proportional * (inputs["reference_angle"] - readings.joint_angle)
        torque = torque + self.derivative * (inputs["reference_rate"] - readings.joint_rate)
        if self.feedforward is not None:
            torque = torque + inputs["feedforward"]
        return memory, torque
