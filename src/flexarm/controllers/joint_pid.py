"""Independent joint control with integral feedback and gravity compensation."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_flag, check_kind, check_limits
from flexarm.arm import Arm
from flexarm.control.base import FloatArray, Measurement, Needs, Reference
from flexarm.control.gains import check_gains, check_joints, check_sample_time
from flexarm.control.requirements import JOINTS, joints_of
from flexarm.control_design.gravity_compensation import SaggingArm
from flexarm.control_design.rigid_model import RigidModel
from flexarm.controllers.follower import JointFollower, check_feedforward
from flexarm.errors import InputError, Problem


class JointPID(JointFollower):
    """Proportional, integral and derivative feedback of each joint angle; gravity compensation.

    Args:
        proportional: gain (N m/rad), one number or one per joint, not negative.
        derivative: gain (N m s/rad), one number or one per joint, not negative.
        integral: gain (N m/(rad s)), one number or one per joint, not negative; zero for a PD
            controller.
        arm: model for gravity compensation at the measured angles; None for no compensation.
        sag: whether the compensation includes the sag of the links under gravity; if False, the
            links are straight.
        torque_limit: N m, largest requested torque, one number or one per joint. At the limit the
            integral is not advanced in the direction of more torque (anti-windup).
        sample_time: s, positive.
        feedforward: function of time that returns torques (joints,) N m, as in `JointPD`; None for
            none.

    Without a reference the controller keeps the angles of its first measurement. Theory page:
    (C.1).

    Raises:
        InputError: if a gain is negative or not finite, a limit or the sample time is not positive,
            ``sag`` is given without ``arm``, or the length of a list differs from the number of
            joints of ``arm``.
    """

    name = "joint_pid"
    memory = ("_sum",)

    def __init__(
        self,
        proportional: ArrayLike,
        derivative: ArrayLike,
        integral: ArrayLike = 0.0,
        *,
        arm: Arm | None = None,
        sag: bool = False,
        torque_limit: ArrayLike = math.inf,
        sample_time: float = 1e-3,
        feedforward: Callable[[float], ArrayLike] | None = None,
    ) -> None:
        super().__init__()
        where = "JointPID"
        self.proportional = check_gains(where, "proportional", proportional)
        self.derivative = check_gains(where, "derivative", derivative)
        self.integral = check_gains(where, "integral", integral)
        self.torque_limit = check_limits(where, "torque_limit", torque_limit)
        self._limited = bool(np.any(np.isfinite(self.torque_limit)))
        self.sample_time = check_sample_time(where, sample_time)
        check_feedforward(where, feedforward)
        self.feedforward = feedforward
        self.arm, self.sag = arm, check_flag(where, "sag", sag)
        self._weight: RigidModel | SaggingArm | None = None
        if arm is not None:
            check_kind(where, "arm", arm, Arm)
            gains = {"proportional": self.proportional, "derivative": self.derivative}
            limits = {"integral": self.integral, "torque_limit": self.torque_limit}
            check_joints(where, arm.joints, **gains, **limits)
            self._weight = SaggingArm(arm) if sag else RigidModel(arm)
        elif sag:
            raise InputError(Problem(where, "arm", "is required with sag"))
        self._sum: FloatArray | float = 0.0

    def reset(self) -> None:
        """Clear the stored angles and the integral."""
        super().reset()
        self._sum = 0.0
        if isinstance(self._weight, SaggingArm):
            self._weight.reset()

    def needs(self, arm: Arm, reference: Reference | None) -> Needs:
        """See ``Controller.needs``."""
        if self.arm is not None:
            return Needs(self.arm.joints, JOINTS)
        lists = self.proportional, self.derivative, self.integral, self.torque_limit
        return Needs(joints_of(arm.joints, *lists), JOINTS)

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        angle, rate = self._wanted(t, measurement, reference)
        error: FloatArray = angle - measurement.joint_angle
        torque = self.proportional * error + self._sum
        torque = torque + self.derivative * (rate - measurement.joint_rate)
        if self._weight is not None:
            torque = torque + self._weight.gravity_torque(measurement.joint_angle)
        if self.feedforward is not None:
            torque = torque + self._fed_forward(t)
        if not self._limited:
            self._sum = self._sum + self.integral * (self.sample_time * error)
            return torque
        given = np.minimum(np.maximum(torque, -self.torque_limit), self.torque_limit)
        taken = (torque == given) | (error * torque < 0.0)
        self._sum = self._sum + taken * self.integral * (self.sample_time * error)
        return given
