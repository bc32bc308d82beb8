"""Independent joint control with integral feedback and gravity compensation."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY
from typing import Any

import numpy as np
from pydantic import Field

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_flag, check_limits
from flexarm.base.errors import InputError, Problem
from flexarm.control.contract.base import (
    JOINTS,
    Arrays,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    Step,
    joint_problems,
)
from flexarm.control.design.rigid_model import RigidModel, SaggingArm
from flexarm.control.laws.joint.joint_pd import JointFollower
from flexarm.model.drives.controllers import JointPIDParameters


class JointPID(JointFollower, JointPIDParameters):
    """Proportional, integral and derivative feedback of each joint angle; gravity compensation.

    Without a reference the controller keeps the angles of its first measurement. Theory page:
    (C.1).

    Raises:
        InputError: if a gain is negative or not finite, a limit or the sample time is not positive,
            ``sag`` is given without ``arm``, or the length of a list differs from the number of
            joints of ``arm``.
    """

    _: KW_ONLY
    arm: Arm | None = Field(
        default=None,
        description="Model for gravity compensation at the measured angles; None for no "
        "compensation.",
    )
    sag: bool = Field(
        default=False,
        description="Whether the compensation includes the sag of the links under gravity; if "
        "False, the links are straight.",
    )
    torque_limit: Any = Field(
        default=math.inf,
        description="Largest requested torque (N m), one number or one per joint. At the limit the "
        "integral is not advanced in the direction of more torque (anti-windup).",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        arm = self.arm
        self.torque_limit = check_limits("torque_limit", self.torque_limit)
        self._limited = bool(np.any(np.isfinite(self.torque_limit)))
        self.sag = check_flag("sag", self.sag)
        self._weight: RigidModel | SaggingArm | None = None
        if arm is not None:
            limits = {"torque_limit": self.torque_limit}
            if problems := joint_problems(arm.joints, limits):
                raise InputError(*problems)
            self._weight = SaggingArm(arm) if self.sag else RigidModel(arm)
        elif self.sag:
            raise InputError(Problem("arm", "is required with sag"))

    @property
    def vectorized(self) -> bool:  # type: ignore[override]
        """Whether ``step`` accepts the readings of many runs; the sag of the links is of one."""
        return not self.sag

    @property
    def analytic(self) -> bool:  # type: ignore[override]
        """Whether ``step`` accepts complex numbers; the model of the gravity does not."""
        return self.arm is None

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        return ControllerRequirements(self._joints_for(arm, self.torque_limit), JOINTS)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        start = {"integral": 0.0 * readings.joint_angle}
        if isinstance(self._weight, SaggingArm):
            start["_sag"] = self._weight.first_sag(readings.joint_angle)
        return start

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after = dict(memory)
        error: FloatArray = inputs["reference_angle"] - readings.joint_angle
        torque: FloatArray = self.proportional * error + memory["integral"]
        torque = torque + self.derivative * (inputs["reference_rate"] - readings.joint_rate)
        if isinstance(self._weight, SaggingArm):
            pull, after["_sag"] = self._weight.gravity_torque(readings.joint_angle, memory["_sag"])
            torque = torque + pull
        elif self._weight is not None:
            torque = torque + self._weight.gravity_torque(readings.joint_angle)
        if self.feedforward is not None:
            torque = torque + inputs["feedforward"]
        rise = self.integral * (self.sample_time * error)
        if self._limited:
            wanted, limit = torque, self.torque_limit
            torque = np.minimum(np.maximum(wanted, -limit), limit)
            rise = ((wanted == torque) | (error * wanted < 0.0)) * rise
        after["integral"] = memory["integral"] + rise
        return after, torque
