"""Computed torque: the rigid model turns accelerations wanted into torques."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_kind, check_limits
from flexarm.arm import Arm
from flexarm.control.base import FloatArray, Measurement, Needs, Reference
from flexarm.control.gains import check_gains, check_joints, check_sample_time
from flexarm.control.requirements import JOINTS
from flexarm.control_design.rigid_model import RigidModel
from flexarm.controllers.follower import JointFollower, check_feedforward
from flexarm.errors import InputError, Problem, shown


class ComputedTorque(JointFollower):
    """Torques of the rigid model for the accelerations that would make errors die out.

    Args:
        arm: what the controller believes; its rigid twin is the model.
        frequency_hz: natural frequency of each joint's error, Hz, one number or one per joint.
        damping_ratio: of each joint's error, likewise, not negative.
        feedforward: None for feedback linearisation: the model's torques at the angles and rates
            measured. Or a function of time that gives torques (joints,) N m to follow the
            reference, such as the ``torque`` of `tip_inversion` together with its ``reference``;
            the model then turns the errors alone into torque, by its mass matrix.
        sample_time: s, positive.

    Without a reference it holds the angles of its first measurement. The theory page has (C.2):
    on a rigid arm the errors obey a linear equation of second order; on a flexible one the links
    are not modelled, and the frequency should stay below the lowest with joints locked.

    Raises:
        InputError: a number is negative, zero or not finite, or lists do not fit the joints.
    """

    name = "computed_torque"
    memory = ()

    def __init__(
        self,
        arm: Arm,
        frequency_hz: ArrayLike,
        damping_ratio: ArrayLike = 1.0,
        *,
        feedforward: Callable[[float], ArrayLike] | None = None,
        sample_time: float = 1e-3,
    ) -> None:
        super().__init__()
        where = "ComputedTorque"
        self.arm = check_kind(where, "arm", arm, Arm)
        self.frequency_hz = check_limits(where, "frequency_hz", frequency_hz)
        if not np.all(np.isfinite(self.frequency_hz)):
            raise InputError(Problem(where, "frequency_hz", "be finite", shown(frequency_hz)))
        self.damping_ratio = check_gains(where, "damping_ratio", damping_ratio)
        lists = {"frequency_hz": self.frequency_hz, "damping_ratio": self.damping_ratio}
        check_joints(where, arm.joints, **lists)
        self.sample_time = check_sample_time(where, sample_time)
        check_feedforward(where, feedforward)
        self.feedforward = feedforward
        self._model = RigidModel(arm)
        omega = 2.0 * np.pi * self.frequency_hz
        self._proportional, self._derivative = omega**2, 2.0 * self.damping_ratio * omega

    def needs(self, arm: Arm, reference: Reference | None) -> Needs:
        """See ``Controller.needs``."""
        return Needs(self.arm.joints, JOINTS)

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        now, speed = measurement.joint_angle, measurement.joint_rate
        angle, rate = self._wanted(t, measurement, reference)
        wanted: FloatArray = self._proportional * (angle - now) + self._derivative * (rate - speed)
        if self.feedforward is not None:
            return self._fed_forward(t) + self._model.mass_matrix(now) @ wanted
        if reference is not None:
            wanted = wanted + reference.joint_acceleration(t)
        # A copy: the model writes into the same array the next time.
        return self._model.torque(now, speed, wanted).copy()
