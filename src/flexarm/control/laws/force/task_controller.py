"""Base of controllers of the tip and its contact force."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

from flexarm.arm.arm import Arm
from flexarm.control.contract.base import Arrays, Controller, ControllerRequirements, Reference
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.contract.requirements import JOINTS
from flexarm.control.design.arm_scales import arm_scales, set_defaults, slow_rate
from flexarm.control.design.task_plan import TaskPlan, TaskReference
from flexarm.control.design.task_space import TaskSpace, TaskState
from flexarm.control.hardware.measurement import FloatArray, Measurement


class TaskController(OfArm, Controller):
    """Base of controllers of the tip of a rigid model in contact with a surface."""

    exports_plan = True

    _shares: ClassVar[dict[str, float]]
    """Defaults of parameters, relative to their typical sizes on the arm."""

    def __post_init__(self) -> None:
        self._scales = arm_scales(self.arm, slow_rate(self.arm, self.sample_time))
        set_defaults(self, self._shares, self._scales)
        self._reads_force = True
        self._posture_frequency = 0.0  # of joint errors, rad/s; a subclass sets it
        self._task = TaskSpace(self.arm)
        self._plan = TaskPlan(self.arm, self.sample_time)

    def reset(self) -> None:
        """Clear the memory and the reference."""
        super().reset()
        self._plan.reset()

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """Return the requirements: a reference that presses needs a measured force."""
        presses = self._reads_force and hasattr(reference, "contact_force")
        return ControllerRequirements(
            self.arm.joints, (*JOINTS, "contact_force") if presses else JOINTS
        )

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the requested motion and force at t (s), in the order of `TaskReference`."""
        return {"request": self._plan.row(t, reference)}

    def step(
        self, memory: Arrays, readings: Measurement, inputs: Arrays
    ) -> tuple[Arrays, FloatArray]:
        """See ``Controller.step``."""
        after = dict(memory)
        angle, rate = readings.joint_angle, readings.joint_rate
        request = self._request(after, inputs)
        state = self._task.at(angle, rate)
        if not (request.normal_x or request.normal_y):
            return after, self._joints_follow(request, state, angle, rate)
        acceleration, force = self._law(after, inputs, request, state, readings)
        posture = self._posture(request, angle, rate)
        return after, self._task.torque(state, acceleration, force, posture, request.pressing)

    def _request(self, memory: Arrays, inputs: Arrays) -> TaskReference:
        """Return the requested motion and force of a sample."""
        return self._plan.request(inputs["request"])

    @abstractmethod
    def _law(
        self,
        memory: dict[str, Any],
        inputs: Arrays,
        request: TaskReference,
        state: TaskState,
        readings: Measurement,
    ) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the acceleration (m/s^2) of the tip of the rigid model, and the force (N) on it.

        The reference presses on a surface. The memory, a copy, is advanced.
        """

    def _joints_follow(
        self, request: TaskReference, state: TaskState, angle: FloatArray, rate: FloatArray
    ) -> FloatArray:
        """Return the torque of a motion without force: computed torque, regular at any posture."""
        w = self._posture_frequency
        desired = request.acceleration + w * w * (request.angle - angle)
        desired += 2.0 * w * (request.rate - rate)
        torque: FloatArray = state.mass.dot(desired)
        torque += state.bias_torque
        torque += request.pressing
        return torque

    def _posture(self, request: TaskReference, angle: FloatArray, rate: FloatArray) -> FloatArray:
        """Return joint accelerations (joints,), with posture control of more than two joints."""
        if self._task.joints < 3:
            return request.acceleration
        w = self._posture_frequency
        back: FloatArray = w * w * (request.angle - angle) + 2.0 * w * (request.rate - rate)
        return request.acceleration + back


def felt_force(request: TaskReference, readings: Measurement) -> float:
    """Return the measured force (N) of the first contact along the normal."""
    x, y = readings.contact_force[0].tolist()
    force: float = request.normal_x * x + request.normal_y * y
    return force
