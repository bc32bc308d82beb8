"""What a controller is: plain Python at a sample time, torque held in between."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

from numpy.typing import ArrayLike

from flexarm.arm import Arm
from flexarm.control.measurement import FloatArray, Measurement
from flexarm.control.needs import Needs
from flexarm.errors import Problem, shown

__all__ = ["Controller", "FloatArray", "Measurement", "Needs", "Reference"]


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
    5. ``needs`` tells what it relies on, before ``reset``; what is missing is refused there.

    Any object with the first three names will do; deriving from this class is a convenience.
    """

    sample_time: float

    def reset(self) -> None:  # noqa: B027  (most controllers keep nothing between samples)
        """Forget everything kept from a run before."""

    @abstractmethod
    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> ArrayLike:
        """Return the joint torques (joints,) N m to hold from time t on."""

    def needs(self, arm: Arm, reference: Reference | None) -> Needs:
        """Return what it relies on to control ``arm`` along ``reference``; here, nothing."""
        return Needs()

    def report(self) -> dict[str, float]:
        """Return numbers about the run since ``reset``, attributes of its result; here, none."""
        return {}


def needs_of(controller: object, arm: Arm, reference: Reference | None) -> Needs:
    """Return what any object that controls relies on; nothing where it does not say."""
    tell = getattr(controller, "needs", None)
    told = tell(arm, reference) if callable(tell) else None
    return told if isinstance(told, Needs) else Needs()


def report_of(controller: object) -> dict[str, float]:
    """Return what any controlling object reports about its run; nothing if it has no report."""
    report = getattr(controller, "report", None)
    return dict(report()) if callable(report) else {}


def controller_problem(where: str, name: str, value: object) -> Problem | None:
    """Return why a value is no controller; None where it is one."""
    if isinstance(value, type):
        hint = f"Make one: {value.__name__}(...)."
        rule = "be a controller"
        return Problem(where, name, rule, f"the class {value.__name__}", hint)
    for method in ("reset", "update"):
        if not callable(getattr(value, method, None)):
            return Problem(where, name, f"have the method {method}", shown(value))
    if not hasattr(value, "sample_time"):
        return Problem(where, name, "have a sample_time, s", shown(value))
    return None
