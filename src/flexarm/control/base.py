"""What a controller is: plain Python at a sample time, torque held in between."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import wraps
from typing import Any, Protocol
from weakref import WeakSet

from numpy.typing import ArrayLike

from flexarm.arguments import check_kind
from flexarm.arm import Arm
from flexarm.control.requirements import Needs
from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.hardware.measurement import FloatArray, Measurement

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
    6. ``memory`` names the attributes, numbers or arrays, by which one sample affects the next;
       None if it is not declared. The stability of the sampled loop is analysed with it.

    Any object with the first three names will do; deriving from this class is a convenience.
    """

    sample_time: float
    memory: tuple[str, ...] | None = None

    def __init_subclass__(cls, **options: Any) -> None:
        """Check the arguments of a built-in controller's methods before they are computed with."""
        super().__init_subclass__(**options)
        if cls.__module__.startswith("flexarm."):
            for name, checked in (("update", _checked_update), ("needs", _checked_needs)):
                if name in vars(cls):
                    setattr(cls, name, checked(vars(cls)[name]))

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


def _checked_update(update: Callable[..., FloatArray]) -> Callable[..., FloatArray]:
    @wraps(update)
    def checked(
        self: Controller, t: float, measurement: Measurement, reference: Reference | None
    ) -> FloatArray:
        # Cheap tests, as this runs at every sample time; NaN fails the comparison.
        if type(t) is not float or not -_LATEST < t < _LATEST:
            t = _time(f"{type(self).__name__}.update", t)
        if not isinstance(measurement, Measurement):
            where = f"{type(self).__name__}.update"
            check_kind(where, "measurement", measurement, Measurement)
        if reference is not None:
            check_reference(f"{type(self).__name__}.update", reference)
        return update(self, t, measurement, reference)

    return checked


def _checked_needs(needs: Callable[..., Needs]) -> Callable[..., Needs]:
    @wraps(needs)
    def checked(self: Controller, arm: Arm, reference: Reference | None) -> Needs:
        where = f"{type(self).__name__}.needs"
        if reference is not None:
            check_reference(where, reference)
        return needs(self, check_kind(where, "arm", arm, Arm), reference)

    return checked


#: Times beyond this (s) are mistakes: sample times are counted in integers.
_LATEST = 1e12


def _time(where: str, t: object) -> float:
    number = float(check_array(where, "t", t, ()))
    if abs(number) >= _LATEST:
        raise InputError(Problem(where, "t", f"be a time within {_LATEST:g} s", shown(t)))
    return number


_REFERENCE = ("joint_angle", "joint_rate", "joint_acceleration")


def check_reference(where: str, reference: object) -> None:
    """Refuse an object without joint angles, rates and accelerations over time.

    Raises:
        InputError: if a method is missing.
    """
    kind = type(reference)
    if kind in _KNOWN:
        return
    missing = [name for name in _REFERENCE if not callable(getattr(reference, name, None))]
    hint = "line_motion and joint_motion make references."
    if isinstance(reference, type):
        given = f"the class {reference.__name__}"
        raise InputError(Problem(where, "reference", "be a reference", given, hint))
    if missing:
        rule = f"have the method{'s' * (len(missing) > 1)} {', '.join(missing)}"
        raise InputError(Problem(where, "reference", rule, shown(reference), hint))
    if all(callable(getattr(kind, name, None)) for name in _REFERENCE):
        _KNOWN.add(kind)


#: Classes whose objects are references: looked at once, as controllers ask at every sample time.
_KNOWN: WeakSet[type] = WeakSet()


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
