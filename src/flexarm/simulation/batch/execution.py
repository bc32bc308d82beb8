"""Execution of the runs of a batch, one at a time, by the engine of ``simulate``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import FlexarmWarning, InputError, SimulationError
from flexarm.control.contract.base import Controller
from flexarm.integrate.base import FloatArray
from flexarm.model.scenarios.events import DURATION, FAILURE
from flexarm.simulation.batch.variations import Variations
from flexarm.simulation.calls.compare import warnings_of
from flexarm.simulation.calls.limits import limits_of_run, notices_of
from flexarm.simulation.calls.preparation import Situation, start_of, torque_history
from flexarm.simulation.calls.result import channels_of_run
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.histories.loads import LoadHistory
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.channels import LIMITS
from flexarm.simulation.run.new_run import restarted
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import relative_tolerance, replaced
from flexarm.simulation.run.small_motion import run_accurately
from flexarm.simulation.run.stepping import Run

if TYPE_CHECKING:
    import xarray as xr


#: Arguments of ``simulate`` that act on the arm, besides its torques.
ACTING = (
    *("tip_force", "loads", "base_acceleration", "contacts"),
    *("events", "prescribed", "changes"),
)


class Outcome(NamedTuple):
    """Results of one run, or of several that ended in the same way.

    Attributes:
        runs: their numbers.
        times: (samples,) s, of the samples computed.
        channels: the required channels (runs, samples, ...) by name.
        end_time: s, reached by the runs.
        ended_by, failure, integrator: as the attributes of a result of ``simulate``.
        warnings, steps, evaluations: likewise, of each run.
        limits: numbers of ``LIMITS`` (runs, ...) by name.
    """

    runs: Sequence[int]
    times: FloatArray
    channels: Mapping[str, FloatArray]
    end_time: float
    ended_by: str = FAILURE
    failure: str = ""
    integrator: str = ""
    warnings: Sequence[str] = ("",)
    steps: Sequence[int] = (0,)
    evaluations: Sequence[int] = (0,)
    limits: Mapping[str, FloatArray] = {}


def failed(k: int, error: SimulationError | InputError) -> Outcome:
    """Return the outcome of run k without samples."""
    return Outcome([k], np.zeros(0), {}, getattr(error, "time", 0.0), failure=str(error))


def attempt(execute: Callable[[int], Outcome], k: int) -> Outcome:
    """Execute run k; return the outcome of a failure also if its arguments are wrong."""
    try:
        return execute(k)
    except InputError as error:
        return failed(k, error)


class OpenLoop:
    """Runs under given torques; several threads may execute them at the same time.

    Args:
        variations: arguments of the runs.
        shared: what all runs have in common, with the arm of the first one.
        channels: names of the required channels.

    Attributes:
        users: lock of functions of users.
    """

    def __init__(
        self, variations: Variations, shared: Situation, channels: Collection[str]
    ) -> None:
        self._variations, self._shared, self._channels = variations, shared, channels
        self._meter = Meter("simulating", False)
        self._template: Run | None = None
        self._histories: dict[float, PiecewiseCubic] = {}
        self.users = Lock()

    def prepare(self) -> None:
        """Validate what the first run shares with the others.

        Raises:
            InputError: if an argument does not fit the arm.
        """
        with suppress(SimulationError):  # each run reports the failure of a function
            run, state = self._new_run(0)
            self.history(0, run.arm, state, relative_tolerance(self._shared.settings, run.arm))

    def __call__(self, k: int) -> Outcome:
        """Execute run k.

        Raises:
            InputError: if an argument does not fit the arm of the run.
        """
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
        if self._channels:
            found = channels_of_run(run, run.history.at(times), self._channels)
        numbers, texts = limits_of_run(run, None, found)
        return Outcome(
            [k],
            times,
            {name: values[None] for name, values in found.items()},
            progress.time,
            FAILURE if failure else (log and log.ended_by) or DURATION,
            failure,
            run.integrator.name,
            [" ".join(text for text, _ in notices_of(run, texts, failure))],
            [progress.steps],
            [progress.evaluations + run.discarded],
            {name: values[None] for name, values in numbers.items()},
        )

    def _new_run(self, k: int) -> tuple[Run, FloatArray]:
        """Return run k and its initial state."""
        own, shared = self._variations, self._shared
        arm = own.arm(k)
        if self._template is not None:
            state = self.start(k, arm)
            return restarted(self._template, state, shared.settings), state
        initial, initial_rate = own.state_of(k)
        with self.users:
            run = replace(
                shared,
                arm=arm,
                torque=own.torque(k),
                initial=initial,
                initial_rate=initial_rate,
            ).new_run(self._meter)
        state = run.progress.state
        run.loads_of = partial(self._loads, run.loads_of)
        same = own.same_arm and run.changes is None
        if same and not run.loads.placed.contacts.body.size and run.watch is None:
            self._template = restarted(run, state, shared.settings)
        return run, state

    def _loads(self, loads_of: Any, relative: float) -> LoadHistory:
        with self.users:
            history: LoadHistory = loads_of(relative)
            return history

    def start(self, k: int, arm: Arm) -> FloatArray:
        """Return the initial state (2, n, 1 + m) of run k.

        Raises:
            InputError: if it does not fit the arm.
        """
        with self.users:  # the motion of a torque may be a function of the user
            return start_of(arm, *self._variations.state_of(k), None, self._variations.torque(k))

    def history(self, k: int, arm: Arm, state: FloatArray, relative: float) -> PiecewiseCubic:
        """Return the torque of run k for a relative tolerance; sets prescribed joints in ``state``.

        Raises:
            InputError: if the torque does not fit the arm.
            FunctionError: if a function of time raises an exception.
        """
        torque = self._variations.torque(k)
        shared = self._variations.same_torque and not self._shared.prescribed
        with self.users:
            if shared and relative in self._histories:
                return self._histories[relative]
            found = torque_history(self._shared, torque, arm, state, relative)
            if shared:
                self._histories[relative] = found
            return found


def _copied(controller: Controller | None) -> Controller | None:
    """Return a copy, so that a batch leaves the objects of its caller as they are.

    An object that cannot be copied, such as one with an open connection, is returned itself.
    """
    try:
        return deepcopy(controller)
    except Exception:
        return controller


class ClosedLoop:
    """Runs with controllers, which are Python objects: one thread at a time executes them.

    Args:
        arm: the controllers' model of the arm if parameters vary, otherwise None.
        shared, channels: as for `OpenLoop`.

    Attributes:
        model: ``arm`` as given. users: lock of functions and objects of users.
    """

    def __init__(
        self, variations: Variations, arm: Arm | None, shared: Situation, channels: Collection[str]
    ) -> None:
        self._variations, self.model = variations, arm
        self._shared, self._channels = shared, channels
        self.users = Lock()

    def __call__(self, k: int) -> Outcome:
        """Execute run k.

        Raises:
            InputError: if an argument does not fit the arm or the controller of the run.
        """
        own = self._variations
        simulated, duration = own.arm(k), self._shared.duration
        initial, initial_rate = own.state_of(k)
        try:
            with self.users, warnings.catch_warnings():  # kept in the outcome
                warnings.simplefilter("ignore", FlexarmWarning)
                result = simulate(
                    self.model or simulated,
                    duration,
                    plant=None if self.model is None else simulated,
                    controller=_copied(own.controller(k)),
                    reference=own.reference(k),
                    hardware=own.hardware_of(k),
                    initial=initial,
                    initial_rate=initial_rate,
                    settings=replaced(self._shared.settings, progress=False),
                    **{name: getattr(self._shared, name) for name in ACTING},
                )
        except SimulationError as error:
            if error.result is None:
                return failed(k, error)
            return self._outcome(k, error.result, error.time)
        return self._outcome(k, result, None)

    def _outcome(self, k: int, result: xr.Dataset, stopped: float | None) -> Outcome:
        attributes, times = result.attrs, result["time"].values
        ended_by = attributes["ended_by"]
        end = float(times[-1]) if ended_by != DURATION else self._shared.duration
        return Outcome(
            [k],
            times,
            {name: result[name].values[None] for name in self._channels},
            end if stopped is None else stopped,
            ended_by,
            attributes["failure"],
            attributes["integrator"],
            [" ".join(warnings_of(result))],
            [attributes["steps"]],
            [attributes["evaluations"]],
            {name: result[name].values[None] for name in LIMITS if name in result},
        )
