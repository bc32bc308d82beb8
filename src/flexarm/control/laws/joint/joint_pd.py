"""Joint controllers that follow a reference, and proportional and derivative feedback."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY

from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.contract.base import (
    JOINTS,
    Arrays,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    SampledFeedforward,
    Step,
    joints_of,
)
from flexarm.control.contract.parametrised import Parametrised
from flexarm.model.drives.controllers import JointPDParameters


class JointFollower(Parametrised, Controller):
    """Base of joint controllers that follow a reference, or keep the first angles without one."""

    _: KW_ONLY
    feedforward: Callable[[float], ArrayLike] | None = Field(
        default=None,
        description="Function of time that returns torques (joints,) N m, such as "
        "``rigid_torque(arm, motion)``; None for none. It is evaluated in the middle of each "
        "sample.",
    )

    def __post_init__(self) -> None:
        if self.feedforward is not None and not callable(self.feedforward):
            rule = "be a function of time that returns torques, or None"
            raise InputError(Problem("feedforward", rule, shown(self.feedforward)))
        self._ahead: SampledFeedforward | None = None

    def reset(self) -> None:
        """Clear the memory and the feedforward torques computed in advance."""
        super().reset()
        self._ahead = None

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """Return the requirements: joint readings, and the number of joints of the parameters."""
        return ControllerRequirements(self._joints_for(arm), JOINTS)

    def _joints_for(self, arm: Arm, *more: FloatArray) -> int:
        """Return the number of joints of all parameters with a value for each, and of ``more``."""
        return joints_of(arm.joints, *self._per_joint(), *more)

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the reference angles and rates, and the feedforward torque."""
        inputs = {
            "reference_angle": reference.joint_angle(t),
            "reference_rate": reference.joint_rate(t),
        }
        if self.feedforward is not None:
            if self._ahead is None:
                # In the middle of the sample, because a zero-order hold delays its input by half a
                # sample. With a good model that delay would be the largest disturbance.
                later = 0.5 * self.sample_time
                self._ahead = SampledFeedforward(self.feedforward, self.sample_time, later)
            inputs["feedforward"] = self._ahead(t)
        return inputs


class JointPD(JointFollower, JointPDParameters):
    """Proportional and derivative feedback of each joint angle, plus a feedforward torque.

    Without a reference the controller keeps the angles of its first measurement.
    """

    vectorized = analytic = True

    feedforward: Callable[[float], ArrayLike] | None = Field(default=None)  # also by position

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        torque: FloatArray = self.proportional * (inputs["reference_angle"] - readings.joint_angle)
        torque = torque + self.derivative * (inputs["reference_rate"] - readings.joint_rate)
        if self.feedforward is not None:
            torque = torque + inputs["feedforward"]
        return memory, torque
