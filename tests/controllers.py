"""Controllers of users that many tests use."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import flexarm as fa

#: Time, measurement and reference to torques.
Torque = Callable[[float, Any, Any], Any]


class Plain:
    """The three members of a controller and no others; the torque is a function."""

    def __init__(self, torque: Torque, sample_time: float = 0.01) -> None:
        self.torque, self.sample_time = torque, sample_time

    def reset(self) -> None:
        pass

    def update(self, t: float, measurement: Any, reference: Any) -> Any:
        return self.torque(t, measurement, reference)


class Law(fa.Controller):
    """A step without memory; the torque is a function of the readings and the inputs."""

    def __init__(self, torque: Callable[[Any, Any], Any], sample_time: float = 0.01) -> None:
        self.torque, self.sample_time = torque, sample_time

    def step(self, memory: Any, readings: Any, inputs: Any) -> Any:
        return memory, self.torque(readings, inputs)


class Script(Plain):
    """Given torques, one row per sample time and again from the first, for any readings.

    seen: the measurements so far.
    """

    def __init__(self, torques: Any, sample_time: float) -> None:
        self.torques = np.atleast_2d(torques)
        super().__init__(self._next, sample_time)

    def reset(self) -> None:
        self.seen: list[Any] = []

    def _next(self, t: float, measurement: Any, reference: Any) -> Any:
        self.seen.append(measurement)
        return self.torques[(len(self.seen) - 1) % len(self.torques)]
