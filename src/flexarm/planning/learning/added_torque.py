"""Controller that adds a learned torque to that of another controller."""

from __future__ import annotations

from flexarm.arm.arm import Arm
from flexarm.control.contract.around import Around
from flexarm.control.contract.base import (
    Arrays,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    requirements_of,
)


class AddedTorque(Around):
    """Controller that adds torques, constant in intervals from time zero on, to an inner one.

    Args:
        inner: the controller.
        torque: (N, joints) N m, in each interval; the last one also after the end.
        interval: length of an interval, s.
    """

    def __init__(self, inner: Controller, torque: FloatArray, interval: float) -> None:
        self.inner, self.torque, self.interval = inner, torque, interval

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """See ``Controller.requirements``."""
        inner = requirements_of(self.inner, arm, reference)
        joints = self.torque.shape[1]
        return inner._replace(joints=joints if joints != arm.joints else inner.joints)

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the inputs of the inner controller, and the torque of the interval."""
        # The sample times are multiples of the interval except for rounding.
        k = min(int(t / self.interval + 1e-6), len(self.torque) - 1)
        return {**super().planned(t, reference), "added_torque": self.torque[k]}

    def step(
        self, memory: Arrays, readings: Measurement, inputs: Arrays
    ) -> tuple[Arrays, FloatArray]:
        """See ``Controller.step``."""
        inside, torque = self._inner_step(memory, readings, inputs)
        return inside, torque + inputs["added_torque"]
