"""Execution of runs in packs of eight, for the cases that ``integrate.lanes`` supports."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm import Arm
from flexarm.batch.execution import OpenLoop, Outcome, attempt
from flexarm.batch.lane_arrays import arms_of_runs, drive_of_runs
from flexarm.batch.variations import Variations
from flexarm.bending import BendingErrors, theory_error
from flexarm.engine.integrator_choice import choose_by_drive, choose_integrator
from flexarm.engine.tolerance import fastest_frequencies, tip_units
from flexarm.errors import InputError, SimulationError
from flexarm.histories.piecewise import PiecewiseCubic
from flexarm.integrate.base import FloatArray, Status, Tolerance
from flexarm.integrate.lanes.data import LaneRuns
from flexarm.integrate.lanes.stepper import LaneIntegrator, LaneStepper, lane_method
from flexarm.integrate.memory import CLOCK_PLACES, COUNT_PLACES, EVALUATIONS, STEP, STEPS
from flexarm.kernels.compilation.packs import COMPILED
from flexarm.kernels.layout import run_time_sizes
from flexarm.model.scenarios.events import DURATION
from flexarm.observe import channels_of
from flexarm.simulation.channels import BY_FORCES
from flexarm.simulation.preparation import RunOptions

#: Attempted steps of a run in a lane. Longer runs are executed one at a time, where Ctrl-C and
#: steps that become ever shorter are noticed.
_MOST_STEPS = 200_000
#: Samples whose channels are computed together, which bounds the scratch memory.
_CHUNK = 4096


def fits_lanes(
    variations: Variations,
    options: RunOptions,
    acting: Mapping[str, Any],
    channels: Collection[str],
) -> bool:
    """Return whether lanes support the runs, as far as that is known before their start.

    Args:
        acting: as for ``OpenLoop``.
    """
    plain = all(map(_is_absent, acting.values()))
    if not plain or options.specialized or options.stations:
        return False
    return all(map(arm_fits_lanes, variations.arms)) and not BY_FORCES.intersection(channels)


def arm_fits_lanes(arm: Arm) -> bool:
    """Return whether lanes support the arm: compiled kernels, and no joint stops."""
    free = (joint.limits is None and not joint.backlash for joint in arm.spec.joints)
    return COMPILED and all(free)


def _is_absent(value: Any) -> bool:
    return value is None or (isinstance(value, list | tuple | dict) and not value)


class _Ready(NamedTuple):
    """A run before its start."""

    number: int
    arm: Arm
    state: FloatArray  # (2, n, 1 + m)
    history: PiecewiseCubic


class Lanes:
    """Runs under given torques, eight at a time in each thread.

    Runs that fail, that need another method, or whose functions of time fail are executed by
    ``alone``. This depends on the run alone, so that a run has the same numbers in every batch.
    """

    def __init__(
        self,
        variations: Variations,
        options: RunOptions,
        channels: Collection[str],
        alone: OpenLoop,
    ) -> None:
        self._variations = variations
        self._options, self._channels, self._alone = options, channels, alone
        self._times = options.times
        self._steppers: dict[tuple[int, ...], LaneStepper] = {}
        arm = variations.arms[0]
        self._arm = arm if variations.same_arm else None
        self._bending = BendingErrors(arm)
        self._tolerance = Tolerance(options.atol, options.rtol, tip_units(arm), 1.0)

    def __call__(self, runs: range) -> Iterator[Outcome]:
        """Execute the runs of a block; yield their outcomes."""
        ready = self._ready(runs)
        done: set[int] = set()
        fastest = self._fastest(ready)
        groups: dict[tuple[Any, ...], tuple[LaneIntegrator, list[int]]] = {}
        method = None
        for place, run in enumerate(ready):
            if place == 0 or self._options.integrator == "auto":
                method = self._method(run, float(fastest[place]))
            if method is not None:
                key: tuple[Any, ...] = (method.name, *(() if self._arm else _structure(run.arm)))
                groups.setdefault(key, (method, []))[1].append(place)
        for key, (method, places) in groups.items():
            stepper = self._stepper(key[1:], ready[places[0]].arm)
            group = [ready[place] for place in places]
            for outcome in self._advance(method, stepper, group, fastest[places]):
                done.update(outcome.runs)
                yield outcome
        for k in runs:
            if k not in done:
                yield attempt(self._alone, k)

    def _ready(self, runs: range) -> list[_Ready]:
        """Return the runs whose start and torque are valid; ``alone`` reports the others."""
        states, found = self._starts(runs), []
        for row, k in enumerate(runs):
            with suppress(SimulationError, InputError):
                arm = self._arm or self._variations.arm(k)
                state = self._alone.start(k, arm) if states is None else states[row]
                history = self._alone.history(k, arm, state, self._options.rtol)
                found.append(_Ready(k, arm, state, history))
        return found

    def _starts(self, runs: range) -> FloatArray | None:
        """Return the initial states (runs, 2, n, 1 + m) together; None if they depend on a run."""
        own = self._variations
        if own.initial is None:
            return None
        arm, rows = own.arms[0], slice(runs.start, runs.stop)
        both = np.zeros((len(runs), 2, arm.dof))
        for level, given in enumerate((own.initial, own.initial_rate)):
            if given is not None:
                both[:, level] = given if given.ndim == 1 else given[rows]
        return arm.padded(both)

    def _fastest(self, ready: Sequence[_Ready]) -> FloatArray:
        """Return the highest frequencies (k,) of runs, rad/s."""
        if self._arm is not None and ready:
            return fastest_frequencies(self._arm, np.array([run.state for run in ready]))
        return np.array([fastest_frequencies(run.arm, run.state[None])[0] for run in ready])

    def _method(self, run: _Ready, fastest: float) -> LaneIntegrator | None:
        """Return the method of a run; None if lanes do not have it."""
        options, tolerance = self._options, self._tolerance._replace(fastest=fastest)
        choice = choose_integrator(options.integrator, options.step, run.arm, tolerance)
        stops = run.history.stops
        choice = choose_by_drive(choice, run.arm, tolerance, stops, options.duration)
        return None if choice.doubt else lane_method(choice.integrator)

    def _advance(
        self,
        method: LaneIntegrator,
        stepper: LaneStepper,
        ready: Sequence[_Ready],
        fastest: FloatArray,
    ) -> Iterator[Outcome]:
        """Yield the outcomes of the runs that reach their end."""
        states, count = np.array([run.state for run in ready]), len(ready)
        constants, unit = arms_of_runs([run.arm for run in (ready[:1] if self._arm else ready)])
        runs = LaneRuns(
            constants=constants,
            unit=unit,
            state=states,
            fastest=fastest,
            clock=np.zeros((count, CLOCK_PLACES)),
            counts=np.zeros((count, COUNT_PLACES), dtype=np.int64),
            status=np.full(count, Status.PAUSED.value),
            sample_times=self._times,
            samples=np.empty((count, self._times.size, *states.shape[1:])),
            until=np.full(count, self._options.duration),
        )
        runs.clock[:, STEP] = [method.first_step(float(one)) for one in fastest]
        drive = drive_of_runs(ready[0].arm, [run.history for run in ready])
        stepper.advance(method, drive, runs, _MOST_STEPS)
        done = np.flatnonzero(runs.status == Status.DONE)
        together = max(1, _CHUNK // max(1, self._times.size)) if self._arm else 1
        for first in range(0, len(done), together):
            yield self._outcome(method, ready, runs, done[first : first + together])

    def _outcome(
        self,
        method: LaneIntegrator,
        ready: Sequence[_Ready],
        runs: LaneRuns,
        places: NDArray[np.intp],
    ) -> Outcome:
        """Return the outcome of some runs of one arm, whose channels are computed together."""
        samples, own = runs.samples[places], [ready[place] for place in places]
        arm, shape = own[0].arm, samples.shape[:2]
        channels: dict[str, FloatArray] = {}
        if self._channels:
            found = channels_of(arm, samples.reshape(-1, *samples.shape[2:]), self._channels)
            channels = {name: row.reshape(*shape, *row.shape[1:]) for name, row in found.items()}
        if "torque" in self._channels:
            channels["torque"] = np.array([run.history.at(self._times) for run in own])
        warnings = [""] * len(own)
        largest = np.abs(samples[:, :, 0, :, 1:]).max(axis=1)
        small = self._bending.surely_small(largest) if self._arm else np.zeros(len(own), bool)
        for row in np.flatnonzero(~small):
            warnings[row] = theory_error(arm, samples[row])
        return Outcome(
            [run.number for run in own],
            self._times,
            channels,
            self._options.duration,
            DURATION,
            "",
            method.name,
            warnings,
            runs.counts[places, STEPS].tolist(),
            runs.counts[places, EVALUATIONS].tolist(),
        )

    def _stepper(self, key: tuple[int, ...], arm: Arm) -> LaneStepper:
        """Return the stepper of runs whose arms have arrays of the same sizes."""
        if key not in self._steppers:  # by two threads at the same time: one is not kept
            constants, several = arm.assembly.constants, self._arm is None
            tolerance = self._tolerance._replace(unit=tip_units(arm))
            self._steppers[key] = LaneStepper(constants, tolerance, several)
        return self._steppers[key]


def _structure(arm: Arm) -> tuple[int, ...]:
    """Return the sizes of the arrays of an arm; runs in lanes of one pack have the same."""
    return tuple(map(len, run_time_sizes(arm.assembly.constants)))
