"""Base of controllers of the tip and its contact force."""

from __future__ import annotations

from abc import abstractmethod

from flexarm.arm import Arm
from flexarm.control.base import Controller, Needs, Reference
from flexarm.control.parametrised import OfArm
from flexarm.control.requirements import JOINTS
from flexarm.control_design.task_plan import Asked, TaskPlan
from flexarm.control_design.task_space import TaskSpace, TaskState
from flexarm.hardware.measurement import FloatArray, Measurement


class TaskController(OfArm, Controller):
    """Base of controllers of the tip of a rigid model in contact with a surface."""

    def __post_init__(self) -> None:
        self._reads_force = True
        self._posture_frequency = 0.0  # of joint errors, rad/s; a subclass sets it
        self._task = TaskSpace(self.arm)
        self._plan = TaskPlan(self.arm, self.sample_time)

    def reset(self) -> None:
        """Clear the reference, and the angles that are kept without one."""
        self._plan.reset()

    def needs(self, arm: Arm, reference: Reference | None) -> Needs:
        """Return the requirements: a reference that presses needs a measured force."""
        presses = self._reads_force and hasattr(reference, "contact_force")
        return Needs(self.arm.joints, (*JOINTS, "contact_force") if presses else JOINTS)

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        angle, rate = measurement.joint_angle, measurement.joint_rate
        asked = self._plan.at(t, angle, reference)
        state = self._task.at(angle, rate)
        if not (asked.normal_x or asked.normal_y):
            return self._joints_follow(asked, state, angle, rate)
        acceleration, force = self._law(asked, state, measurement)
        posture = self._posture(asked, angle, rate)
        return self._task.torque(state, acceleration, force, posture, asked.pressing)

    @abstractmethod
    def _law(
        self, asked: Asked, state: TaskState, measurement: Measurement
    ) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the acceleration (m/s^2) of the tip of the rigid model, and the force (N) on it.

        The reference presses on a surface.
        """

    def _joints_follow(
        self, asked: Asked, state: TaskState, angle: FloatArray, rate: FloatArray
    ) -> FloatArray:
        """Return the torque of a motion without force: computed torque, regular at any posture."""
        w = self._posture_frequency
        wanted = asked.acceleration + w * w * (asked.angle - angle)
        wanted += 2.0 * w * (asked.rate - rate)
        torque: FloatArray = state.mass.dot(wanted)
        torque += state.bias_torque
        torque += asked.pressing
        return torque

    def _posture(self, asked: Asked, angle: FloatArray, rate: FloatArray) -> FloatArray:
        """Return joint accelerations (joints,), with posture control of more than two joints."""
        if self._task.joints < 3:
            return asked.acceleration
        w = self._posture_frequency
        back: FloatArray = w * w * (asked.angle - angle) + 2.0 * w * (asked.rate - rate)
        return asked.acceleration + back


def felt_force(asked: Asked, measurement: Measurement) -> float:
    """Return the measured force (N) of the first contact along the normal."""
    x, y = measurement.contact_force[0].tolist()
    force: float = asked.normal_x * x + asked.normal_y * y
    return force
