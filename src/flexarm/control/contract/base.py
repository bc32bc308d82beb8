"""Base class of controllers, their requirements, and checks of objects that act as one."""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Iterator, Mapping
from functools import wraps
from types import MethodType
from typing import Any, NamedTuple, Protocol, cast
from weakref import WeakSet

import numpy as np
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
from flexarm.control.hardware.measurement import FloatArray, Measurement
from flexarm.model.quantities import length_of

__all__ = ["Controller", "ControllerRequirements", "FloatArray", "Measurement", "Reference"]

#: Readings that nearly every controller uses.
JOINTS = ("joint_angle", "joint_rate")


class ControllerRequirements(NamedTuple):
    """Requirements of a controller; None and empty entries are not checked.

    Attributes:
        joints: number of joints of the controller's arm.
        measured: names that it reads from every measurement.
        gauges: length of the strain reading.
    """

    joints: int | None = None
    measured: tuple[str, ...] = ()
    gauges: int | None = None


def joints_of(expected: int, *numbers: FloatArray) -> int:
    """Return the number of joints of lists: the first length other than ``expected``, if any."""
    lengths = [len(value) for value in numbers if np.ndim(value)]
    return next((length for length in lengths if length != expected), expected)


class Reference(Protocol):
    """Motion that a controller follows, such as one from ``line_motion`` or ``joint_motion``."""

    def joint_angle(self, t: float) -> FloatArray:
        """Return the joint angles (joints,) at time t, rad."""

    def joint_rate(self, t: float) -> FloatArray:
        """Return the joint rates (joints,) at time t, rad/s."""

    def joint_acceleration(self, t: float) -> FloatArray:
        """Return the joint accelerations (joints,) at time t, rad/s^2."""


