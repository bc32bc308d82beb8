"""Execution of runs in packs of eight, for the cases that ``integrate.lanes`` supports."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from threading import local
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
from flexarm.integrate import Integrator
from flexarm.integrate.base import FloatArray, Status, Tolerance
from flexarm.integrate.explicit_runge_kutta.lane_data import (
    LaneDrive,
    LaneMemory,
    LaneMethod,
    LaneRuns,
)
from flexarm.integrate.explicit_runge_kutta.lanes import advance_lanes
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.memory import CLOCK_PLACES, COUNT_PLACES, EVALUATIONS, STEP, STEPS
from flexarm.kernels.compilation.packs import COMPILED, LANES, Packs
from flexarm.kernels.layout import Workspace, new_workspace, no_loads, run_time_sizes
from flexarm.model.scenarios.events import DURATION
from flexarm.observe import channels_of
from flexarm.simulation.preparation import RunOptions

#: Attempted steps of a run in a lane. Longer runs are executed one at a time, where Ctrl-C and
#: steps that become ever shorter are noticed.
_MOST_STEPS = 200_000
#: Samples whose channels are computed together, which bounds the scratch memory.
_CHUNK = 4096
#: Channels that are not functions of state and torque.
_OTHER = {
    *("torque_command", "joint_force", "joint_moment", "axial_force", "shear_force"),
    *("bending_moment", "contact_force", "contact_gap", "contact_energy"),
}


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
    if not (COMPILED and plain and variations.same_arm) or options.specialized or options.stations:
        return False
    arm = variations.arms[0]
    stops = any(joint.limits is not None for joint in arm.spec.joints)
    return not stops and not _OTHER.intersection(channels)


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
        self._thread = local()
        self._bending = BendingErrors(self._arm)
        self._tolerance = Tolerance(options.atol, options.rtol, tip_units(self._arm), 1.0)

    def __call__(self, runs: range) -> Iterator[tuple[int, Outcome]]:
        """Execute the runs of a block; yield the number and the outcome of each."""
        ready, done = [], set()
        for k in runs:
            try:
                state = self._alone.start(k, self._arm)
                history = self._alone.history(k, self._arm, state, self._options.rtol)
                ready.append(_Ready(k, state, history))
            except (SimulationError, InputError):
                continue  # ``alone`` reports it
        states = np.array([run.state for run in ready])
        fastest = fastest_frequencies(self._arm, states) if ready else np.zeros(0)
        groups: dict[str, tuple[ExplicitRungeKutta, list[int]]] = {}
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

    def _method(self, history: PiecewiseCubic, fastest: float) -> ExplicitRungeKutta | None:
        """Return the method of a run; None if lanes do not have it."""
        options, tolerance = self._options, self._tolerance._replace(fastest=fastest)
        choice = choose_integrator(options.integrator, options.step, self._arm, tolerance)
        choice = choose_by_drive(choice, self._arm, tolerance, history.stops, options.duration)
        method: Integrator = choice.integrator
        if not isinstance(method, ExplicitRungeKutta) or choice.doubt:
            return None
        return method if method.adaptive or method.step is not None else None

    def _advance(
        self,
        method: ExplicitRungeKutta,
        ready: Sequence[_Ready],
        states: FloatArray,
        fastest: FloatArray,
    ) -> Iterator[tuple[int, Outcome]]:
        """Yield the outcomes of the runs that reach their end, with their numbers."""
        arm, count = self._arm, len(ready)
        runs = LaneRuns(
            state=states,
            fastest=fastest,
            clock=np.zeros((count, CLOCK_PLACES)),
            counts=np.zeros((count, COUNT_PLACES), dtype=np.int64),
            status=np.full(count, Status.PAUSED.value),
            sample_times=self._times,
            samples=np.empty((count, self._times.size, *states.shape[1:])),
            until=self._options.duration,
        )
        runs.clock[:, STEP] = [method.first_step(float(one)) for one in fastest]
        constants = arm.assembly.constants
        advance_lanes(
            run_time_sizes(constants),
            constants,
            self._tolerance,
            _coefficients(method),
            _drive(arm, [run.history for run in ready]),
            runs,
            self._memory(method),
            _MOST_STEPS,
        )
        done = np.flatnonzero(runs.status == Status.DONE)
        together = max(1, _CHUNK // max(1, self._times.size))
        for first in range(0, len(done), together):
            yield from self._outcomes(method, ready, runs, done[first : first + together])

    def _outcomes(
        self,
        method: ExplicitRungeKutta,
        ready: Sequence[_Ready],
        runs: LaneRuns,
        places: NDArray[np.intp],
    ) -> Iterator[tuple[int, Outcome]]:
        """Yield the outcomes of some runs, whose channels are computed together."""
        samples = runs.samples[places]
        channels: dict[str, FloatArray] = {}
        if self._channels:
            found = channels_of(self._arm, samples.reshape(-1, *samples.shape[2:]))
            shape = samples.shape[:2]
            channels = {
                name: found[name].reshape(*shape, *found[name].shape[1:])
                for name in self._channels
                if name != "torque"
            }
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

    def _memory(self, method: ExplicitRungeKutta) -> LaneMemory:
        """Return the scratch of the present thread for a method."""
        memories: dict[str, LaneMemory] = self._thread.__dict__.setdefault("memories", {})
        if method.name not in memories:
            memories[method.name] = _new_memory(self._arm, len(method.tableau.c))
        return memories[method.name]


def _coefficients(method: ExplicitRungeKutta) -> LaneMethod:
    tableau = method.tableau
    return LaneMethod(
        A=tableau.A,
        c=tableau.c,
        error=tableau.error,
        dense=tableau.dense,
        order=tableau.order,
        adaptive=method.adaptive,
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


def _new_memory(arm: Arm, rows: int) -> LaneMemory:
    """Allocate the scratch of a thread for a method with ``rows`` stages."""
    constants = arm.assembly.constants
    n, m = constants.S.shape
    work: Any = {
        name: Packs.zeros(*array.shape)
        for name, array in new_workspace(constants)._asdict().items()
    }
    return LaneMemory(
        state=Packs.zeros(2, n, 1 + m),
        new=Packs.zeros(2, n, 1 + m),
        point=Packs.zeros(2, n, 1 + m),
        torque=Packs.zeros(n),
        stages=Packs.zeros(rows, 2, n, 1 + m),
        step=Packs.zeros(1),
        norm=Packs.zeros(3),
        accepted=Packs.zeros(1),
        work=Workspace(**work),
        loads=no_loads(constants),
        weights=np.zeros((1, rows)),
        run=np.full(LANES, -1),
        fresh=np.zeros(LANES, dtype=np.int64),
        lands=np.zeros(LANES, dtype=np.int64),
        piece=np.zeros(LANES, dtype=np.int64),
        end=np.zeros(LANES),
    )
