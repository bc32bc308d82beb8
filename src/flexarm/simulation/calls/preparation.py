"""Preparation of runs: their checked arguments, initial state, torque over time, and creation."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from inspect import signature
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions import BaseAcceleration, Environment
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import check_joint
from flexarm.arm.closed import refuse_jamming, refuse_opening
from flexarm.base.arguments import (
    about_degrees,
    check_function,
    check_kind,
    check_mapping,
    check_positive,
)
from flexarm.base.errors import InputError, Problem, check_array, shown, unknown_arguments
from flexarm.base.user_functions import call
from flexarm.control.contract.base import Controller, Reference, check_controller, check_reference
from flexarm.integrate.base import FloatArray, Progress
from flexarm.model import Change, Contact, Hardware, Load
from flexarm.model.plausible import Number, Range, judge, weights
from flexarm.model.scenarios.scenario import RATE, recording_rate, sample_fault
from flexarm.simulation.histories.loads import LoadHistory, Prescribed, load_history, prescribe
from flexarm.simulation.histories.piecewise import PiecewiseCubic, function_history, sampled_torque
from flexarm.simulation.loop.control_loop import RunLoop
from flexarm.simulation.run.changes import arm_changes
from flexarm.simulation.run.coarse import choose
from flexarm.simulation.run.contacts import (
    contact_frequency,
    contacts_of_run,
    refuse_deep_start,
    refuse_pressing_outward,
)
from flexarm.simulation.run.default_step import default_step
from flexarm.simulation.run.events import Event, EventLog, Watch, event_log
from flexarm.simulation.run.integrator_choice import Choice, choose_integrator
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import (
    DEFAULTS,
    AllSettings,
    RunSettings,
    SampleSettings,
    close,
    relative_tolerance,
    replaced,
    request_of,
    settings_of,
    tolerances_of,
)
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.tolerance import tolerance_of

Torque = ArrayLike | Callable[[float], ArrayLike] | PiecewiseCubic
#: Samples in a run; samples of a controller; durations of a run and of its motion over each other.
_SAMPLES, _UPDATES = Range(1.0 - 1e-9, 1e3, np.inf), Range(1.0 - 1e-9, 1e3, np.inf)
_MOTION = Range(3e-3, 1.0, 500.0)
#: Largest torque of a motor over that by which the weight turns the horizontal arm.
_TORQUE = Range(1e-2, 3.0, 1e5)


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation:
    """Arguments of a run, with the meaning that ``simulate`` gives them.

    Creating it validates the objects; the rest is validated when a run is created.
    """

    arm: Arm
    duration: float  # s
    settings: RunSettings = DEFAULTS
    torque: Torque | None = None
    controller: Controller | None = None
    reference: Reference | None = None
    plant: Arm | None = None
    hardware: Hardware | None = None
    prescribed: Prescribed | None = None
    initial: ArrayLike | None = None
    initial_rate: ArrayLike | None = None
    tip_force: ArrayLike | None = None
    loads: Sequence[Load] = ()
    base_acceleration: BaseAcceleration | None = None
    events: Sequence[Event] = ()
    contacts: Sequence[Contact] = ()
    changes: Sequence[Change] = ()

    def __post_init__(self) -> None:
        self._check_objects()
        if len(self.prescribed or ()) == self.simulated.n_joints:  # only vibrations are free
            vars(self)["settings"] = close(self.settings)
        duration = vars(self)["duration"] = check_positive("duration", self.duration)
        step = self.settings.step
        if step is not None and step > duration:
            rule = f"be at most the duration of {duration:.6g} s"
            raise InputError(Problem("step", rule, shown(step)))
        if (fault := sample_fault(duration, self.rate)) is not None:
            raise InputError(fault.problem())
        if self.simulated.n_joints != self.arm.n_joints:
            rule = f"have the number of joints of the arm ({self.arm.n_joints})"
            raise InputError(Problem("plant", rule, shown(self.simulated.n_joints)))

    def _check_objects(self) -> None:
        """Validate objects before their attributes are used; one thing drives the joints."""
        check_kind("arm", self.arm, Arm)
        if self.plant is not None:
            check_kind("plant", self.plant, Arm)
        controller = self.controller
        if self.hardware is not None:
            check_kind("hardware", self.hardware, Hardware)
            if controller is None:
                raise InputError(Problem("hardware", "requires a controller"))
        if controller is not None:
            check_controller("controller", controller)
            check_positive("controller.sample_time", getattr(controller, "sample_time", None))
        if self.reference is not None:
            check_reference(self.reference)
        if self.prescribed is not None:
            check_mapping("prescribed", self.prescribed, "joint numbers and motions")
        driven = {"torque": self.torque is not None, "prescribed": bool(self.prescribed)}
        for name, given in driven.items():
            if given and controller is not None:
                raise InputError(Problem(name, "cannot be combined with a controller"))

    @property
    def simulated(self) -> Arm:
        """The simulated arm."""
        return self.arm if self.plant is None else self.plant

    @cached_property
    def rate(self) -> float:
        """Samples recorded per second, Hz, which are also those of samples of the torque."""
        rate = RATE if are_samples(self.torque) else None
        return recording_rate(self.settings.rate or rate, self.duration)

    @property
    def times(self) -> FloatArray:
        """Sample times (samples,), s."""
        duration, rate = self.duration, self.rate
        count = int(np.floor(duration * rate * (1 + 1e-12))) + 1
        # The last sample may exceed the end by rounding, and would then never be computed.
        return np.minimum(np.arange(count) / rate, duration)

    @cached_property
    def environment(self) -> Environment:
        """Loads, base acceleration and contacts."""
        acting = self.tip_force, self.loads, self.base_acceleration, self.contacts
        return Environment.of(self.simulated, *acting)

    @cached_property
    def start(self) -> FloatArray:
        """Initial state (2, n, 1 + m), by default at the start of the motion."""
        given = self.initial, self.initial_rate, self.reference, self.torque
        state = start_of(self.simulated, *given)
        if not self.prescribed:
            check_loops(self.simulated, state)
        return state

    @property
    def interpolation(self) -> str:
        """Interpolation of the samples of the torque; that of a function of time is "cubic"."""
        return self.settings.torque_interpolation if are_samples(self.torque) else "cubic"

    def loads_of(self, arm: Arm, known: dict[tuple[int, ...], PiecewiseCubic]) -> LoadHistory:
        """Return the loads of a run of an arm without contacts; see ``load_history``."""
        settings = self.settings
        relative, spacing = relative_tolerance(settings, arm), 1.0 / self.rate
        sampling = self.duration, relative, None, settings.breaks, spacing
        return load_history(arm, self.environment, *sampling, known)

    def new_run(self, meter: Meter) -> Run:
        """Create a run."""
        arm, state = self.simulated, self.start.copy()
        log, prescribed = event_log(arm, self.events), tuple(self.prescribed or ())
        span = self.duration, self.times, 1.0 / self.rate, self.environment, meter
        run = new_run(arm, state, self.settings, *span, log, self.changes, prescribed)
        placed = run.loads.placed.contacts
        refuse_deep_start(arm, state, placed)
        refuse_pressing_outward(arm, self.contacts, placed, self.reference, self.duration)
        return run

    def history_of(self, run: Run) -> Callable[[float], PiecewiseCubic]:
        """Return the function `torque_history` of a relative tolerance, for a run at its start."""
        return partial(torque_history, self, self.torque, run.arm, run.progress.state)


class GoalArguments(SampleSettings, total=False):
    """Keyword arguments of a run under given torques."""

    initial: ArrayLike | None
    initial_rate: ArrayLike | None
    tip_force: ArrayLike | None
    loads: Sequence[Load]
    base_acceleration: BaseAcceleration | None
    contacts: Sequence[Contact]


class DrivenArguments(GoalArguments, total=False):
    """Keyword arguments of a run."""

    torque: Torque | None
    controller: Controller | None
    reference: Reference | None
    hardware: Hardware | None
    prescribed: Prescribed | None
    events: Sequence[Event]


class RunArguments(DrivenArguments, AllSettings, total=False):
    """All keyword arguments of a run."""

    plant: Arm | None
    changes: Sequence[Change]


def situation_of(
    function: Callable[..., Any],
    arm: Arm,
    duration: float,
    settings: RunSettings | None,
    arguments: Mapping[str, Any],
) -> Situation:
    """Return the situation of a call."""
    if not arguments.keys() <= vars(function)["keywords"] | {"torque"}:
        raise unknown_arguments(arguments, signature(function).parameters)
    keywords = {name: value for name, value in arguments.items() if name in vars(DEFAULTS)}
    own = {name: value for name, value in arguments.items() if name not in keywords}
    settings = settings_of(settings, keywords, function)
    return Situation(arm=arm, duration=duration, settings=settings, **own)


def start_of(
    arm: Arm,
    initial: ArrayLike | None,
    initial_rate: ArrayLike | None,
    reference: Reference | None,
    torque: Torque | None,
) -> FloatArray:
    """Return the initial state (2, n, 1 + m), by default at the start of the motion."""
    motion = reference if reference is not None else getattr(torque, "motion", None)
    straight = np.zeros(arm.n_joints)
    if initial is None and motion is not None:
        name = "reference" if reference is not None else "torque"
        straight = np.asarray(call(name, motion.joint_angle, 0.0))
        if straight.shape != (arm.n_joints,):
            rule = f"have the number of joints of the arm ({arm.n_joints})"
            raise InputError(Problem(name, rule, str(straight.size)))
    return initial_state(arm, initial, initial_rate, straight)


def torque_history(
    situation: Situation, torque: Torque | None, arm: Arm, state: FloatArray, relative: float
) -> PiecewiseCubic:
    """Return torques and prescribed accelerations for a relative tolerance of the run.

    The start of prescribed joints is set in ``state``.
    """
    joints, duration, settings = arm.n_joints, situation.duration, situation.settings
    breaks, spacing = settings.breaks, 1.0 / situation.rate
    prescribed = situation.prescribed or {}
    if torque is None:
        history = PiecewiseCubic.constant(np.zeros(joints))
    elif callable(torque):
        check_function("torque", torque)
        history = function_history(torque, duration, joints, relative, breaks, spacing=spacing)
    elif isinstance(torque, PiecewiseCubic):  # whoever made it decides where steps end
        history = torque.held_to(duration)
    else:
        kind, samples = settings.torque_interpolation, driving_samples(arm, torque, prescribed)
        history = sampled_torque(samples, situation.rate, duration, joints, kind, breaks)
        # A second run verifies an accuracy, and a given step decides itself.
        if settings.step is None and settings.accuracy is None:
            history = history.stopping_where_rough(relative_tolerance(settings, arm))
    driven = prescribe(arm, prescribed, state, history, duration, relative, breaks, spacing)
    if prescribed:
        check_loops(arm, state, prescribed)
    return driven


def are_samples(torque: object) -> bool:
    """Return whether a torque, or those of runs, are samples."""
    first = torque[0] if isinstance(torque, list | tuple) and torque else torque
    return first is not None and not callable(first)


def driving_samples(arm: Arm, torque: ArrayLike, prescribed: Collection[int]) -> FloatArray:
    """Return samples (samples, joints) of a torque, zero for joints with a prescribed motion."""
    samples = check_array("torque", torque, (-1, arm.n_joints))
    held = [check_joint(arm, "each key of prescribed", joint) for joint in prescribed]
    if held:
        samples = samples.copy()
        samples[:, held] = 0.0
    return samples


#: The start of each mechanism, with prescribed joints, that was accepted last.
_closed: WeakKeyDictionary[Arm, tuple[bytes, tuple[int, ...]]] = WeakKeyDictionary()


def check_loops(arm: Arm, state: FloatArray, prescribed: Collection[int] = ()) -> None:
    """Raise unless a state closes all loops, keeps them closed, and leaves closures independent.

    Joints with a prescribed motion, by number, do not help to close a loop.
    """
    start = state.tobytes(), tuple(prescribed)
    if arm.closure_rows and _closed.get(arm) != start:
        driven = arm.joint_index[np.isin(arm.joint_numbers, start[1])].tolist()
        free = [index for index in range(arm.dof) if index not in driven]
        q, qd = arm.unpadded(state)
        refuse_opening(arm, ("initial", "initial_rate"), q, qd, free)
        refuse_jamming(arm, q, driven)
        _closed[arm] = start


def integrator_of(arm: Arm, **arguments: Any) -> Choice:
    """Return the integrator of a run with some arguments of ``simulate``, by its rules."""
    names = vars(DEFAULTS).keys() & arguments.keys()
    settings = replaced(DEFAULTS, **{name: arguments.pop(name) for name in names})
    situation = Situation(arm=arm, settings=settings, **arguments)
    run = situation.new_run(Meter("checking", False))
    if situation.controller is not None:
        sample_time = situation.controller.sample_time
        return RunLoop(run, sample_time, situation.hardware).run.choice
    return choose(run, situation.history_of(run))


def implausible_run(
    arm: Arm,
    duration: float,
    rate: float | None,
    angles: FloatArray | None = None,
    controller: Any = None,
    reference: Any = None,
    hardware: Hardware | None = None,
) -> list[str]:
    """Return a sentence for each implausible number of a run."""
    findings: list[str] = []
    if angles is not None and (text := about_degrees("initial", angles)):
        findings.append(text)
    if rate is not None and duration * rate < _SAMPLES.low:
        text = f"rate is {rate:.4g} Hz, less than one sample in the duration of {duration:.4g} s"
        findings.append(f"{text}: did you mean {1.0 / rate:.4g} Hz ({rate:.4g} s between samples)?")
    if controller is not None:
        step = Number("controller.sample_time", float(controller.sample_time), "s", -1.0)
        judge(findings, duration / step.value, _UPDATES, "longer than the run", step)
    length = getattr(reference, "duration", None)
    if isinstance(length, float) and length > 0.0:
        times = Number("duration", duration, "s"), Number("reference.duration", length, "s", -1.0)
        short = duration < length
        statement = f"but the motion takes {length:.4g} s"
        if short:
            times, statement = times[::-1], f"but the run takes {duration:.4g} s"
        judge(findings, duration / length, _MOTION, statement, *times)
    if hardware is not None and hardware.motors is not None:
        _judge_motors(findings, arm, hardware.motors.torque_limit)
    return findings


def _judge_motors(findings: list[str], arm: Arm, limit: ArrayLike) -> None:
    """Judge the torque limits of motors by the weight of the arm, if it has any."""
    statement = "{ratio} of the torque by which the weight turns the horizontal arm"
    torques = [weights(arm.spec)[seat.link] for seat in arm.assembly.seats]
    limits = np.asarray(limit, dtype=np.float64)
    if limits.ndim and limits.shape != (len(torques),):
        return  # the run refuses them
    for most, torque in zip(np.broadcast_to(limits, len(torques)), torques, strict=True):
        if torque > 0.0 and np.isfinite(most):
            number = Number("hardware.motors.torque_limit", float(most), "N m")
            judge(findings, float(most) / torque, _TORQUE, statement, number)


#: Number of sample times that stand for the duration of a plant without one.
UNBOUNDED = 1e4


def new_run(
    arm: Arm,
    state: FloatArray,
    settings: RunSettings,
    duration: float,
    sample_times: FloatArray,
    spacing: float,
    environment: Environment,
    meter: Meter,
    log: EventLog | None = None,
    changes: Sequence[Change] = (),
    prescribed: tuple[int, ...] = (),
) -> Run:
    """Create a run at its initial state ``state`` (2, n, 1 + m).

    The arguments are those of ``simulate``. They are validated by the caller, except for the
    environment. ``spacing`` is the interval (s) between the instants at which functions of time are
    compared with their cubic approximations.
    """
    touching = contacts_of_run(arm, environment.contacts, state)
    touch = contact_frequency(arm, touching)
    horizon = UNBOUNDED * spacing if math.isinf(duration) else duration
    request = request_of(settings, arm)
    tolerance = tolerance_of(arm, state, *tolerances_of(settings, arm), horizon)
    requested = settings.integrator, settings.step
    choice = choose_integrator(*requested, arm, tolerance, touch, prescribed, horizon)
    tolerance = tolerance._replace(fastest=max(tolerance.fastest, touch))

    def loads_of(relative: float) -> LoadHistory:
        given = duration, relative, touching, settings.breaks, spacing
        return load_history(arm, environment, *given)

    samples = np.empty((len(sample_times), *state.shape))
    span = Progress(0.0, state, 0.0), duration, horizon, sample_times, samples
    loads = loads_of(relative_tolerance(settings, arm))
    return Run(
        *(arm, choice, choice.integrator, tolerance, *span, loads, meter, settings, prescribed),
        specialized=settings.specialized,
        loads_of=loads_of,
        request=request,
        watch=Watch(arm, choice.integrator, tolerance, log) if log else None,
        default_step=default_step(choice.integrator, tolerance),
        changes=arm_changes(arm, changes, duration, log),
        environment=environment,
        doubt=choice.doubt,
    )


def initial_state(
    arm: Arm, q: ArrayLike | None, qd: ArrayLike | None, straight: FloatArray
) -> FloatArray:
    """Return the state (2, n, 1 + m) for coordinates and rates (dof,)."""
    given = check_array("initial", arm.rest(straight) if q is None else q, (-1,))
    if given.size != arm.dof:
        hint = "Arm.rest(joint_angles) gives the coordinates of straight links."
        rule = f"have shape ({arm.dof},) for the coordinates of the arm"
        raise InputError(Problem("initial", rule, f"shape {given.shape}", hint))
    rates = np.zeros(arm.dof) if qd is None else check_array("initial_rate", qd, (-1,))
    if rates.size != arm.dof:
        hint = "Arm.rest(joint_rates) gives the rates of straight links."
        rule = f"have shape ({arm.dof},) for the rates of the coordinates"
        raise InputError(Problem("initial_rate", rule, f"shape {rates.shape}", hint))
    return arm.padded(np.stack([given, rates]))