def _checked_update(update: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(update)
    def checked(
        self: Controller, t: float, measurement: Measurement, reference: Reference | None
    ) -> Any:
        # The tests are cheap because they run at every sample time. NaN fails the comparison.
        if type(t) is not float or not -_LATEST < t < _LATEST:
            t = check_number("t", t, _counts, f"be a time within {_LATEST:g} s")
        if not isinstance(measurement, Measurement):
            check_kind("measurement", measurement, Measurement)
        if reference is not None:
            check_reference(reference)
        return update(self, t, measurement, reference)

    call = public_call(checked)
    _UNCHECKED[call] = public_call(update)
    return call


#: For each ``update`` with checks the same without them. An attribute of the function would be
#: copied by ``functools.wraps`` to a user's function around it, which would then never be called.
_UNCHECKED: dict[Callable[..., Any], Callable[..., Any]] = {}


def update_of(controller: Any) -> Callable[..., Any]:
    """Return ``update`` of a controller for a loop, whose arguments need no checks."""
    if isinstance(controller, Controller) and "update" not in vars(controller):
        unchecked = _UNCHECKED.get(type(controller).update)
        if unchecked is not None:
            return MethodType(unchecked, controller)
    return cast("Callable[..., Any]", controller.update)


def _checked_requirements(
    requirements: Callable[..., ControllerRequirements],
) -> Callable[..., ControllerRequirements]:
    @public_call
    @wraps(requirements)
    def checked(self: Controller, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        if reference is not None:
            check_reference(reference)
        found = requirements(self, check_kind("arm", arm, Arm), reference)
        if found.joints in (None, arm.n_joints):
            _check_feedforward(self, arm.n_joints)
        return found

    return checked


class Rest:
    """Reference at rest at the first measured joint angles, for a loop without a reference.

    Attributes:
        angle: (joints,) rad, or (runs, joints) of many runs; empty if they are not measured.
    """

    vectorized = True

    def __init__(self, measurement: Mapping[str, Any]) -> None:
        self.angle: FloatArray = np.array(measurement.get("joint_angle", ()))
        self._still: FloatArray = 0.0 * self.angle

    def joint_angle(self, t: Any) -> FloatArray:
        """Return the joint angles, (joints,) or (T, joints), rad."""
        return self.angle if np.ndim(t) == 0 else np.tile(self.angle, (len(t), 1))

    def joint_rate(self, t: Any) -> FloatArray:
        """Return zeros, rad/s."""
        return self._still if np.ndim(t) == 0 else np.tile(self._still, (len(t), 1))

    joint_acceleration = joint_rate


#: Named arrays: the memory of a law, or its planned inputs.
Arrays = Mapping[str, Any]
#: The result of a step: the next memory, and torques (joints,) N m.
Step = tuple[Arrays, Any]


class Controller(ABC):
    """Base class of all controllers.

    A controller is written as a *law*: a pure step from one sample to the next. ``update``,
    ``reset`` and ``memory`` follow from it, and many runs, poles and margins, derivatives of runs
    and exported C code evaluate the step itself.

    1. ``step`` returns the next memory and the torques (joints,) N m, which a zero-order hold
       applies until the next sample. It depends on its arguments and on the parameters of the
       controller only, and changes no attribute and no argument.
    2. The memory is a dictionary of arrays. ``initial_memory`` returns that of the first sample;
       the names and shapes stay the same. Not differentiated are numbers that are no floats, such
       as counters and truth values, and names with an underscore: iterates that change little.
    3. ``planned`` returns the inputs of a sample that are known in advance, by name: those of the
       reference by default. Exported code has them as arguments, or, if ``exports_plan`` is true,
       computes them from the reference at the time of the sample alone. Without a reference, a
       loop follows a `Rest` at its first measured angles.
    4. ``sample_time`` (s) is constant during a run. ``reset`` is called once before a run; then
       ``update`` is called at 0, sample_time, 2 sample_time, ... in order.
    5. ``requirements`` is called before ``reset`` and returns the requirements of the controller.
       ``simulate`` raises if one is not met.
    6. If ``vectorized`` is true, ``step`` also accepts the readings and the memory of many runs,
       (runs, k) instead of (k,), and returns torques (runs, joints). Each row has the numbers
       of its run alone. If ``analytic`` is true, too, ``step`` accepts complex readings and memory
       and is an analytic function of them, except at limits; its derivatives are then exact.
    7. If ``linearizable`` is false, loops have no poles and margins: too many numbers change.
    8. If ``compensates_friction`` is false, no feedback depends on the dry friction of its arm:
       poles and margins are then those of sliding joints, also without a reference.
    9. If ``knows_limits`` is true, simulations reduce ``torque_limit``, None or an array
       (joints,) N m, to that of the motors.

    A class with an ``update`` of its own instead of ``step`` is accepted, and so is any object with
    ``sample_time``, ``reset`` and ``update``: by ``simulate``, ``simulate_batch`` (with a copy,
    ``copy.deepcopy``, for each run), ``compare`` and ``Plant``, and within other controllers. Its
    loops have no poles, margins and derivatives, and it is not exported.
    """

    sample_time: float
    vectorized: bool = False
    analytic: bool = False
    linearizable: bool = True
    compensates_friction: bool = True
    knows_limits: bool = False
    exports_plan: bool = False
    _memory: Arrays | None = None
    _rest: Rest | None = None

    def __init_subclass__(cls, **options: Any) -> None:
        """Wrap the methods of built-in controllers with checks of their arguments."""
        super().__init_subclass__(**options)
        if isinstance(vars(cls).get("memory"), tuple):
            name = f"The tuple {cls.__name__}.memory"
            warn_deprecated(name, "step and initial_memory, from which margins follow", "0.3")
        if cls.__module__.startswith("flexarm."):
            for name in {"update", "feedback", "requirements"} & vars(cls).keys():
                checked = _checked_requirements if name == "requirements" else _checked_update
                setattr(cls, name, checked(vars(cls)[name]))

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the inputs at time t (s) that are known in advance, by name."""
        places = {"reference_angle": reference.joint_angle(t)}
        rates = {"reference_rate": reference.joint_rate(t)}
        return places | rates | {"reference_acceleration": reference.joint_acceleration(t)}

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        """Return the memory before the first step, by name; empty by default."""
        return {}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        """Return the next memory, and the torques (joints,) N m of a sample."""
        raise NotImplementedError(f"{type(self).__name__} has no step")

    @property
    def memory(self) -> Arrays:
        """Memory after the last update, by name; empty after ``reset``."""
        return {} if self._memory is None else self._memory

    @memory.setter
    def memory(self, value: Arrays) -> None:
        self._memory = value

    def reset(self) -> None:
        """Clear all state of the previous run."""
        self._memory = self._rest = None

    @_checked_update
    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> ArrayLike:
        """Return the joint torques (joints,) N m to apply from time t to the next sample."""
        inputs = self.planned(t, self._reference_or_rest(measurement, reference))
        memory = self._memory
        if memory is None:
            memory = self.initial_memory(measurement, inputs)
        after, torque = self.step(memory, measurement, inputs)
        self._keep(after)
        return cast("ArrayLike", torque)

    def _limit_torque(self, limit: Any) -> None:
        """Set ``torque_limit``, N m, of a law that knows limits."""
        vars(self)["torque_limit"] = limit

    def _keep(self, memory: Arrays) -> None:
        """Store the memory after an update."""
        self._memory = memory

    def _reference_or_rest(
        self, measurement: Measurement, reference: Reference | None
    ) -> Reference:
        """Return the reference; without one, rest at the angles of the first measurement."""
        if reference is not None:
            return reference
        if self._rest is None:
            self._rest = Rest(measurement)
        return self._rest

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


class UpdateLaw(Controller):
    """Controller with an ``update`` alone, as a part of a law: its state stays in the object.

    Such a law is not pure: it is for runs only.
    """

    def __init__(self, controller: Any) -> None:
        self.controller = controller

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the time and the reference itself."""
        return {"time": t, "reference": reference}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        reference = inputs["reference"]
        if "reference_angle" in inputs:
            reference = ShiftedReference(inputs, reference)
        elif isinstance(reference, Rest):
            reference = None
        return memory, np.asarray(self.controller.update(inputs["time"], readings, reference))


class ShiftedReference:
    """Reference with given angles and rates at one sample time; else that of another reference."""

    def __init__(self, inputs: Arrays, outer: Reference) -> None:
        self._angle, self._rate = inputs["reference_angle"], inputs["reference_rate"]
        self.joint_acceleration = outer.joint_acceleration

    def joint_angle(self, t: float) -> FloatArray:
        """Return the joint angles (joints,), rad."""
        return cast("FloatArray", self._angle)

    def joint_rate(self, t: float) -> FloatArray:
        """Return the joint rates (joints,), rad/s."""
        return cast("FloatArray", self._rate)


def law_of(controller: Any) -> Controller:
    """Return a controller whose torque is that of its step, or the `UpdateLaw` of another one."""
    own = controller if isinstance(controller, Controller) and _steps(controller) else None
    return own or UpdateLaw(controller)


def around(controller: Any) -> Iterator[Any]:
    """Iterate over a controller, the controller inside it, and so on."""
    while controller is not None:
        yield controller
        controller = getattr(controller, "inner", None)


def has_poles(controller: Any) -> bool:
    """Return whether the loop of a controller has poles and margins."""
    return is_law(controller) and all(law.linearizable for law in around(controller))


def is_law(controller: Any) -> bool:
    """Return whether the torque of a controller, and of that inside it, is that of a pure step."""
    return all(isinstance(law, Controller) and _steps(law) for law in around(controller))


def declares(controller: object, name: str) -> bool:
    """Return whether an attribute of a controller, such as ``vectorized``, is true of its law.

    It is not, if a base class has the attribute and a derived class overrides the law.
    """
    on_object = name in getattr(controller, "__dict__", {})
    of_law = on_object or _first_defined(controller, name, "update", "step") in (name, "")
    return of_law and bool(getattr(controller, name, False))


def _steps(controller: Controller) -> bool:
    """Return whether no class overrides ``update`` after ``step``."""
    on_object = "update" in vars(controller)
    return not on_object and _first_defined(controller, "update", "step") == "step"


def _first_defined(controller: object, *names: str) -> str:
    """Return the first of the names that the most derived class with any of them defines, or ""."""
    for kind in type(controller).__mro__:
        for name in names:
            if name in vars(kind):
                return name
    return ""


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
    """Raise if an object lacks the methods of a `Reference`."""
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
    if _first_defined(controller, "requirements", "needs") == "needs":
        kind = type(controller).__name__
        warn_deprecated(f"{kind}.needs", f"{kind}.requirements", "0.3")
        declared = getattr(controller, "needs", None)
    found = declared(arm, reference) if callable(declared) else None
    return found if isinstance(found, ControllerRequirements) else ControllerRequirements()


def report_of(controller: object) -> dict[str, float]:
    """Return the report of any controlling object about its run; empty if it has none."""
    report = getattr(controller, "report", None)
    return dict(report()) if callable(report) else {}


def check_controller(name: str, value: object) -> None:
    """Check that a value acts as a controller."""
    if isinstance(value, type):
        hint = f"Create an object: {value.__name__}(...)."
        raise InputError(Problem(name, "be a controller", f"the class {value.__name__}", hint))
    for method in ("reset", "update"):
        if not callable(getattr(value, method, None)):
            raise InputError(Problem(name, f"have the method {method}", shown(value)))
    if not hasattr(value, "sample_time"):
        raise InputError(Problem(name, "have a sample_time", shown(value)))


def numbers(values: Any) -> FloatArray:
    """Return values as an array of floats; an array of symbols of exported code is kept."""
    symbolic = getattr(values, "symbolic", False)
    array: FloatArray = values if symbolic else np.asarray(values, dtype=np.float64)
    return array


#: Number of sample times evaluated in one call.
_AHEAD = 512


class SampledFeedforward:
    """Feedforward torque of a controller at its sample times.

    Vectorized functions, such as those from ``rigid_torque``, are evaluated for ``_AHEAD`` sample
    times at once, because one call per sample takes a thousand times as long. Other functions are
    called directly, and so are vectorized functions at other times.

    Args:
        function: function of time (s) that returns torques (joints,) N m; if its attribute
            ``vectorized`` is true, it also takes times (T,) and returns (T, joints).
        sample_time: s.
        later: s, offset that is added to the sample time before the function is evaluated.
    """

    def __init__(
        self, function: Callable[[float], ArrayLike], sample_time: float, later: float = 0.0
    ) -> None:
        self._function = function
        self._sample_time = sample_time
        self._later = later
        self._many = bool(getattr(function, "vectorized", False))
        self._first = 0
        self._values: FloatArray = np.zeros((0, 0))

    def __call__(self, t: float) -> FloatArray:
        """Return the torques (joints,) N m at time t (s), of a vectorized function also many."""
        if np.ndim(t) and self._many:
            return np.asarray(self._function(t + self._later), dtype=np.float64)
        k = round(t / self._sample_time)
        if not self._many or k < 0 or k * self._sample_time != t:
            return numbers(self._function(t + self._later))
        if not self._first <= k < self._first + len(self._values):
            self._first = k
            count = _AHEAD if len(self._values) else 1  # an analysis evaluates one sample only
            times = np.arange(k, k + count) * self._sample_time + self._later
            self._values = np.asarray(self._function(times))  # type: ignore[arg-type]
        now: FloatArray = self._values[k - self._first]
        return now


def joint_problems(joints: int, given: Mapping[str, object]) -> list[Problem]:
    """Return a problem for each list that does not have one value for each joint."""
    rule = f"have length {joints}, one value for each joint"
    lengths = {name: length_of(value) for name, value in given.items()}
    wrong = {name: length for name, length in lengths.items() if length not in (None, joints)}
    return [Problem(name, rule, str(length)) for name, length in wrong.items()]


def applied(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return ``matrix @ vectors`` for a vector (k,), or for each of (runs, k) on its own.

    The matrix may be one for each run, (runs, j, k). Products are added in their order, which no
    library of matrices does: the result is the same for any number of runs, and in the program of a
    law.
    """
    if not vectors.shape[-1]:
        return np.zeros((*vectors.shape[:-1], matrix.shape[-2]))
    products = np.swapaxes(matrix, -1, -2) * vectors[..., None]
    sums: FloatArray = np.add.accumulate(products, axis=-2)[..., -1, :]
    return sums


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
        measured = tuple(dict.fromkeys([*JOINTS, *inner.measured]))
        count = joints if joints != arm.n_joints else inner.joints
        return ControllerRequirements(count, measured, inner.gauges)
