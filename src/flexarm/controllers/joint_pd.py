"""Independent joint control: proportional and derivative feedback at every joint."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import ArrayLike

from flexarm.arm import Arm
from flexarm.control.base import FloatArray, Measurement, Needs, Reference
from flexarm.control.gains import check_gains, check_sample_time
from flexarm.control.requirements import JOINTS, joints_of
from flexarm.controllers.follower import JointFollower, check_feedforward


class JointPD(JointFollower):
    """Proportional and derivative feedback of each joint angle, plus a feedforward torque.

    Args:
        proportional: gain (N m/rad), one number or one per joint, not negative.
        derivative: gain (N m s/rad), one number or one per joint, not negative.
        sample_time: s, positive.
        feedforward: function of time that returns torques (joints,) N m, such as
            ``rigid_torque(arm, motion)``; None for none. It is evaluated in the middle of each
            sample.

    Without a reference the controller keeps the angles of its first measurement.

    Raises:
        InputError: if a gain is negative or not finite, or the sample time is not positive.
    """

    name = "joint_pd"
    memory = ()

    def __init__(
        self,
        proportional: ArrayLike,
        derivative: ArrayLike,
        sample_time: float = 1e-3,
        feedforward: Callable[[float], ArrayLike] | None = None,
    ) -> None:
        super().__init__()
        self.proportional = check_gains("JointPD", "proportional", proportional)
        self.derivative = check_gains("JointPD", "derivative", derivative)
        self.sample_time = check_sample_time("JointPD", sample_time)
        check_feedforward("JointPD", feedforward)
        self.feedforward = feedforward

    def needs(self, arm: Arm, reference: Reference | None) -> Needs:
        """See ``Controller.needs``."""
        return Needs(joints_of(arm.joints, self.proportional, self.derivative), JOINTS)

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        angle, rate = self._wanted(t, measurement, reference)
        torque: FloatArray = self.proportional * (angle - measurement.joint_angle)
        torque = torque + self.derivative * (rate - measurement.joint_rate)
        if self.feedforward is not None:
            torque = torque + self._fed_forward(t)
        return torque
