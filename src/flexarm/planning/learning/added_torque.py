"""Controller that adds a learned torque to that of another controller."""

from __future__ import annotations

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.control.analysis.linear_controller import memory_of
from flexarm.control.contract.base import (
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    report_of,
    requirements_of,
)


class AddedTorque(Controller):
    """Controller that adds torques, constant in intervals from time zero on, to an inner one.

    Args:
        inner: the controller.
        torque: (N, joints) N m, in each interval; the last one also after the end.
        interval: length of an interval, s.
    """

    def __init__(self, inner: Controller, torque: FloatArray, interval: float) -> None:
        self.inner, self.torque, self.interval = inner, torque, interval

    @property
    def memory(self) -> tuple[str, ...] | None:  # type: ignore[override]
        """Attributes kept between samples; None if ``inner`` does not declare its own."""
        inside = memory_of(self.inner)
        return None if inside is None else tuple(f"inner.{name}" for name in inside)

    @property
    def sample_time(self) -> float:
        """Sample time of the inner controller, s."""
        return self.inner.sample_time

    @sample_time.setter
    def sample_time(self, value: float) -> None:
        self.inner.sample_time = value

    def reset(self) -> None:
        """Clear the state of the inner controller."""
        self.inner.reset()

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """See ``Controller.requirements``."""
        inner = requirements_of(self.inner, arm, reference)
        joints = self.torque.shape[1]
        return inner._replace(joints=joints if joints != arm.joints else inner.joints)

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        # The sample times are multiples of the interval except for rounding.
        k = min(int(t / self.interval + 1e-6), len(self.torque) - 1)
        given = np.asarray(self.inner.update(t, measurement, reference), dtype=np.float64)
        found: FloatArray = given + self.torque[k]
        return found

    def report(self) -> dict[str, float]:
        """Return the report of the inner controller."""
        return report_of(self.inner)
