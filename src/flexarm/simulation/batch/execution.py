"""Runs of a batch: their arguments, and execution one at a time by the engine of ``simulate``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from threading import Lock
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_kind, check_list_of, check_mapping, check_positive
from flexarm.base.errors import (
    FlexarmWarning,
    InputError,
    Problem,
    SimulationError,
    check_array,
    shown,
)
from flexarm.base.late import xr
from flexarm.control.contract.base import Controller, Reference, check_controller, check_reference
from flexarm.integrate.base import FloatArray
from flexarm.model import ArmSpec, Hardware
from flexarm.model.paths import number_at, with_numbers
from flexarm.model.scenarios.scenario import DURATION, FAILURE
from flexarm.simulation.calls.compare import warnings_of
from flexarm.simulation.calls.limits import limits_of_run, notices_of
from flexarm.simulation.calls.preparation import (
    Situation,
    Torque,
    check_loops,
    start_of,
    torque_history,
)
from flexarm.simulation.calls.result import channels_of_run
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.histories.loads import LoadHistory
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.channels import LIMITS
from flexarm.simulation.run.coarse import run_accurately
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import relative_tolerance, replaced
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.tolerance import reach_of

T = TypeVar("T")
#: Arms with changed parameters that are kept, because runs often repeat the same parameters.
_KEPT_ARMS = 64


@dataclass(frozen=True, eq=False)
class Variations:
    """Arguments of each run."""

    count: int  # number of runs
    arms: Sequence[Arm]  # one arm for all runs, or one for each
    each_arm: bool  # whether they were given as a list
    initial: FloatArray | None  # (dof,), (runs, dof), or None for the default
    initial_rate: FloatArray | None  # likewise
    torques: Sequence[Torque | None]  # one item for all runs, or one for each
    controllers: Sequence[Controller | None]  # likewise
    references: Sequence[Reference | None]  # likewise
    parameters: Mapping[str, FloatArray]  # values (runs,) by the path of a number of the arm
    hardware: Hardware | None  # of all runs
    seeds: NDArray[np.int64] | None  # (runs,) of its noise, or None for the seed of the hardware
    _specs: Sequence[ArmSpec] = field(default=(), repr=False)

    @property
    def same_arm(self) -> bool:
        """Whether all runs simulate the same arm."""
        return not self.each_arm and not self.parameters

    def arm(self, k: int) -> Arm:
        """Return the simulated arm of run k."""
        arm = _of(self.arms, k)
        if not self.parameters:
            return arm
        varied = _assembled(self._specs[k])
        _check_structure("parameters", varied, arm)
        return varied

    def check_events(self, events: Any) -> None:
        """Raise if an event was created for one arm, but the runs simulate several."""
        several = self.each_arm and any(arm.spec != self.arms[0].spec for arm in self.arms)
        if not _is_list(events) or not (several or self.parameters):
            return
        rule = f"cannot be combined with {'parameters' if self.parameters else 'several arms'}"
        hint = "It was created for one arm. Use Event with a function of t, q and qd."
        problems = [
            Problem(f"events[{k}]", rule, hint=hint)
            for k, event in enumerate(events)
            if hasattr(getattr(event, "function", None), "arm")
        ]
        if problems:
            raise InputError(*problems)

    def state_of(self, k: int) -> tuple[FloatArray | None, FloatArray | None]:
        """Return coordinates and rates (dof,) at the start of run k; None for the default."""
        return _row(self.initial, k), _row(self.initial_rate, k)

    def hardware_of(self, k: int) -> Hardware | None:
        """Return the hardware of run k with its seed."""
        if self.hardware is None or self.seeds is None:
            return self.hardware
        return self.hardware.replace(seed=int(self.seeds[k]))

    def item(self, name: str, k: int) -> Any:
        """Return the item of run k of ``torques``, ``controllers`` or ``references``."""
        return _of(getattr(self, name), k)


def variations_of(
    arm: object,
    name: str,
    torque: Any,
    controller: Any,
    reference: Any,
    hardware: Hardware | None,
    initial: ArrayLike | None,
    initial_rate: ArrayLike | None,
    parameters: Mapping[str, ArrayLike] | None,
    seeds: ArrayLike | None,
) -> Variations:
    """Validate the arguments of ``simulate_batch`` that may differ from run to run."""
    arms = _arms(name, arm)
    first = arms[0]
    states = {
        name: None if value is None else _states(name, value, first.dof)
        for name, value in (("initial", initial), ("initial_rate", initial_rate))
    }
    torques, each_torque = _torques(torque, first.n_joints)
    controllers: list[Any] = list(controller) if _is_list(controller) else [controller]
    references: list[Any] = list(reference) if _is_list(reference) else [reference]
    _check_loop(torque, controllers, references, hardware, seeds)
    values = _parameters(first, parameters)
    noise = None if seeds is None else _seeds(seeds)
    lengths = {
        name: len(arms) if _is_list(arm) else None,
        **{name: None if a is None or a.ndim == 1 else len(a) for name, a in states.items()},
        "torque": len(torques) if each_torque else None,
        "controller": len(controllers) if _is_list(controller) else None,
        "reference": len(references) if _is_list(reference) else None,
        **{f"parameters[{path!r}]": len(row) for path, row in values.items()},
        "seeds": None if noise is None else len(noise),
    }
    count = _common(lengths)
    specs = _specs(arms, values, count)
    return Variations(
        count, arms, _is_list(arm), states["initial"], states["initial_rate"], torques,
        controllers, references, values, hardware, noise, specs,
    )  # fmt: skip


def _is_list(value: object) -> bool:
    return isinstance(value, list | tuple)


def _of(items: Sequence[T], k: int) -> T:
    return items[0] if len(items) == 1 else items[k]


def _row(values: FloatArray | None, k: int) -> FloatArray | None:
    return values if values is None or values.ndim == 1 else values[k]


def _arms(name: str, arm: object) -> list[Arm]:
    if not _is_list(arm):
        return [check_kind(name, arm, Arm, "an Arm or a list of them")]
    arms = check_list_of(name, arm, Arm)
    if not arms:
        raise InputError(Problem(name, "must not be an empty list"))
    for k, other in enumerate(arms):
        _check_structure(f"{name}[{k}]", other, arms[0])
    return arms


def _check_structure(name: str, arm: Arm, first: Arm) -> None:
    """Raise if an arm has other coordinates, links or gauges than the first one."""
    own, known = ((one.dof, one.n_links, one.n_joints, len(one.gauges)) for one in (arm, first))
    if own != known:
        parts = "coordinates, links, joints and gauges"
        rule = f"have the {known} {parts} of the first arm"
        raise InputError(Problem(name, rule, str(own)))


@lru_cache(maxsize=_KEPT_ARMS)
def _assembled(spec: ArmSpec) -> Arm:
    return Arm(spec)


def _states(name: str, value: ArrayLike, dof: int) -> FloatArray:
    """Return coordinates or rates as (dof,) for all runs, or (runs, dof)."""
    return check_array(name, value, (-1, dof) if _axes(value) > 1 else (dof,))


def _axes(value: Any) -> int:
    """Return the number of axes of an array, or of nested lists by their first items."""
    axes = getattr(value, "ndim", None)
    if isinstance(axes, int):
        return axes
    return 1 + _axes(value[0]) if _is_list(value) and value else 0


def _torques(torque: Any, joints: int) -> tuple[list[Torque | None], bool]:
    """Return the torque of all runs as the only item, or one for each; and whether it is each."""
    if torque is None or _is_history(torque):
        return [torque], False
    if _is_list(torque) and torque and all(map(_is_history, torque)):
        return list(torque), True
    if _axes(torque) > 2:
        return list(check_array("torque", torque, (-1, -1, joints))), True
    return [check_array("torque", torque, (-1, joints))], False


def _is_history(value: object) -> bool:
    return isinstance(value, PiecewiseCubic) or callable(value)


def _check_loop(
    torque: object,
    controllers: Sequence[Any],
    references: Sequence[Any],
    hardware: object,
    seeds: object,
) -> None:
    """Raise if controllers, references, hardware and seeds do not fit each other."""
    named = {"controller": controllers, "reference": references}
    problems = [Problem(name, "must not be empty") for name, items in named.items() if not items]
    closed = bool(controllers) and controllers[0] is not None
    if closed and torque is not None:
        problems.append(Problem("torque", "cannot be combined with a controller"))
    if hardware is not None:
        check_kind("hardware", hardware, Hardware)
        if not closed:
            problems.append(Problem("hardware", "requires a controller"))
    if seeds is not None and hardware is None:
        problems.append(Problem("seeds", "requires hardware, whose noise they determine"))
    if problems:
        raise InputError(*problems)
    for controller in controllers if closed else ():
        check_controller("controller", controller)
        sample_time = getattr(controller, "sample_time", None)
        check_positive("controller.sample_time", sample_time)
    for reference in references:
        if reference is not None:
            check_reference(reference)


def _parameters(arm: Arm, given: Mapping[str, ArrayLike] | None) -> dict[str, FloatArray]:
    if given is None:
        return {}
    check_mapping("parameters", given, "paths and values")
    values = {}
    for path, row in given.items():
        number_at("parameters", arm.spec, path)
        values[path] = check_array(f"parameters[{path!r}]", row, (-1,))
    return values


def _seeds(given: ArrayLike) -> NDArray[np.int64]:
    rule = "be whole numbers from 0 to 2**63 - 1, one for each run"
    try:
        seeds = np.asarray(given)
        whole = seeds.dtype.kind in "iu" and seeds.ndim == 1 and bool(np.all(seeds >= 0))
    except Exception:  # rows of different lengths, or objects whose conversion fails
        whole = False
    if not whole or bool(np.any(seeds > 2**63 - 1)):
        raise InputError(Problem("seeds", rule, shown(given)))
    return seeds.astype(np.int64)


def _common(lengths: Mapping[str, int | None]) -> int:
    """Return the number of runs."""
    counts = {name: length for name, length in lengths.items() if length is not None}
    count = max(counts.values(), default=1)
    longest = next((name for name, length in counts.items() if length == count), "")
    problems = [
        Problem(name, f"have one item for each of the {count} runs of {longest}", shown(n))
        for name, n in counts.items()
        if n != count
    ]
    if count == 0:
        problems = [Problem(longest, "must not be empty")]
    if problems:
        raise InputError(*problems)
    return count


def _specs(arms: Sequence[Arm], values: Mapping[str, FloatArray], count: int) -> list[ArmSpec]:
    """Return the description of the arm of each run; empty without parameters."""
    if not values:
        return []
    specs, problems = [], []
    for k in range(count):
        spec: ArmSpec = _of(arms, k).spec
        try:
            spec = with_numbers(spec, {path: float(row[k]) for path, row in values.items()})
        except InputError as error:
            problems += [replace(p, where=f"simulate_batch: run {k}") for p in error.problems]
        specs.append(spec)
    if problems:
        raise InputError(*problems)
    return specs


#: Arguments of ``simulate`` that act on the arm, besides its torques.
ACTING = (
    *("tip_force", "loads", "base_acceleration", "contacts"),
    *("events", "prescribed", "changes"),
)


class Outcome(NamedTuple):
    """Results of one run, or of several that ended in the same way."""

    runs: Sequence[int]  # numbers of the runs
    times: FloatArray  # (samples,) s, of the samples computed
    channels: Mapping[str, FloatArray]  # the required channels (runs, samples, ...) by name
    end_time: float  # s, reached by the runs
    ended_by: str = FAILURE  # as the attributes of a result of ``simulate``
    failure: str = ""  # likewise
    integrator: str = ""  # likewise
    warnings: Sequence[str] = ("",)  # likewise, of each run
    steps: Sequence[int] = (0,)  # likewise
    evaluations: Sequence[int] = (0,)  # likewise
    limits: Mapping[str, FloatArray] = {}  # numbers of ``LIMITS`` (runs, ...) by name


def failed(k: int, error: SimulationError | InputError) -> Outcome:
    """Return the outcome of run k without samples."""
    return Outcome([k], np.zeros(0), {}, getattr(error, "time", 0.0), failure=str(error))


def attempt(execute: Callable[[int], Outcome], k: int) -> Outcome:
    """Execute run k; return the outcome of a failure also if its arguments are wrong."""
    try:
        return execute(k)
    except InputError as error:
        return failed(k, error)


@dataclass(eq=False)
class Batch:
    """Runs of a batch."""

    runs: Variations
    shared: Situation  # arguments of all runs
    channels: Collection[str]  # that are required of each run
    model: Arm | None = None  # of the controllers; None for the simulated arm
    users: Lock = field(default_factory=Lock)  # held while objects of the user are called


class OpenLoop:
    """Runs under given torques; several threads may execute them at the same time."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self._meter = Meter("simulating", False)
        self._histories: dict[float, PiecewiseCubic] = {}

    def prepare(self) -> None:
        """Validate what the first run shares with the others."""
        with suppress(SimulationError):  # each run reports the failure of a function
            run, state = self._new_run(0)
            relative = relative_tolerance(self._batch.shared.settings, run.arm)
            self.history(0, run.arm, state, relative)

    def __call__(self, k: int) -> Outcome:
        """Execute run k."""
        try:
            run, state = self._new_run(k)
        except SimulationError as error:  # a factor or another function of time failed
            return failed(k, error)
        failure = ""
        try:
            run_accurately(run, partial(self.history, k, run.arm, state))
        except SimulationError as error:
            if run.history is None:  # a function of time failed before the run began
                return failed(k, error)
            failure = str(error)
        return self._outcome(k, run, failure)

    def _outcome(self, k: int, run: Run, failure: str) -> Outcome:
        assert run.history is not None
        progress = run.progress
        times = run.sample_times[: progress.sample]
        log = run.watch.log if run.watch is not None else None
        found: dict[str, FloatArray] = {}
        if self._batch.channels:
            found = channels_of_run(run, run.history.at(times), self._batch.channels)
        numbers, texts = limits_of_run(run, None, found)
        channels, limits = (
            {name: values[None] for name, values in part.items()} for part in (found, numbers)
        )
        if run.error is not None:
            limits["integration_error"] = np.array([run.error * reach_of(run.arm)])
        ended_by = FAILURE if failure else (log and log.ended_by) or DURATION
        reached = progress.time, ended_by, failure, run.integrator.name
        notices = [" ".join(text for text, _ in notices_of(run, texts, failure))]
        work = [progress.steps], [progress.evaluations + run.discarded]
        return Outcome([k], times, channels, *reached, notices, *work, limits)

    def _new_run(self, k: int) -> tuple[Run, FloatArray]:
        """Return run k and its initial state."""
        own, shared = self._batch.runs, self._batch.shared
        arm = own.arm(k)
        initial, initial_rate = own.state_of(k)
        with self._batch.users:
            run = replace(
                shared,
                arm=arm,
                torque=own.item("torques", k),
                initial=initial,
                initial_rate=initial_rate,
            ).new_run(self._meter)
        state = run.progress.state
        run.loads_of = partial(self._loads, run.loads_of)
        return run, state

    def _loads(self, loads_of: Any, relative: float) -> LoadHistory:
        with self._batch.users:
            history: LoadHistory = loads_of(relative)
            return history

    def start(self, k: int, arm: Arm) -> FloatArray:
        """Return the initial state (2, n, 1 + m) of run k."""
        with self._batch.users:  # the motion of a torque may be a function of the user
            own = self._batch.runs
            state = start_of(arm, *own.state_of(k), None, own.item("torques", k))
            check_loops(arm, state)
            return state

    def history(self, k: int, arm: Arm, state: FloatArray, relative: float) -> PiecewiseCubic:
        """Return the torque of run k for a tolerance; sets prescribed joints in ``state``."""
        own, situation = self._batch.runs, self._batch.shared
        torque, shared = own.item("torques", k), len(own.torques) == 1 and not situation.prescribed
        with self._batch.users:
            if shared and relative in self._histories:
                return self._histories[relative]
            found = torque_history(situation, torque, arm, state, relative)
            if shared:
                self._histories[relative] = found
            return found


