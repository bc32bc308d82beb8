"""What a controller is: plain Python at a sample time, torque held in between."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

from numpy.typing import ArrayLike

from flexarm.control.measurement import FloatArray, Measurement

__all__ = ["Controller", "FloatArray", "Measurement", "Reference"]


class Reference(Protocol):
    """The motion to follow, such as ``line_motion`` or ``joint_motion`` make."""

    def joint_angle(self, t: float) -> FloatArray:
        """Joint angles (joints,) at time t, rad."""

    def joint_rate(self, t: float) -> FloatArray:
        """Joint rates (joints,) at time t, rad/s."""

    def joint_acceleration(self, t: float) -> FloatArray:
        """Joint accelerations (joints,) at time t, rad/s^2."""


class Controller(ABC):
    """Base of all controllers. The rules that ``simulate`` relies on:

    1. ``sample_time`` (s) is constant during a run.
    2. ``reset`` is called once before a run and makes two runs alike: no state survives it.
    3. ``update`` is called at 0, sample_time, 2 sample_time, ... in order, with what the sensors
       say at that moment, and returns torques (joints,) N m, held until the next call.
    4. It sees the measurement and the reference only, never the simulated state.

    Any object with these three names will do; deriving from this class is a convenience.
    """

    sample_time: float

    def reset(self) -> None:  # noqa: B027  (most controllers keep nothing between samples)
        """Forget everything kept from a run before."""

    @abstractmethod
    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> ArrayLike:
        """Return the joint torques (joints,) N m to hold from time t on."""
