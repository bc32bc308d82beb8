"""Runs of scenario files, and their start, through the functions of the Python interface."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from inspect import Parameter, signature
from os import PathLike
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions import place_contacts
from flexarm.arm.arm import Arm, described_arm
from flexarm.arm.assembly.coordinates import turning_joints
from flexarm.arm.bending import one_warning
from flexarm.base.arguments import check_path
from flexarm.base.errors import InputError, Problem, SimulationError, public_call, raise_any
from flexarm.base.late import xr
from flexarm.cases.scenario.file_errors import Where, problems_at, problems_under
from flexarm.cases.scenario.references import (
    Followed,
    TaskReference,
    motion_of,
    reference_of,
    torque_of,
)
from flexarm.control.contract.base import Controller
from flexarm.control.filters.estimator import StateEstimator
from flexarm.control.filters.kalman_filter import ExtendedKalmanFilter, UnscentedKalmanFilter
from flexarm.control.filters.moving_horizon import MovingHorizonEstimator
from flexarm.control.laws import CONTROLLERS
from flexarm.integrate.base import FloatArray
from flexarm.linear import assembled, equilibrium
from flexarm.linear.bent_references import PressedMotion
from flexarm.model import (
    AccelerationTable,
    Change,
    EventSpec,
    FactorTable,
    Hardware,
    HeldJoint,
    Load,
    Scenario,
    TabulatedJoint,
    TorqueDrive,
    file_text,
    locate_scenario,
)
from flexarm.model.drives import (
    FEEDFORWARD_DRIVES,
    ControllerDrive,
    FlexibleTorqueDrive,
    RigidInverseDynamicsDrive,
    in_volts,
)
from flexarm.model.wording import path_of
from flexarm.motion import Motion
from flexarm.simulation.calls.preparation import implausible_run
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.histories.loads import PrescribedAngle, constant, interpolated
from flexarm.simulation.histories.piecewise import PiecewiseCubic, sampled_torque
from flexarm.simulation.loop.control_loop import misfits
from flexarm.simulation.loop.stability import (
    AnalysedLoop,
    Stability,
    stability,
)
from flexarm.simulation.run.changes import arm_changes
from flexarm.simulation.run.contacts import refuse_deep_start, refuse_pressing_outward
from flexarm.simulation.run.events import event_log, events_of
from flexarm.simulation.run.integrator_choice import check_integrator
from flexarm.simulation.run.tolerance import RTOL


@dataclass(frozen=True, eq=False)
class Start:
    """Initial state of a scenario."""

    q: FloatArray  # (dof,) coordinates
    prescribed: dict[int, PrescribedAngle | Motion]  # motions of joints, by number from 1
    holding: FloatArray | None = None  # (joints,) N m in equilibrium, to add to the drive, or None


def start_of(
    arm: Arm, scenario: Scenario, motion: Motion | PressedMotion | None, followed: Followed
) -> Start:
    """Return the start of a scenario; that of a flexible reference has bent links.

    Raises:
        EquilibriumError: if an equilibrium is requested and none is found.
    """
    asked = scenario.initial
    angles = np.zeros(arm.n_joints)
    if asked.joint_angle is not None:
        angles = np.array(asked.joint_angle)
    elif followed.initial is not None:
        angles = arm.joint_angles(followed.initial).copy()
    elif motion is not None:
        angles = np.array(motion.joint_angle(0.0))
    prescribed: dict[int, PrescribedAngle | Motion] = {}
    numbers = arm.joint_numbers.tolist()
    for spec in scenario.prescribed:
        place = numbers.index(spec.joint)
        own: PrescribedAngle | Motion
        if isinstance(spec, TabulatedJoint):
            own = PrescribedAngle.table(spec.times, spec.angles, spec.ends)
            angles[place] = own.angle(0.0)
        elif isinstance(spec, HeldJoint):
            own = PrescribedAngle.hold(angles[place])
        else:
            assert isinstance(motion, Motion)  # checked when the file is read
            own = motion
            angles[place] = motion.joint_angle(0.0)[place]
        prescribed[spec.joint] = own
    if not asked.equilibrium:
        chosen = asked.joint_angle is not None or prescribed
        if followed.initial is not None and not chosen:
            q = followed.initial.copy()
            if asked.base_position is not None:
                places = [coordinate.place for coordinate in arm.assembly.base]
                q[places] = arm.rest(angles, asked.base_position)[places]
            return Start(q, prescribed)
        return Start(arm.rest(angles, asked.base_position), prescribed)
    loads = [_load_at_start(load) for load in scenario.loads]
    base, contacts = scenario.base_acceleration, scenario.contacts
    if isinstance(base, AccelerationTable):
        base = interpolated(base).at(np.zeros(1))[0]
    with one_warning(report=False):  # the run warns of its states, including this one
        found = equilibrium(arm, angles, loads=loads, base_acceleration=base, contacts=contacts)
    return Start(found.q, prescribed, found.torque if asked.balance else None)


def _closed_start(arm: Arm, options: dict[str, Any]) -> dict[str, Any]:
    """Return the start near a given one that closes the loops."""
    # Prescribed joints, and joints with a rate, stay as they are given.
    q, rates = options["initial"], options.get("initial_rate", np.zeros(arm.dof))
    moving = arm.joint_numbers[arm.joint_angles(rates) != 0.0].tolist()
    closed = assembled(arm, q, rates, held=sorted({*options.get("prescribed", ()), *moving}))
    return {"initial": closed.q, "initial_rate": closed.qd}


def _load_at_start(load: Load) -> Load:
    """Return a load with its constant value at time zero; at a jump of its factor, after it."""
    if load.factor is None:
        return load
    assert isinstance(load.factor, FactorTable)  # checked when the file is read
    factor = interpolated(load.factor).at(np.zeros(1))
    return load.replace(factor=None).scaled(float(factor[0, 0]))


#: Time (s) before every motion, at which torques are those of the arm at rest.
_LONG_BEFORE = -1e9


@dataclass(frozen=True, eq=False)
class _Balanced:
    """Torques along a motion, plus a constant for the equilibrium of the arm at the start.

    The torques do not include the loads, and rigid torques not the sag of the links.
    """

    vectorized: ClassVar[bool] = True

    torque: Any
    more: FloatArray  # (joints,)

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(getattr(self.torque, "breaks", ()))

    def __call__(self, t: ArrayLike) -> FloatArray:
        return np.asarray(self.torque(t)) + self.more


def with_holding(torque: Callable[[Any], Any] | None, start: Start) -> Callable[[Any], Any] | None:
    """Return a torque along a motion, corrected for the equilibrium at the start.

    The correction applies if the start has a holding torque. Without a torque the result is the
    holding torque, or None.
    """
    holding = start.holding
    if torque is None:
        return None if holding is None else partial(constant, holding)
    if holding is None:
        return torque
    return _Balanced(torque, holding - np.asarray(torque(_LONG_BEFORE)))


#: Keys of the file for arguments of the calls that create a reference.
_TOP = {"motion": ".motion", "reference.motion": ".motion"}


@dataclass(frozen=True, eq=False)
class Prepared:
    """Validated scenario, converted to objects and ready to run."""

    arm: Arm
    motion: TaskReference | None  # its requested motion, or None
    followed: Followed  # the reference of the controller; the requested motion without one
    options: dict[str, Any]  # arguments of ``simulate``
    text: str  # the scenario as a file, which results contain
    #: requested events; those in ``options`` are created for ``arm``
    events: Sequence[EventSpec] = ()
    #: whether the torque in ``options`` is that of voltages of the motors of ``arm``
    in_volts: bool = False

    def implausible(self) -> list[str]:
        """Return a sentence for each implausible number of the run."""
        options = self.options
        angles = self.arm.joint_angles(options["initial"])[turning_joints(self.arm)]
        others = (options.get(name) for name in ("controller", "reference", "hardware"))
        return implausible_run(self.arm, options["duration"], options.get("rate"), angles, *others)

    @property
    def sample_time(self) -> float | None:
        """Sample time of the controller, s; None without a controller."""
        controller = self.options.get("controller")
        return None if controller is None else float(controller.sample_time)

    def stability(
        self,
        plant: Arm | None = None,
        hardware: Hardware | None = None,
        changes: Sequence[Change] = (),
    ) -> Stability:
        """Analyse the loop of the scenario, or of other arguments."""
        options = self.options
        if "controller" not in options:
            return Stability("", np.nan)
        simulated, duration = plant or self.arm, options["duration"]
        log = event_log(self.arm, options.get("events", ()))
        both = [*options.get("changes", ()), *changes]
        coming = arm_changes(simulated, both, duration, log)
        loop = AnalysedLoop(
            self.arm,
            simulated,
            options["controller"],
            options["reference"],
            hardware or options.get("hardware"),
            options.get("contacts", ()),
            simulated.rest(self.arm.joint_angles(options["initial"])),
            duration,
        )
        return stability(loop, changed=coming.ahead(duration) if coming else ())

    def arguments(
        self,
        *,
        plant: Arm | None = None,
        loads: Sequence[Load] = (),
        changes: Sequence[Change] = (),
        **instead: Any,
    ) -> dict[str, Any]:
        """Return the arguments of ``simulate``; the arguments are those of ``run``."""
        options = dict(self.options)
        if plant is not None:
            options["plant"] = plant
            if self.in_volts:  # the motors of the simulated arm convert the same voltages
                one = np.ones(plant.n_joints)
                factors = plant.motor_torque(one) / self.arm.motor_torque(one)
                options["torque"] = options["torque"].scaled(factors)
        options |= instead
        for name, more in (("loads", loads), ("changes", changes)):
            if more:
                options[name] = [*options.get(name, ()), *more]
        return options

    def run(
        self,
        *,
        arm: Arm | None = None,
        plant: Arm | None = None,
        loads: Sequence[Load] = (),
        changes: Sequence[Change] = (),
        progress: bool | None = None,
        **instead: Any,
    ) -> xr.Dataset:
        """Simulate the scenario, optionally with other arguments.

        Args:
            arm: arm with the same number of joints to use instead, such as the rigid model.
            plant: arm to simulate, while the controller keeps the scenario's arm as its model.
            loads, changes: those in addition to the scenario's.
            progress: True or False shows or hides the progress bar.
            instead: arguments of ``simulate`` in place of those of the scenario.
        """
        options = self.arguments(plant=plant, loads=loads, changes=changes, **instead)
        if arm is not None:
            options["initial"] = arm.rest(self.arm.joint_angles(options["initial"]))
            if "initial_rate" in options:
                rates = self.arm.joint_angles(options["initial_rate"])
                options["initial_rate"] = arm.rest(rates)
            options["events"] = events_of(self.events, arm)
        try:
            result = simulate(arm or self.arm, progress=progress, **options)
        except SimulationError as error:
            if error.result is not None:
                error.result.attrs |= self._attributes()
            raise
        result.attrs |= self._attributes()
        return result

    def _attributes(self) -> dict[str, str]:
        """Return the attributes of results: the file, and the reference of a controller."""
        if "controller" not in self.options:
            return {"scenario": self.text}
        return {"scenario": self.text, "reference_kind": self.followed.kind}


def prepare(
    scenario: Scenario,
    place: Where = lambda _: "scenario",
    motion: TaskReference | None = None,
    followed: Followed | None = None,
    arm: Arm | None = None,
) -> Prepared:
    """Create the arm, the motion and the drive of a scenario.

    Args:
        scenario: the scenario to run.
        place: function from key path to location in its file, for messages.
        motion: the scenario's motion, if it already exists.
        followed: the reference of its drive, if it already exists.
        arm: its arm, if that already exists.

    Raises:
        InputError: if the motion leaves the arm's reach, or a part of the scenario does not fit
            the arm or the run.
        EquilibriumError: if no equilibrium is found for the start.

    Warns:
        ImplausibleValueWarning: if numbers of a new arm look like those of another unit.
    """
    if arm is None:
        with problems_at(place, ""):
            arm = described_arm(scenario.arm)
    if motion is None:
        with problems_at(place, "motion"):
            motion = motion_of(arm, scenario)
    run = scenario.run
    options: dict[str, Any] = {name: value for name, value in run if value is not None}
    for name in ("hardware", "loads", "base_acceleration", "contacts", "changes"):
        if given := getattr(scenario, name):
            options[name] = given
    if scenario.events:
        options["events"] = events_of(scenario.events, arm)
    if followed is None:
        with problems_at(place, "drive", _TOP):
            followed = _followed(arm, scenario, motion)
    with problems_at(place, "initial"):
        start = start_of(arm, scenario, motion, followed)
    options["initial"] = start.q
    rate, velocity = scenario.initial.joint_rate, scenario.initial.base_velocity
    if rate is not None or velocity is not None:
        joint_rate = np.zeros(arm.n_joints) if rate is None else rate
        options["initial_rate"] = arm.rest(joint_rate, velocity)
    if start.prescribed:
        options["prescribed"] = start.prescribed
    if arm.closure_rows and not scenario.initial.equilibrium:
        with problems_at(place, "initial", {"q": "joint_angle", "qd": "joint_rate"}):
            options |= _closed_start(arm, options)
    with problems_at(place, "drive", {"torque": "values", "torque_interpolation": "interpolation"}):
        _set_drive(arm, scenario, motion, followed, start, options)
    check_fit(arm, scenario, place, options)
    with problems_at(place, "run"):
        check_integrator(run.integrator, run.step, bool(scenario.contacts))
    if scenario.contacts:
        _check_touch(arm, place, options, motion)
    text, volts = file_text(scenario), in_volts(scenario.drive)
    return Prepared(arm, motion, followed, options, text, scenario.events, volts)


def _check_touch(
    arm: Arm, place: Where, options: dict[str, Any], motion: TaskReference | None
) -> None:
    """Raise the errors that contacts cause at the beginning of the run."""
    contacts = options["contacts"]
    placed = place_contacts(arm, contacts)
    q = np.asarray(options["initial"])
    state = arm.padded(np.stack([q, np.zeros_like(q)]))
    with problems_at(place, "initial", {"initial": "joint_angle"}):
        refuse_deep_start(arm, state, placed)
    with problems_at(place, "motion", {"reference.normal": "normal"}):
        refuse_pressing_outward(arm, contacts, placed, motion, options["duration"])


def check_fit(arm: Arm, scenario: Scenario, place: Where, options: dict[str, Any]) -> None:
    """Raise if the requirements of a drive are not met; ``options``: arguments of ``simulate``."""
    if "controller" not in options:
        return
    found = misfits(
        options["controller"],
        arm,
        options["reference"],
        options.get("hardware"),
        len(scenario.contacts),
        called=scenario.drive.kind,
    )
    names = {"hardware": "hardware.instruments", "controller": "drive"}
    problems = []
    for problem in found:
        name = names.get(problem.name, problem.name)
        problems.append(replace(problem, where=place(path_of(name)), name=name))
    raise_any(problems)


@public_call
def run_scenario(
    scenario: Scenario | str | PathLike[str], *, progress: bool | None = None
) -> xr.Dataset:
    """Simulate a scenario, given as an object or as the path of its file.

    Raises:
        ModelError: if the file is not valid; it lists every problem with its line.
        InputError, SimulationError: under the conditions of ``simulate``.
    """
    if isinstance(scenario, Scenario):
        return prepare(scenario).run(progress=progress)
    located = locate_scenario(check_path("scenario", scenario))
    return prepare(*located).run(progress=progress)


def _followed(arm: Arm, scenario: Scenario, motion: TaskReference | None) -> Followed:
    """Return the reference of a drive that is a controller, or the torque of another one."""
    drive = scenario.drive
    if isinstance(drive, ControllerDrive):
        return reference_of(arm, drive, motion)
    if drive.kind in FEEDFORWARD_DRIVES:
        assert isinstance(motion, Motion)  # checked when the file is read
        return torque_of(arm, drive, motion)
    return Followed(motion)


def _set_drive(
    arm: Arm,
    scenario: Scenario,
    motion: TaskReference | None,
    followed: Followed,
    start: Start,
    options: dict[str, Any],
) -> None:
    drive = scenario.drive
    plain = motion if isinstance(motion, Motion) else None
    if isinstance(drive, TorqueDrive):
        values: Any = drive.values
        if in_volts(drive):
            values = arm.motor_torque(values)
        history = sampled_torque(
            values, drive.rate, scenario.run.duration, arm.n_joints, drive.interpolation
        )
        history = history if start.holding is None else history.shifted(start.holding)
        if options.keys().isdisjoint(("accuracy", "step")):
            history = history.stopping_where_rough(options.get("rtol", RTOL))
        options["torque"] = history
        options["torque_interpolation"] = drive.interpolation
    elif drive.kind in FEEDFORWARD_DRIVES:
        options["torque"] = with_holding(followed.torque, start)
    elif isinstance(drive, ControllerDrive):
        around = DriveContext(arm, plain, followed, start, options.get("hardware"))
        options["controller"] = controller_of(drive, around)
        options["reference"] = followed.motion
    elif start.holding is not None:
        options["torque"] = PiecewiseCubic.constant(start.holding)


@dataclass(frozen=True, eq=False)
class DriveContext:
    """Objects of the scenario that the keys of a drive refer to."""

    arm: Arm  # the controllers' model of the arm
    motion: Motion | None  # of the rigid model, or None
    followed: Followed  # the reference of the controller, with its torque
    start: Start  # of the run
    hardware: Hardware | None  # of the scenario, or None


def controller_of(drive: ControllerDrive, around: DriveContext) -> Controller:
    """Create the controller that a drive describes."""
    given: dict[str, Any] = {}
    for name in type(drive).model_fields:
        value = getattr(drive, name)
        if name == "feedforward":
            value = feedforward_kind(drive, around)
        if name in ("kind", "reference") or value is None:  # the class's own default
            continue
        make = _MADE.get(name)
        given |= {name: value} if make is None else make(value, around)
    kind: Any = CONTROLLERS[drive.kind]  # type: ignore[attr-defined]
    needed = signature(kind).parameters.get("arm")
    if needed is not None and needed.default is Parameter.empty:
        given["arm"] = around.arm
    made: Controller = kind(**given)
    return made


def feedforward_kind(drive: Any, around: DriveContext) -> str:
    """Return the kind of feedforward of a drive: the given one, or by default the reference."""
    # Gravity compensation replaces it, and so does the model of computed torque on a rigid arm.
    if drive.feedforward is not None:
        return str(drive.feedforward)
    compensated = getattr(drive, "gravity", "none") != "none"
    modelled = drive.kind == "computed_torque" and around.followed.initial is None
    return "none" if compensated or modelled else "reference"


def _feedforward(asked: str, around: DriveContext) -> dict[str, Any]:
    torque = None
    if asked == "reference":
        torque = around.followed.torque
    elif asked != "none" and around.motion is not None:
        torque = torque_of(around.arm, FEEDFORWARDS[asked](), around.motion).torque
    return {"feedforward": with_holding(torque, around.start)}


def _inner(drive: ControllerDrive, around: DriveContext) -> dict[str, Any]:
    with problems_under("inner"):
        return {"inner": controller_of(drive, around)}


def _estimator(spec: Any, around: DriveContext) -> dict[str, Any]:
    instruments = spec.instruments
    if instruments is None:
        instruments = (around.hardware and around.hardware.instruments) or ()
    if not instruments:
        rule = "are required, because the hardware has none"
        raise InputError(Problem("estimator.instruments", rule))
    kind = FILTERS[spec.kind]
    names = [name for name in type(spec).model_fields if name in signature(kind).parameters]
    options = {name: getattr(spec, name) for name in names}
    options["instruments"] = list(instruments)
    with problems_under("estimator"):
        return {"estimator": kind(around.arm, **options)}


def _hardware(asked: bool, around: DriveContext) -> dict[str, Any]:
    if asked and around.hardware is None:
        raise InputError(Problem("hardware", "requires the key hardware at the top of the file"))
    return {"hardware": around.hardware} if asked else {}


#: Drives without feedback whose torque can be a feedforward, by the value of the key.
FEEDFORWARDS: dict[str, Callable[[], Any]] = {
    "rigid_inverse_dynamics": RigidInverseDynamicsDrive,
    "flexible_torque": FlexibleTorqueDrive,
}

#: Estimators, by the kind of a filter.
FILTERS: dict[str, Callable[..., StateEstimator]] = {
    "extended": ExtendedKalmanFilter,
    "unscented": UnscentedKalmanFilter,
    "moving_horizon": MovingHorizonEstimator,
}

#: Functions that convert the value of a key to arguments, for keys that are not arguments.
_MADE: dict[str, Callable[[Any, DriveContext], dict[str, Any]]] = {
    "estimator": _estimator,
    "feedforward": _feedforward,
    "gravity": lambda asked, around: {
        "arm": None if asked == "none" else around.arm,
        "sag": asked == "sag",
    },
    "hardware": _hardware,
    "inner": _inner,
}
