"""Base of controllers around another one."""

from __future__ import annotations

from typing import Any

from flexarm.arm.arm import Arm
from flexarm.control.contract.base import (
    JOINTS,
    Arrays,
    Controller,
    ControllerRequirements,
    Measurement,
    Reference,
    Step,
    law_of,
    report_of,
    requirements_of,
)

#: Start of the names of the inner controller's memory.
_INNER = "inner."


class Around(Controller):
    """Base of controllers around an ``inner`` one, whose memory and inputs are among their own."""

    inner: Any

    @property
    def sample_time(self) -> float:
        """Sample time of the inner controller, s."""
        found: float = self.inner.sample_time
        return found

    @sample_time.setter
    def sample_time(self, value: float) -> None:
        self.inner.sample_time = value

    def reset(self) -> None:
        """Clear the state of the previous run, including the inner controller."""
        super().reset()
        self.inner.reset()

    def report(self) -> dict[str, float]:
        """Return the report of the inner controller."""
        return report_of(self.inner)

    def _keep(self, memory: Arrays) -> None:
        """Store the memory after an update; that of the inner controller also in this one."""
        super()._keep(memory)
        law_of(self.inner)._keep(self._inside(memory))

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the inputs of the inner controller."""
        return law_of(self.inner).planned(t, reference)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        """Return the memory of the inner controller, with its names here."""
        inside = law_of(self.inner).initial_memory(readings, inputs)
        return {_INNER + name: value for name, value in inside.items()}

    def _inner_step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        """Return the next memory of the inner controller, with its names here, and its torque."""
        after, torque = law_of(self.inner).step(self._inside(memory), readings, inputs)
        return {_INNER + name: value for name, value in after.items()}, torque

    def _inside(self, memory: Arrays) -> Arrays:
        start = len(_INNER)
        return {name[start:]: memory[name] for name in memory if name.startswith(_INNER)}

    def _required(
        self, arm: Arm, reference: Reference | None, joints: int
    ) -> ControllerRequirements:
        """Return the requirements of the inner controller and those of ``joints`` joints."""
        inner = requirements_of(self.inner, arm, reference)
        return ControllerRequirements(
            joints if joints != arm.joints else inner.joints,
            tuple(dict.fromkeys([*JOINTS, *inner.measured])),
            inner.gauges,
        )
