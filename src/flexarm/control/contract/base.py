"""Base class of controllers, and checks of objects that act as one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import wraps
from typing import Any, Protocol
from weakref import WeakSet

from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_kind, check_number
from flexarm.base.errors import (
    InputError,
    Problem,
    check_array,
    public_call,
    shown,
    warn_deprecated,
)
from flexarm.control.contract.requirements import ControllerRequirements
from flexarm.control.hardware.measurement import FloatArray, Measurement

__all__ = ["Controller", "ControllerRequirements", "FloatArray", "Measurement", "Reference"]


class Reference(Protocol):
    """Motion that a controller follows, such as one from ``line_motion`` or ``joint_motion``."""

    def joint_angle(self, t: float) -> FloatArray:
        """Return the joint angles (joints,) at time t, rad."""

    def joint_rate(self, t: float) -> FloatArray:
        """Return the joint rates (joints,) at time t, rad/s."""

    def joint_acceleration(self, t: float) -> FloatArray:
        """Return the joint accelerations (joints,) at time t, rad/s^2."""


class Controller(ABC):
    """Base class of all controllers.

    ``simulate`` relies on these rules:

    1. ``sample_time`` (s) is constant during a run.
    2. ``reset`` is called once before a run and clears all state, so that runs are repeatable.
    3. ``update`` is called at 0, sample_time, 2 sample_time, ... in order, with the measurement at
       that time. It returns torques (joints,) N m, which a zero-order hold applies until the next
       call.
    4. ``update`` receives the measurement and the reference only, never the simulated state.
    5. ``requirements`` is called before ``reset`` and returns the requirements of the controller.
       ``simulate`` raises if one is not met.
    6. ``memory`` lists the attributes (numbers, truth values or arrays) that carry information from
       one sample to the next; None if they are not declared. The stability analysis of the sampled
       loop uses it. ``start_memory`` lists those that the first update stores and later ones do not
       change. With both, ``sensitivities`` differentiates runs with this controller.
    7. Everything that a controller stores is in its attributes. ``simulate_batch`` executes runs
       side by side, with a copy of the controller (``copy.deepcopy``) for each.
    8. If ``vectorized`` is true, ``update`` also accepts the readings of many runs at the same
       time, (runs, k) instead of (k,), and returns torques (runs, joints). Each row has the numbers
       of its run alone. ``simulate_batch`` then calls it once for all runs.

    Any object with ``sample_time``, ``reset`` and ``update`` is accepted; deriving from this class
    is optional.
    """

    sample_time: float
    memory: tuple[str, ...] | None = None
    start_memory: tuple[str, ...] = ()
    vectorized: bool = False

    def __init_subclass__(cls, **options: Any) -> None:
        """Wrap the methods of built-in controllers with checks of their arguments."""
        super().__init_subclass__(**options)
        if cls.__module__.startswith("flexarm."):
            checks = (
                ("update", _checked_update),
                ("feedback", _checked_update),
                ("requirements", _checked_requirements),
            )
            for name, checked in checks:
                if name in vars(cls):
                    setattr(cls, name, checked(vars(cls)[name]))

    def reset(self) -> None:  # noqa: B027  (most controllers keep nothing between samples)
        """Clear all state of the previous run."""

    @abstractmethod
    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> ArrayLike:
        """Return the joint torques (joints,) N m to apply from time t to the next sample."""

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """Return the requirements for controlling ``arm`` along ``reference``; none by default."""
        return ControllerRequirements()

    def needs(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """Return ``requirements``; deprecated name."""
        kind = type(self).__name__
        warn_deprecated(f"{kind}.needs", f"{kind}.requirements", "0.3")
        return self.requirements(arm, reference)

    def report(self) -> dict[str, float]:
        """Return numbers about the run since ``reset``, stored as attributes of its result."""
        return {}


def declares(controller: object, name: str) -> bool:
    """Return whether an attribute of a controller, such as ``memory``, is about its ``update``.

    It is not, if a base class has the attribute and a derived class overrides ``update``.
    """
    if name in getattr(controller, "__dict__", {}):
        return True
    for kind in type(controller).__mro__:
        if name in vars(kind):
            return True
        if "update" in vars(kind):
            return False
    return True


def _checked_update(update: Callable[..., FloatArray]) -> Callable[..., FloatArray]:
    @public_call
    @wraps(update)
    def checked(
        self: Controller, t: float, measurement: Measurement, reference: Reference | None
    ) -> FloatArray:
        # The tests are cheap because they run at every sample time. NaN fails the comparison.
        # A law that is exported is evaluated over symbols.
        if type(t) is not float and getattr(t, "symbolic", False):
            return update(self, t, measurement, reference)
        if type(t) is not float or not -_LATEST < t < _LATEST:
            t = check_number("t", t, _counts, f"be a time within {_LATEST:g} s")
        if not isinstance(measurement, Measurement):
            check_kind("measurement", measurement, Measurement)
        if reference is not None:
            check_reference(reference)
        return update(self, t, measurement, reference)

    return checked


def _checked_requirements(
    requirements: Callable[..., ControllerRequirements],
) -> Callable[..., ControllerRequirements]:
    @public_call
    @wraps(requirements)
    def checked(self: Controller, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        if reference is not None:
            check_reference(reference)
        found = requirements(self, check_kind("arm", arm, Arm), reference)
        if found.joints in (None, arm.joints):
            _check_feedforward(self, arm.joints)
        return found

    return checked


def _check_feedforward(controller: Any, joints: int) -> None:
    """Raise if a feedforward function does not return torques (joints,) at the first sample."""
    function = getattr(controller, "feedforward", None)
    if function is None:
        return
    t = 0.5 * controller.sample_time
    try:
        torque = function(t)
    except Exception:  # the run reports it, with the time
        return
    check_array(f"feedforward({t:g})", torque, (joints,))


#: Times beyond this (s) are rejected, because samples are counted in integers.
_LATEST = 1e12


def _counts(t: float) -> bool:
    return abs(t) < _LATEST


_REFERENCE = ("joint_angle", "joint_rate", "joint_acceleration")


def check_reference(reference: object) -> None:
    """Raise if an object lacks the methods of a `Reference`.

    Raises:
        InputError: if a method is missing, or the object is a class.
    """
    kind = type(reference)
    if kind in _KNOWN:
        return
    missing = [name for name in _REFERENCE if not callable(getattr(reference, name, None))]
    hint = "Create one with line_motion or joint_motion."
    if isinstance(reference, type):
        given = f"the class {reference.__name__}"
        raise InputError(Problem("reference", "be a reference", given, hint))
    if missing:
        rule = f"have the method{'s' * (len(missing) > 1)} {', '.join(missing)}"
        raise InputError(Problem("reference", rule, shown(reference), hint))
    if all(callable(getattr(kind, name, None)) for name in _REFERENCE):
        _KNOWN.add(kind)


#: Classes that passed the check. They are cached because the check runs at every sample time.
_KNOWN: WeakSet[type] = WeakSet()


def requirements_of(
    controller: object, arm: Arm, reference: Reference | None
) -> ControllerRequirements:
    """Return the requirements of any controlling object; none if it does not declare them."""
    declared = getattr(controller, "requirements", None)
    if _has_former_name(controller):
        kind = type(controller).__name__
        warn_deprecated(f"{kind}.needs", f"{kind}.requirements", "0.3")
        declared = getattr(controller, "needs", None)
    found = declared(arm, reference) if callable(declared) else None
    return found if isinstance(found, ControllerRequirements) else ControllerRequirements()


def _has_former_name(controller: object) -> bool:
    """Return whether a class defines ``needs`` and no subclass of it ``requirements``."""
    for base in type(controller).__mro__:
        if "requirements" in vars(base):
            return False
        if "needs" in vars(base):
            return True
    return False


def report_of(controller: object) -> dict[str, float]:
    """Return the report of any controlling object about its run; empty if it has none."""
    report = getattr(controller, "report", None)
    return dict(report()) if callable(report) else {}


def check_controller(name: str, value: object) -> None:
    """Check that a value acts as a controller.

    Raises:
        InputError: if it is a class, or lacks an attribute of controllers.
    """
    if isinstance(value, type):
        hint = f"Create an object: {value.__name__}(...)."
        raise InputError(Problem(name, "be a controller", f"the class {value.__name__}", hint))
    for method in ("reset", "update"):
        if not callable(getattr(value, method, None)):
            raise InputError(Problem(name, f"have the method {method}", shown(value)))
    if not hasattr(value, "sample_time"):
        raise InputError(Problem(name, "have a sample_time", shown(value)))
