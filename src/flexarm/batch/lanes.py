"""Execution of runs in packs of eight, for the cases that ``integrate.lanes`` supports."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm import Arm
from flexarm.batch.execution import OpenLoop, Outcome, attempt
from flexarm.batch.variations import Variations
from flexarm.bending import BendingErrors, theory_error
from flexarm.engine.integrator_choice import choose_by_drive, choose_integrator
from flexarm.engine.tolerance import fastest_frequencies, tip_units
from flexarm.errors import InputError, SimulationError
from flexarm.histories.piecewise import PiecewiseCubic
from flexarm.integrate.base import FloatArray, Status, Tolerance
from flexarm.integrate.lanes.data import LaneDrive, LaneRuns
from flexarm.integrate.lanes.stepper import LaneIntegrator, LaneStepper, lane_method
from flexarm.integrate.memory import CLOCK_PLACES, COUNT_PLACES, EVALUATIONS, STEP, STEPS
from flexarm.kernels.compilation.packs import COMPILED
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
    if not (plain and variations.same_arm) or options.specialized or options.stations:
        return False
    return arm_fits_lanes(variations.arms[0]) and not BY_FORCES.intersection(channels)


def arm_fits_lanes(arm: Arm) -> bool:
    """Return whether lanes support the arm: compiled kernels, and no joint stops."""
    return COMPILED and all(joint.limits is None for joint in arm.spec.joints)


def _is_absent(value: Any) -> bool:
    return value is None or (isinstance(value, list | tuple | dict) and not value)


class _Ready(NamedTuple):
    """A run before its start."""

    number: int
    state: FloatArray  # (2, n, 1 + m)
    history: PiecewiseCubic


class Lanes:
    """Runs of one arm under given torques, eight at a time in each thread.

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
        self._arm = variations.arms[0]
        self._options, self._channels, self._alone = options, channels, alone
        self._times = options.times
        self._bending = BendingErrors(self._arm)
        self._tolerance = Tolerance(options.atol, options.rtol, tip_units(self._arm), 1.0)
        self._stepper = LaneStepper(self._arm.assembly.constants, self._tolerance)

    def __call__(self, runs: range) -> Iterator[tuple[int, Outcome]]:
        """Execute the runs of a block; yield the number and the outcome of each."""
        ready, done = self._ready(runs), set()
        states = np.array([run.state for run in ready])
        fastest = fastest_frequencies(self._arm, states) if ready else np.zeros(0)
        groups: dict[str, tuple[LaneIntegrator, list[int]]] = {}
        for place, run in enumerate(ready):
            method = self._method(run.history, float(fastest[place]))
            if method is not None:
                groups.setdefault(method.name, (method, []))[1].append(place)
        for method, places in groups.values():
            group = [ready[place] for place in places]
            for k, outcome in self._advance(method, group, states[places], fastest[places]):
                done.add(k)
                yield k, outcome
        for k in runs:
            if k not in done:
                yield k, attempt(self._alone, k)

    def _ready(self, runs: range) -> list[_Ready]:
        """Return the runs whose start and torque are valid; ``alone`` reports the others."""
        found = []
        for k in runs:
            with suppress(SimulationError, InputError):
                state = self._alone.start(k, self._arm)
                history = self._alone.history(k, self._arm, state, self._options.rtol)
                found.append(_Ready(k, state, history))
        return found

    def _method(self, history: PiecewiseCubic, fastest: float) -> LaneIntegrator | None:
        """Return the method of a run; None if lanes do not have it."""
        options, tolerance = self._options, self._tolerance._replace(fastest=fastest)
        choice = choose_integrator(options.integrator, options.step, self._arm, tolerance)
        choice = choose_by_drive(choice, self._arm, tolerance, history.stops, options.duration)
        return None if choice.doubt else lane_method(choice.integrator)

    def _advance(
        self,
        method: LaneIntegrator,
        ready: Sequence[_Ready],
        states: FloatArray,
        fastest: FloatArray,
    ) -> Iterator[tuple[int, Outcome]]:
        """Yield the outcomes of the runs that reach their end, with their numbers."""
        count = len(ready)
        runs = LaneRuns(
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
        drive = _drive(self._arm, [run.history for run in ready])
        self._stepper.advance(method, drive, runs, _MOST_STEPS)
        done = np.flatnonzero(runs.status == Status.DONE)
        together = max(1, _CHUNK // max(1, self._times.size))
        for first in range(0, len(done), together):
            yield from self._outcomes(method, ready, runs, done[first : first + together])

    def _outcomes(
        self,
        method: LaneIntegrator,
        ready: Sequence[_Ready],
        runs: LaneRuns,
        places: NDArray[np.intp],
    ) -> Iterator[tuple[int, Outcome]]:
        """Yield the outcomes of some runs, whose channels are computed together."""
        samples = runs.samples[places]
        channels: dict[str, FloatArray] = {}
        if self._channels:
            flat = samples.reshape(-1, *samples.shape[2:])
            found = channels_of(self._arm, flat, self._channels)
            shape = samples.shape[:2]
            channels = {name: row.reshape(*shape, *row.shape[1:]) for name, row in found.items()}
        largest = np.abs(samples[:, :, 0, :, 1:]).max(axis=1)
        for row, place in enumerate(places):
            run = ready[place]
            own = {name: values[row] for name, values in channels.items()}
            if "torque" in self._channels:
                own["torque"] = run.history.at(self._times)
            small = self._bending.surely_small(largest[row])
            yield (
                run.number,
                Outcome(
                    self._times,
                    own,
                    self._options.duration,
                    DURATION,
                    "",
                    "" if small else theory_error(self._arm, samples[row]),
                    method.name,
                    int(runs.counts[place, STEPS]),
                    int(runs.counts[place, EVALUATIONS]),
                ),
            )


def _drive(arm: Arm, histories: Sequence[PiecewiseCubic]) -> LaneDrive:
    """Join the torques of the runs; equal objects are stored once."""
    different = list({id(history): history for history in histories}.values())
    places, starts = {}, np.zeros(3, dtype=np.int64)
    for history in different:
        sizes = [history.breaks.size, len(history.coefficients), history.stops.size]
        ends = starts + sizes
        places[id(history)] = np.stack([starts, ends], axis=1).ravel()
        starts = ends
    return LaneDrive(
        breaks=np.concatenate([history.breaks for history in different]),
        coefficients=np.concatenate(
            [arm.padded_torque(history.coefficients) for history in different]
        ),
        stops=np.concatenate([history.stops for history in different]),
        places=np.array([places[id(history)] for history in histories]),
    )
