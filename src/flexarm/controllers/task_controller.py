"""Base of controllers of the tip and its contact force."""

from __future__ import annotations

from flexarm.arm import Arm
from flexarm.control.base import Controller, Needs, Reference
from flexarm.control.requirements import JOINTS
from flexarm.control_design.task_plan import Asked, TaskPlan
from flexarm.control_design.task_space import TaskSpace, TaskState
from flexarm.hardware.measurement import FloatArray, Measurement


class TaskController(Controller):
    """Base of controllers of the tip of a rigid model in contact with a surface.

    Attributes:
        arm: model of the arm. sample_time: s.
    """

    def __init__(self, arm: Arm, sample_time: float, posture_frequency: float) -> None:
        self.arm = arm
        self.sample_time = sample_time
        self._posture_frequency = posture_frequency
        self._reads_force = True
        self._task = TaskSpace(arm)
        self._plan = TaskPlan(arm, sample_time)

    def reset(self) -> None:
        """Clear the reference, and the angles that are kept without one."""
        self._plan.reset()

    def needs(self, arm: Arm, reference: Reference | None) -> Needs:
        """Return the requirements: a reference that presses needs a measured force."""
        presses = self._reads_force and hasattr(reference, "contact_force")
        return Needs(self.arm.joints, (*JOINTS, "contact_force") if presses else JOINTS)

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