class ClosedLoop:
    """Runs with controllers, which are Python objects: one thread at a time executes them."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch

    def __call__(self, k: int) -> Outcome:
        """Execute run k."""
        own, model, shared = self._batch.runs, self._batch.model, self._batch.shared
        simulated = own.arm(k)
        initial, initial_rate = own.state_of(k)
        controller = own.item("controllers", k)
        with suppress(Exception):  # an object with an open connection is used itself
            controller = deepcopy(controller)  # the objects of the caller stay as they are
        try:
            with self._batch.users, warnings.catch_warnings():  # kept in the outcome
                warnings.simplefilter("ignore", FlexarmWarning)
                result = simulate(
                    model or simulated,
                    shared.duration,
                    plant=None if model is None else simulated,
                    controller=controller,
                    reference=own.item("references", k),
                    hardware=own.hardware_of(k),
                    initial=initial,
                    initial_rate=initial_rate,
                    settings=replaced(shared.settings, progress=False),
                    **{name: getattr(shared, name) for name in ACTING},
                )
        except SimulationError as error:
            if error.result is None:
                return failed(k, error)
            return self._outcome(k, error.result, error.time)
        return self._outcome(k, result, None)

    def _outcome(self, k: int, result: xr.Dataset, stopped: float | None) -> Outcome:
        attributes, times = result.attrs, result["time"].values
        ended_by = attributes["ended_by"]
        end = float(times[-1]) if ended_by != DURATION else self._batch.shared.duration
        channels = {name: result[name].values[None] for name in self._batch.channels}
        limits = {name: result[name].values[None] for name in LIMITS if name in result}
        if "loop_growth" in attributes:
            limits["loop_growth"] = np.array([attributes["loop_growth"]])
        end = end if stopped is None else stopped
        reached = end, ended_by, attributes["failure"], attributes["integrator"]
        work = [attributes["steps"]], [attributes["evaluations"]]
        notices = [" ".join(warnings_of(result))]
        return Outcome([k], times, channels, *reached, notices, *work, limits)


#: Runs of a batch, one at a time.
Alone = OpenLoop | ClosedLoop
