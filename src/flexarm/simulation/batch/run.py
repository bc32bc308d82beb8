"""Simulation of many runs with one call: ``flexarm.simulate_batch``."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from inspect import signature
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_count, check_kind, check_options
from flexarm.base.errors import (
    FlexarmWarning,
    InputError,
    Problem,
    public_call,
    shown,
    warn_caller,
)
from flexarm.base.processes import check_workers
from flexarm.control.contract.base import Controller, Reference
from flexarm.kernels.compilation.packs import LANES
from flexarm.model import Hardware
from flexarm.model.plausible import warn_of
from flexarm.simulation.batch.closed_lanes import ClosedLanes, fits_closed_lanes
from flexarm.simulation.batch.execution import ACTING, ClosedLoop, OpenLoop, Outcome, attempt
from flexarm.simulation.batch.lanes import OpenLanes, fits_lanes
from flexarm.simulation.batch.recording import TAKEN, Recorder
from flexarm.simulation.batch.reductions import (
    Reduction,
    check_channel,
    check_reductions,
    check_samples,
)
from flexarm.simulation.batch.variations import variations_of
from flexarm.simulation.calls.plausible_run import implausible_run
from flexarm.simulation.calls.preparation import Situation, Torque
from flexarm.simulation.calls.result import arm_text, package_version, software_versions
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import DEFAULTS, RunSettings, settings_of
from flexarm.simulation.run.tolerance import reach_of

if TYPE_CHECKING:
    import xarray as xr

#: A function that executes a block of runs, and the blocks.
Work = tuple[Callable[[range], Iterable[Outcome]], list[range]]
#: Options of ``simulate`` that are the same for all runs.
_OWN = {
    *("arm", "duration", "torque", "controller", "reference", "plant", "hardware", "initial"),
    *("initial_rate", "rate", "progress", "settings"),
}
OPTIONS = signature(simulate).parameters.keys() - _OWN
#: Runs that a thread executes before it reports its progress, one at a time or in lanes, and the
#: memory (bytes) to which the states of the latter are limited.
_BLOCK, _LANE_BLOCK, _MEMORY = 8, 128, 2**24


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
    rate: float = 1000.0,
    stride: int = 1,
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
        settings: as in ``simulate``.
        options: further arguments of ``simulate``, the same for all runs; ``specialized`` is False
            by default.

    Returns:
        Dataset over ``run`` and ``time`` with the channels, NaN after the end of a run, and the
        reductions, NaN for a run that failed. For each run: ``end_time`` (s); ``ended_by``,
        "duration", "failure" or the name of an event; ``failure``, the reason, or empty;
        ``warning``, the warnings of ``simulate``, or empty; ``integrator``, ``steps`` and
        ``evaluations``. Parameters and seeds are coordinates.

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
    keywords |= {"rate": rate} if settings is None or rate != DEFAULTS.rate else {}
    checked = settings_of(settings, keywords, simulate)
    # Code that is compiled in the middle of a run may differ in the last digits.
    checked = checked.replaced(specialized=bool(checked.specialized))
    threads = check_workers("threads", threads)
    stride = check_count("stride", stride)
    names = _channels(channels)
    reduced = check_reductions(reductions, TAKEN)
    model = None if plant is None else check_kind("arm", arm, Arm)
    own = variations_of(
        arm if plant is None else plant,
        "arm" if plant is None else "plant",
        torque=torque,
        controller=controller,
        reference=reference,
        hardware=hardware,
        initial=initial,
        initial_rate=initial_rate,
        parameters=parameters,
        seeds=seeds,
    )
    first = own.arms[0]
    shared = Situation(arm=first, duration=duration, settings=checked, **options)
    own.check_events(shared.events)
    check_samples(reduced, float(shared.times[-1]))
    starts = None if own.initial is None else own.initial[..., first.joint_index].ravel()
    warn_of(implausible_run(first, shared.duration, checked.rate, starts))
    if model is not None and model.joints != first.joints:
        rule = f"have the number of joints of the arm ({model.joints})"
        raise InputError(Problem("plant", rule, shown(first.joints)))
    counts = len(shared.environment.contacts), checked.stations
    closed = own.controllers[0] is not None
    absent = {} if closed else {"torque_command": "controller"}
    if not any(one.assembly.has_bristles for one in own.arms):
        absent["bristle_deflection"] = "friction with bristles"
    sizes = first, shared.times, names, reduced, stride, counts, absent
    recorder = Recorder(own.count, *sizes)
    needed = {*names}.union(*(item.channels for item in reduced.values()))
    size = shared.times.size * 16 * first.assembly.coordinates.size
    lane_blocks = _blocks(0, own.count, _lane_block(size, own.count, threads))
    if closed:
        model = model or (first if own.parameters else None)
        loop = ClosedLoop(own, model, shared, needed)
        with warnings.catch_warnings():  # kept in the outcomes
            warnings.simplefilter("ignore", FlexarmWarning)
            if fits_closed_lanes(own, shared, needed):
                lanes = ClosedLanes(own, shared, needed, loop)
                lanes.prepare()
                work: Work = lanes, lane_blocks
            else:
                work, threads = _first_alone(loop, recorder, own.count), 1
            _execute(work, recorder, own.count, threads, checked.progress)
    else:
        alone = OpenLoop(own, shared, needed)
        if fits_lanes(own, shared, needed):
            alone.prepare()
            work = OpenLanes(own, shared, needed, alone), lane_blocks
        else:
            work = _first_alone(alone, recorder, own.count)
        _execute(work, recorder, own.count, threads, checked.progress)
    attributes = {
        "flexarm_version": package_version(),
        "software": software_versions(),
        "duration": shared.duration,
        "rate": checked.rate,
        "wall_seconds": time.perf_counter() - started,
    }
    request = checked.request(first)
    if request is not None:
        attributes["accuracy"] = request * reach_of(first)
    else:
        relative, absolute, scale = checked.tolerance(first)
        attributes["rtol"] = relative
        if len(own.arms) == 1 or checked.atol is not None:  # otherwise each arm has its own
            attributes["atol"] = absolute * scale
    if len(own.arms) == 1:
        attributes["arm"] = arm_text(first)
    _warn(recorder.texts["warning"])
    return recorder.dataset(own, attributes)


def _channels(given: object) -> tuple[str, ...]:
    if not isinstance(given, list | tuple):
        rule = "be a list of names of channels"
        raise InputError(Problem("channels", rule, shown(given)))
    return tuple(dict.fromkeys(check_channel("channels", name) for name in given))


def _first_alone(execute: Callable[[int], Outcome], recorder: Recorder, count: int) -> Work:
    """Execute and record the first run, which validates what all share; return the other work.

    Raises:
        InputError: if an argument does not fit the first run.
    """
    recorder.record(execute(0))
    return lambda runs: (attempt(execute, k) for k in runs), _blocks(1, count, _BLOCK)


def _blocks(first: int, count: int, size: int) -> list[range]:
    return [range(k, min(k + size, count)) for k in range(first, count, size)]


def _lane_block(size: int, count: int, threads: int) -> int:
    """Return the number of runs of a block; ``size``: bytes of the states of one run."""
    most = min(_LANE_BLOCK, _MEMORY // size, -(-count // threads) + LANES - 1)
    return LANES * max(1, most // LANES)


def _execute(
    work: Work, recorder: Recorder, count: int, threads: int, progress: bool | None
) -> None:
    """Execute and record blocks of runs in threads."""
    execute, blocks = work

    def block(runs: range) -> int:
        for outcome in execute(runs):
            recorder.record(outcome)
        return len(runs)

    with Meter("simulating", progress) as meter:
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
