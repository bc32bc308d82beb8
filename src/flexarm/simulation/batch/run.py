"""Simulation of many runs with one call: ``flexarm.simulate_batch``."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from inspect import signature
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import turning_joints
from flexarm.base.arguments import check_kind, check_options
from flexarm.base.errors import FlexarmWarning, InputError, Problem, public_call, shown, warn_caller
from flexarm.base.late import xr
from flexarm.base.processes import check_workers
from flexarm.base.references import package_version
from flexarm.control.contract.base import Controller, Reference
from flexarm.integrate.base import FloatArray
from flexarm.kernels.compilation.packs import LANES
from flexarm.model import Hardware
from flexarm.model.plausible import warn_of
from flexarm.model.quantities import Count
from flexarm.model.scenarios.scenario import FAILURE, RATE
from flexarm.simulation.batch.closed_lanes import lanes_of
from flexarm.simulation.batch.execution import (
    ACTING,
    Alone,
    Batch,
    ClosedLoop,
    OpenLoop,
    Outcome,
    attempt,
    variations_of,
)
from flexarm.simulation.batch.reductions import (
    Reduction,
    check_channel,
    check_reductions,
    check_samples,
    reduced,
)
from flexarm.simulation.calls.limits import limit_variables
from flexarm.simulation.calls.preparation import Situation, Torque, are_samples, implausible_run
from flexarm.simulation.calls.result import (
    arm_text,
    channel_labels,
    coordinates_of,
    software_versions,
)
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.run.channels import CHANNELS, LIMITS
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import (
    RunSettings,
    replaced,
    request_of,
    settings_of,
    tolerances_of,
)
from flexarm.simulation.run.tolerance import reach_of

#: Texts and counts of each run, with their meanings; the texts are those of a single result.
TEXTS = {
    "ended_by": "duration, failure, or the event that ended the run",
    "failure": "why the run stopped early, or empty",
    "warning": "warnings of the run, or empty",
    "integrator": "method of the run",
}
COUNTS = {"steps": "accepted steps", "evaluations": "evaluations of the dynamics"}
_END_TIME = {"units": "s", "long_name": "time reached by the run"}
_RUN = {"long_name": "run, counted from 0"}
#: Names that reductions cannot have.
_COORDINATES = "run", "time", "seed", "position", "station"
TAKEN = (*CHANNELS, *LIMITS, *TEXTS, *COUNTS, "end_time", *_COORDINATES)
#: Options of ``simulate`` that are the same for all runs.
_OWN = {
    *("arm", "duration", "torque", "controller", "reference", "plant", "hardware", "initial"),
    *("initial_rate", "rate", "progress", "settings"),
}
OPTIONS = signature(simulate).parameters.keys() - _OWN
#: Runs that a thread executes before it reports its progress, one at a time or in lanes, and the
#: memory (bytes) to which the states of the latter are limited.
_BLOCK, _LANE_BLOCK, _MEMORY = 8, 128, 2**24


class Recorder:
    """Arrays of a batch. Threads may record different runs at the same time."""

    def __init__(
        self,
        batch: Batch,
        channels: Sequence[str],
        reductions: Mapping[str, Reduction],
        stride: int,
    ) -> None:
        self._batch, runs, arm = batch, batch.runs.count, batch.runs.arms[0]
        self._times, self._stride = batch.shared.times, stride
        self._reductions = reductions
        self._sizes = {"joint": arm.n_joints, "link": arm.n_links, "axis": 2, "coordinate": arm.dof}
        self._sizes |= {"gauge": len(arm.gauges), "direction": 3 if arm.assembly.base else 0}
        self._sizes["contact"] = len(batch.shared.environment.contacts)
        self._sizes["closure"] = arm.closure_rows
        self._sizes["station"] = batch.shared.settings.stations
        needed = {f"reductions[{name!r}]": item.channels for name, item in reductions.items()}
        self._check({"channels": tuple(channels), **needed})
        stored = self._times[::stride].size
        self._channels = {
            name: np.full((runs, stored, *self._shape(CHANNELS[name].dims)), np.nan)
            for name in channels
        }
        self._reduced = {
            name: np.full((runs, *self._shape(item.dims)), np.nan)
            for name, item in reductions.items()
        }
        self.texts = {name: [""] * runs for name in TEXTS}
        self._numbers = {name: np.zeros(runs, dtype=np.int64) for name in COUNTS}
        self._end = np.zeros(runs)
        self._limits: dict[str, FloatArray] = {}
        self._lock = Lock()

    def _shape(self, dims: Sequence[str]) -> list[int]:
        return [self._sizes[dim] for dim in dims]

    def _check(self, own: Mapping[str, Sequence[str]]) -> None:
        """Raise if the runs do not have a channel, because of the arm or the arguments."""
        runs = self._batch.runs
        absent = {} if runs.controllers[0] is not None else {"torque_command": "controller"}
        if not any(arm.assembly.has_bristles for arm in runs.arms):
            absent["bristle_deflection"] = "friction with bristles"
        if not runs.arms[0].assembly.base:
            absent |= dict.fromkeys(("base_position", "base_velocity"), "base that moves")
        problems = []
        for argument, names in own.items():
            for name in names:
                empty = next((d for d in CHANNELS[name].dims if not self._sizes[d]), "")
                missing = absent.get(name, empty)
                if missing:
                    rule = f"has {name!r}, which the runs do not have: there is no {missing}"
                    problems.append(Problem(argument, rule))
        if problems:
            raise InputError(*problems)

    def record(self, outcome: Outcome) -> None:
        """Record the outcome of one or several runs."""
        times, runs = outcome.times, outcome.runs
        count = min(times.size, self._times.size)
        if count and times[count - 1] != self._times[count - 1]:
            count -= 1  # an event that ends the run is its last sample, between two others
        for name, stored in self._channels.items():
            if name in outcome.channels:
                kept = outcome.channels[name][:, : count : self._stride]
                stored[runs, : kept.shape[1]] = kept
        for name, numbers in outcome.limits.items():
            with self._lock:
                unknown = np.full((self._end.size, *numbers.shape[1:]), np.nan)
                self._limits.setdefault(name, unknown)[runs] = numbers
        for row, k in enumerate(runs):
            failure = outcome.failure
            if outcome.ended_by != FAILURE and self._reductions:
                failure = self._reduce(k, outcome, row)
            self.texts["ended_by"][k] = FAILURE if failure else outcome.ended_by
            self.texts["failure"][k] = failure
            self.texts["warning"][k] = outcome.warnings[row]
            self.texts["integrator"][k] = outcome.integrator
        self._numbers["steps"][runs] = outcome.steps
        self._numbers["evaluations"][runs] = outcome.evaluations
        self._end[runs] = outcome.end_time

    def _reduce(self, k: int, outcome: Outcome, row: int) -> str:
        """Compute the reductions of run k; return why one failed, or an empty text."""
        failure = ""
        channels = {name: values[row] for name, values in outcome.channels.items()}
        for name, item in self._reductions.items():
            try:
                self._reduced[name][k] = reduced(item, outcome.times, channels)
            except Exception as error:  # of a function of the user
                words = " ".join(str(error).split())
                text = f"The reduction {name!r} failed with {type(error).__name__}: {words}"
                failure = failure or text
        return failure

    def dataset(self, attributes: dict[str, Any]) -> xr.Dataset:
        """Return the labelled dataset."""
        variables, arm = dict[str, Any](), self._batch.runs.arms[0]
        for name, values in self._channels.items():
            dims = "run", "time", *CHANNELS[name].dims
            variables[name] = dims, values, channel_labels(arm, CHANNELS[name])
        for name, item in self._reductions.items():
            variables[name] = (("run", *item.dims), self._reduced[name], item.labels)
        limits = {name: self._limits[name] for name in LIMITS if name in self._limits}
        variables |= limit_variables(arm, limits, ("run",))
        variables["end_time"] = ("run", self._end, _END_TIME)
        for name, meaning in COUNTS.items():
            variables[name] = ("run", self._numbers[name], {"long_name": meaning})
        for name, meaning in TEXTS.items():
            variables[name] = ("run", np.array(self.texts[name], dtype=str), {"long_name": meaning})
        used = {"run", "time"}.union(*(dims for dims, *_ in variables.values() if dims != "run"))
        return xr.Dataset(variables, self._coordinates(used), attributes)

    def _coordinates(self, used: set[str]) -> dict[str, Any]:
        variations, sizes = self._batch.runs, self._sizes
        instruments = (variations.hardware and variations.hardware.instruments) or ()
        names = [item.label for item in instruments if item.limit < np.inf]
        label = {"long_name": "instrument with a limit"}
        times, counts = self._times[:: self._stride], (sizes["station"], sizes["contact"])
        coordinates = coordinates_of(variations.arms[0], times, *counts)
        coordinates["instrument"] = ("instrument", names, label)
        if not variations.same_arm:
            coordinates.pop("position", None)  # the lengths of the links may differ
        own: dict[str, Any] = {"run": ("run", np.arange(variations.count), _RUN)}
        for path, values in variations.parameters.items():
            own[path] = ("run", values, {"long_name": f"{path} of the simulated arm"})
        if variations.seeds is not None:
            own["seed"] = ("run", variations.seeds, {"long_name": "seed of the noise"})
        kept = {
            name: item
            for name, item in coordinates.items()
            if used.issuperset([item[0]] if isinstance(item[0], str) else item[0])
        }
        return own | kept


@public_call
def simulate_batch(
    arm: Arm | Sequence[Arm],
    duration: float,
    *,
    torque: Torque | Sequence[Torque] | None = None,
    controller: Controller | Sequence[Controller] | None = None,
    reference: Reference | Sequence[Reference] | None = None,
    plant: Arm | Sequence[Arm] | None = None,
    hardware: Hardware | None = None,
    initial: ArrayLike | None = None,
    initial_rate: ArrayLike | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    seeds: ArrayLike | None = None,
    channels: Sequence[str] = ("joint_angle", "tip"),
    reductions: Mapping[str, Reduction] | None = None,
    rate: float | None = None,
    stride: Count = 1,
    threads: int | None = None,
    progress: bool | None = None,
    settings: RunSettings | None = None,
    **options: Any,
) -> xr.Dataset:
    """Simulate many runs and return them as one labelled dataset with the dimension ``run``.

    Args:
        arm: the arm of all runs, or a list with one for each. All have the same coordinates,
            links, joints and gauges.
        duration: of every run, s.
        torque: as in ``simulate``, for all runs; or an array (runs, samples, joints), or a list of
            functions of time, one for each run.
        controller: for all runs, or a list with one for each run. Each run uses a copy
            (``copy.deepcopy``), reset before it; or the object itself, if it cannot be copied.
        reference: motion for the controllers, or a list with one for each run.
        plant: simulated arm, or a list with one for each run, if it differs from ``arm``, which
            is then one arm, the model of the controllers.
        hardware: of all runs, as in ``simulate``.
        initial: q (dof,) of all runs, or (runs, dof); by default as in ``simulate``.
        initial_rate: qd (dof,) or (runs, dof), zero by default.
        parameters: values (runs,) by the path of a number of the arm, such as
            ``"links[0].flexural_rigidity"`` or ``"payload.mass"``. They change the simulated arm;
            ``arm`` remains the controllers' model.
        seeds: (runs,) seeds of the noise of ``hardware``, instead of its own.
        channels: names of the channels to store, from ``flexarm.simulation.run.channels``.
        reductions: ``Reduction`` objects by the name of their variable. They use every sample,
            also those that are not stored.
        rate: samples computed per second, Hz, and rate of torque samples.
        stride: stride of the stored samples.
        threads: number of threads, by default one for each core that this process may use.
            Controllers are called by one thread at a time.
        progress: True or False shows or hides the bar.
        settings: as in ``simulate``; with an ``accuracy``, runs in lanes with small tolerances are
            not verified.
        options: further arguments of ``simulate``, the same for all runs; ``specialized`` is False
            by default.

    Returns:
        Dataset over ``run`` and ``time`` with the channels, NaN after the end of a run, and the
        reductions, NaN for a run that failed. For each run: ``end_time`` (s); ``ended_by``,
        "duration", "failure" or the name of an event; ``failure``, the reason, or empty;
        ``warning``, the warnings of ``simulate``, or empty; ``integrator``, ``steps`` and
        ``evaluations``; ``integration_error`` (m, of the tip), if a second run verified any, and
        NaN for the others. Parameters and seeds are coordinates.

    Raises:
        InputError: if an argument has the wrong shape or value, the numbers of runs differ, or
            a number in ``parameters`` is impossible, or ``simulate`` would raise for the first run.
            A later run that cannot be simulated has its reason in ``failure``.

    Warns:
        FlexarmWarning: once, if runs have warnings.
        ImplausibleValueWarning: if initial angles look like degrees, or ``rate`` like a time.

    Runs do not influence each other: the numbers of a run are the same, to the last bit, in any
    order, number and selection of runs and with any number of threads, and equal those of
    ``simulate``. Besides the dataset, memory holds the states of up to 128 runs for each thread, in
    at most 16 MB, or those of eight runs.
    """
    started = time.perf_counter()
    check_options(options, OPTIONS, "simulate_batch")
    keywords = {name: options.pop(name) for name in list(options) if name not in ACTING}
    keywords |= {"progress": progress} if settings is None or progress is not None else {}
    keywords |= {"rate": rate} if settings is None or rate is not None else {}
    checked = settings_of(settings, keywords, simulate)
    if are_samples(torque):
        checked = replaced(checked, rate=checked.rate or RATE)
    # Code that is compiled in the middle of a run may differ in the last digits.
    checked = replaced(checked, specialized=bool(checked.specialized))
    threads = check_workers("threads", threads)
    names = _channels(channels)
    reduced = check_reductions(reductions, TAKEN)
    model = None if plant is None else check_kind("arm", arm, Arm)
    acting = torque, controller, reference, hardware, initial, initial_rate, parameters, seeds
    name, given = ("arm", arm) if plant is None else ("plant", plant)
    variations = variations_of(given, name, *acting)
    first = variations.arms[0]
    shared = Situation(arm=first, duration=duration, settings=checked, **options)
    variations.check_events(shared.events)
    check_samples(reduced, float(shared.times[-1]))
    starts = (
        None
        if variations.initial is None
        else variations.initial[..., first.joint_index[turning_joints(first)]].ravel()
    )
    warn_of(implausible_run(first, shared.duration, checked.rate, starts))
    if model is not None and model.n_joints != first.n_joints:
        rule = f"have the number of joints of the arm ({model.n_joints})"
        raise InputError(Problem("plant", rule, shown(first.n_joints)))
    closed = variations.controllers[0] is not None
    needed = {*names}.union(*(item.channels for item in reduced.values()))
    batch = Batch(
        variations, shared, needed, model or (first if closed and variations.parameters else None)
    )
    recorder = Recorder(batch, names, reduced, stride)
    with warnings.catch_warnings():
        if closed:  # their warnings are kept in the outcomes
            warnings.simplefilter("ignore", FlexarmWarning)
        _execute(batch, recorder, threads)
    attributes = {
        "flexarm_version": package_version(),
        "software": software_versions(),
        "duration": shared.duration,
        "rate": shared.rate,
        "wall_seconds": time.perf_counter() - started,
    }
    request = request_of(checked, first)
    if request is not None:
        attributes["accuracy"] = request * reach_of(first)
    else:
        relative, absolute, scale = tolerances_of(checked, first)
        attributes["rtol"] = relative
        if len(variations.arms) == 1 or checked.atol is not None:  # otherwise each arm has its own
            attributes["atol"] = absolute * scale
    if len(variations.arms) == 1:
        attributes["arm"] = arm_text(first)
    _warn(recorder.texts["warning"])
    return recorder.dataset(attributes)


def _channels(given: object) -> tuple[str, ...]:
    if not isinstance(given, list | tuple):
        rule = "be a list of names of channels"
        raise InputError(Problem("channels", rule, shown(given)))
    return tuple(dict.fromkeys(check_channel("channels", name) for name in given))


def _blocks(first: int, count: int, size: int) -> list[range]:
    return [range(k, min(k + size, count)) for k in range(first, count, size)]


def _execute(batch: Batch, recorder: Recorder, threads: int) -> None:
    """Execute and record blocks of runs in threads; the first run validates what all share."""
    count, shared = batch.runs.count, batch.shared
    alone: Alone = OpenLoop(batch) if batch.runs.controllers[0] is None else ClosedLoop(batch)
    execute: Callable[[range], Iterable[Outcome]]
    if (lanes := lanes_of(batch, alone)) is not None:
        lanes.prepare()
        size = shared.times.size * 16 * batch.runs.arms[0].assembly.coordinates.size
        most = min(_LANE_BLOCK, _MEMORY // size, -(-count // threads) + LANES - 1)
        execute, blocks = lanes, _blocks(0, count, LANES * max(1, most // LANES))
    else:
        recorder.record(alone(0))
        execute, blocks = lambda runs: (attempt(alone, k) for k in runs), _blocks(1, count, _BLOCK)
        threads = threads if isinstance(alone, OpenLoop) else 1

    def block(runs: range) -> int:
        for outcome in execute(runs):
            recorder.record(outcome)
        return len(runs)

    with Meter("simulating", shared.settings.progress) as meter:
        if threads == 1:
            for runs in blocks:
                block(runs)
                meter.update(runs.stop / count)
            return
        with ThreadPoolExecutor(threads, thread_name_prefix="flexarm") as pool:
            waiting, done = {pool.submit(block, runs) for runs in blocks}, 0
            try:
                while waiting:
                    finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    done += sum(one.result() for one in finished)
                    meter.update(done / count)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)


def _warn(texts: Sequence[str]) -> None:
    """Issue one warning for all runs that have warnings."""
    found = [text for text in texts if text]
    if found:
        counted = f"{len(found)} of {len(texts)} runs have warnings, see the variable 'warning'."
        warn_caller(f"{counted} The first: {found[0]}", FlexarmWarning)
