"""Execution of runs in packs of eight, for the cases that ``integrate.lanes`` supports."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.bending import BendingErrors, theory_error
from flexarm.arm.observe import channels_of, contact_channels
from flexarm.base.errors import InputError, SimulationError
from flexarm.integrate.base import FloatArray, Status, Tolerance
from flexarm.integrate.lanes.data import LaneDrive, LaneRuns
from flexarm.integrate.lanes.stepper import (
    CONTACT_PLACES,
    LOAD_PLACES,
    LOAD_VALUES,
    LaneIntegrator,
    LaneStepper,
    lane_method,
)
from flexarm.integrate.memory import (
    CLOCK_PLACES,
    COUNT_PLACES,
    EVALUATIONS,
    SAMPLES,
    STEP,
    STEPS,
    TOUCHES,
)
from flexarm.kernels.compilation.packs import COMPILED
from flexarm.kernels.layout import ArmConstants, Contacts, Loads, run_time_sizes
from flexarm.model.scenarios.scenario import DURATION
from flexarm.simulation.batch.execution import ClosedLoop, OpenLoop, Outcome, Variations, attempt
from flexarm.simulation.calls.limits import deep_contact
from flexarm.simulation.calls.preparation import Situation
from flexarm.simulation.calls.result import BY_CONTACTS, BY_FORCES
from flexarm.simulation.histories.loads import LoadHistory, constants_with
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.contacts import contact_frequency, contacts_of_run, refuse_deep_start
from flexarm.simulation.run.impacts import (
    LOOSER,
    doubt_of_growth,
    growth_error,
    may_grow,
    repeats_growth,
    returns_to_surface,
    scaled,
)
from flexarm.simulation.run.integrator_choice import Choice, choose_by_drive, choose_integrator
from flexarm.simulation.run.settings import relative_tolerance, request_of, tolerances_of
from flexarm.simulation.run.small_motion import small_motion
from flexarm.simulation.run.stepping import system_of
from flexarm.simulation.run.tolerance import absolute_tolerance, fastest_frequencies, tip_units
from flexarm.simulation.run.validity import axial_load
from flexarm.simulation.run.work import Start, choose_by_work

#: Attempted steps of a run in a lane. Longer runs are executed one at a time, where Ctrl-C and
#: steps that become ever shorter are noticed.
MOST_STEPS = 200_000
#: Samples whose channels are computed together, which bounds the scratch memory.
_CHUNK = 4096
_TORQUES = frozenset({"torque", "torque_command"})
#: Function that advances runs under a drive to their ends, or by at most that many steps.
Advance = Callable[[LaneDrive, LaneRuns, int], None]


def fits_lanes(variations: Variations, shared: Situation, channels: Collection[str]) -> bool:
    """Return whether lanes support the runs, as far as that is known before their start."""
    settings, contacts = shared.settings, shared.environment.contacts
    if shared.events or shared.prescribed or shared.changes:
        return False
    if settings.specialized or settings.stations:
        return False
    unknown = BY_FORCES - BY_CONTACTS if contacts else BY_FORCES
    return all(map(arm_fits_lanes, variations.arms)) and not unknown.intersection(channels)


def arm_fits_lanes(arm: Arm) -> bool:
    """Return whether lanes support the arm: compiled, no joint stops, bristles or sticking."""
    free = (joint.limits is None and not joint.backlash for joint in arm.spec.joints)
    assembly = arm.assembly
    return COMPILED and all(free) and not (assembly.has_bristles or assembly.has_sticking)


class Ready(NamedTuple):
    """A run before its start."""

    number: int
    arm: Arm
    state: FloatArray  # (2, n, 1 + m)
    loads: LoadHistory
    drive: Any  # torque over time, or what computes it
    group: tuple[Any, ...] = ()  # runs with equal groups are executed together
    touch: float = 0.0  # rad/s, of the arm on the stiffest surface of a contact


class Lanes(ABC):
    """Runs eight at a time in each thread.

    Runs that fail, that need another method, or whose functions of time fail are executed by
    ``alone``. This depends on the run alone, so that a run has the same numbers in every batch.
    """

    def __init__(
        self,
        variations: Variations,
        shared: Situation,
        channels: Collection[str],
        alone: OpenLoop | ClosedLoop,
    ) -> None:
        self._variations, self._shared, self._settings = variations, shared, shared.settings
        self._factors: dict[tuple[int, ...], PiecewiseCubic] = {}
        self._loads: LoadHistory | None = None  # of the only arm
        self._channels, self._alone = channels, alone
        self._times = shared.times
        self._observed = set(channels) - BY_CONTACTS
        self._steppers: dict[tuple[float, ...], LaneStepper] = {}
        arm = variations.arms[0]
        self._arm = arm if variations.same_arm else None
        self._bending = BendingErrors(arm)
        self._tolerance = self._tolerance_of(arm)

    def _tolerance_of(self, arm: Arm) -> Tolerance:
        """Return the tolerance of runs of an arm, without their highest frequencies."""
        horizon = self._shared.duration
        relative, absolute, scale = tolerances_of(self._settings, arm)
        return Tolerance(absolute, relative, tip_units(arm, scale, horizon), 1.0 / horizon, scale)

    def __call__(self, runs: range) -> Iterator[Outcome]:
        """Execute the runs of a block; yield their outcomes."""
        ready = self._ready(runs)
        done: set[int] = set()
        fastest = self._fastest(ready)
        groups: dict[tuple[Any, ...], tuple[LaneIntegrator, list[int]]] = {}
        method = None
        for place, run in enumerate(ready):
            if place == 0 or self._settings.integrator == "auto":
                method = self._method(run, float(fastest[place]))
            if method is not None:
                sizes = () if self._arm else _structure(run)
                relative = relative_tolerance(self._settings, run.arm)
                key = (method.name, (*sizes, relative), *run.group)
                groups.setdefault(key, (method, []))[1].append(place)
        for key, (method, places) in groups.items():
            group = [ready[place] for place in places]
            for outcome in self._advance(method, key[1], group, fastest[places]):
                done.update(outcome.runs)
                yield outcome
        for k in runs:
            if k not in done:
                yield attempt(self._alone, k)

    def _ready(self, runs: range) -> list[Ready]:
        """Return the runs whose arguments are valid; ``alone`` reports the others."""
        states, found = self._starts(runs), []
        for row, k in enumerate(runs):
            with suppress(SimulationError, InputError):
                arm = self._arm or self._variations.arm(k)
                found.append(self._run(k, arm, None if states is None else states[row]))
        return found

    @abstractmethod
    def _run(self, k: int, arm: Arm, state: FloatArray | None) -> Ready:
        """Return run k before its start, by default from the start of its motion."""

    def _loads_on(self, arm: Arm) -> LoadHistory:
        """Return the loads of a run."""
        if self._loads is not None:
            return self._loads
        with self._alone.users:
            found = self._shared.loads_of(arm, self._factors)
        if self._arm is not None:
            self._loads = found
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

    def _fastest(self, ready: Sequence[Ready]) -> FloatArray:
        """Return the highest frequencies (k,) of runs, rad/s."""
        least = 1.0 / self._shared.duration
        if self._arm is not None and ready:
            return fastest_frequencies(self._arm, np.array([run.state for run in ready]), least)
        return np.array([fastest_frequencies(run.arm, run.state[None], least)[0] for run in ready])

    def _method(self, run: Ready, fastest: float) -> LaneIntegrator | None:
        """Return the method of a run; None if lanes do not have it."""
        try:
            choice = self._choice(run, self._tolerance._replace(fastest=fastest))
        except InputError:  # a hopeless run, which ``alone`` reports
            return None
        return None if choice.doubt else lane_method(choice.integrator)

    def _choice(self, run: Ready, tolerance: Tolerance) -> Choice:
        """Return the integrator of a run."""
        requested = self._settings.integrator, self._settings.step
        return choose_integrator(
            *requested, run.arm, tolerance, run.touch, duration=self._shared.duration
        )

    def _advance(
        self,
        method: LaneIntegrator,
        key: tuple[float, ...],
        ready: Sequence[Ready],
        fastest: FloatArray,
    ) -> Iterator[Outcome]:
        """Yield the outcomes of the runs that reach their end; ``key`` as in `_stepper`."""
        runs = self._begin(method, ready, fastest)
        stepper = self._stepper(key, method, ready[0])
        carried = self._carry(partial(stepper.advance, method), ready, runs)
        done = np.flatnonzero(runs.status == Status.DONE)
        done = done[[self._counts(method, ready[int(k)], runs, int(k)) for k in done]]
        done, carried = self._verified(method, key, ready, runs, done, carried)
        together = max(1, _CHUNK // max(1, self._times.size)) if self._arm else 1
        for first in range(0, len(done), together):
            yield self._outcome(method, ready, runs, done[first : first + together], carried)

    def _begin(
        self, method: LaneIntegrator, ready: Sequence[Ready], fastest: FloatArray
    ) -> LaneRuns:
        """Return runs of one group at their start."""
        states, count = np.array([run.state for run in ready]), len(ready)
        fastest = np.maximum(fastest, [run.touch for run in ready])
        arms = [run.arm for run in (ready[:1] if self._arm else ready)]
        placed = [run.loads.placed for run in ready]
        runs = LaneRuns(
            *arms_of_runs(arms, placed, self._settings.atol, self._shared.duration),
            state=states,
            fastest=fastest,
            clock=np.zeros((count, CLOCK_PLACES)),
            counts=np.zeros((count, COUNT_PLACES), dtype=np.int64),
            status=np.full(count, Status.PAUSED.value),
            sample_times=self._times,
            samples=np.empty((count, self._times.size, *states.shape[1:])),
            until=np.full(count, self._shared.duration),
        )
        runs.clock[:, STEP] = [method.first_step(float(one)) for one in fastest]
        return runs

    def _verified(
        self,
        method: LaneIntegrator,
        key: tuple[float, ...],
        ready: Sequence[Ready],
        runs: LaneRuns,
        done: NDArray[np.intp],
        carried: Any,
    ) -> tuple[NDArray[np.intp], Any]:
        """Return the runs ``done`` that remain, and ``carried``, after a comparison with others."""
        return done, carried

    def _counts(self, method: LaneIntegrator, run: Ready, runs: LaneRuns, place: int) -> bool:
        """Return whether a completed run is the result, and not to be repeated by ``alone``.

        Runs that return to surfaces are repeated: ``alone`` estimates their errors.
        """
        touches = int(runs.counts[place, TOUCHES]) if method.adaptive else None
        samples = runs.samples[place, : runs.counts[place, SAMPLES]]
        contacts = run.loads.placed.contacts
        return not returns_to_surface(run.arm, contacts, samples, touches)

    @abstractmethod
    def _carry(self, advance: Advance, ready: Sequence[Ready], runs: LaneRuns) -> Any:
        """Advance the runs of one group; return what ``_torques`` and ``_warnings`` need."""

    @abstractmethod
    def _torques(
        self, times: FloatArray, ready: Sequence[Ready], places: NDArray[np.intp], carried: Any
    ) -> dict[str, FloatArray]:
        """Return the channels of torques (k, samples, joints) of the runs at ``places`` (k,)."""

    def _warnings(self, notices: str, run: Ready, place: int, carried: Any) -> list[str]:
        """Return the warnings of a run; ``notices``: those of its result, or empty."""
        return [notices]

    def _limits(
        self,
        times: FloatArray,
        ready: Sequence[Ready],
        samples: FloatArray,
        places: NDArray[np.intp],
        carried: Any,
    ) -> tuple[dict[str, FloatArray], list[list[str]]]:
        """Return numbers of ``LIMITS`` (k, ...) and warnings of the runs ``ready`` (k,)."""
        pairs = zip(ready, samples, strict=True)
        deep = [deep_contact(run.arm, run.loads.placed.contacts, row) for run, row in pairs]
        return {}, [[text] for text in deep]

    def _outcome(
        self,
        method: LaneIntegrator,
        ready: Sequence[Ready],
        runs: LaneRuns,
        places: NDArray[np.intp],
        carried: Any,
    ) -> Outcome:
        """Return the outcome of some runs of one arm, whose channels are computed together."""
        # If the last sample time is a rounding error before the end, there is one sample less.
        count = int(runs.counts[places[0], SAMPLES])
        times, samples = self._times[:count], runs.samples[places, :count]
        own = [ready[place] for place in places]
        arm, shape = own[0].arm, samples.shape[:2]
        channels: dict[str, FloatArray] = {}
        if self._observed:
            observed = channels_of(arm, samples.reshape(-1, *samples.shape[2:]), self._observed)
            channels = {name: row.reshape(*shape, *row.shape[1:]) for name, row in observed.items()}
        if not _TORQUES.isdisjoint(self._channels):
            channels |= self._torques(times, ready, places, carried)
        if not BY_CONTACTS.isdisjoint(self._channels):
            pairs = zip(own, samples, strict=True)
            rows = [contact_channels(r.arm, r.loads.placed.contacts, row) for r, row in pairs]
            channels |= {name: np.array([row[name] for row in rows]) for name in rows[0]}
        largest = np.abs(samples[:, :, 0, :, 1:]).max(axis=1)
        small = self._bending.surely_small(largest) if self._arm else np.zeros(len(own), bool)
        limits, texts = self._limits(times, own, samples, places, carried)
        if "contact_gap" in channels:
            limits["contact_depth"] = np.maximum(-channels["contact_gap"].min(axis=1), 0.0)
        warnings = []
        for row, (run, place) in enumerate(zip(own, places.tolist(), strict=True)):
            bent = "" if small[row] else theory_error(arm, samples[row])
            pulled = axial_load(run.arm, times, samples[row], run.loads)
            notices = " ".join(filter(None, [bent, pulled, *texts[row]]))
            found = self._warnings(notices, run, place, carried)
            warnings.append(" ".join(filter(None, found)))
        return Outcome(
            [run.number for run in own],
            times,
            channels,
            self._shared.duration,
            DURATION,
            "",
            method.name,
            warnings,
            runs.counts[places, STEPS].tolist(),
            runs.counts[places, EVALUATIONS].tolist(),
            limits,
        )

    def _stepper(
        self, key: tuple[float, ...], method: LaneIntegrator, run: Ready, looser: float = 1.0
    ) -> LaneStepper:
        """Return the stepper of runs like one, whose arms and loads have arrays of equal sizes.

        Args:
            looser: factor of the tolerances.
        """
        key = (*key, looser)
        if key not in self._steppers:  # by two threads at the same time: one is not kept
            own = run.arm.assembly.constants, run.loads.placed
            tolerance = scaled(self._tolerance_of(run.arm), looser)
            self._steppers[key] = LaneStepper(*own, tolerance, several=self._arm is None)
        return self._steppers[key]


class OpenLanes(Lanes):
    """Runs under given torques, eight at a time in each thread."""

    _alone: OpenLoop

    def _run(self, k: int, arm: Arm, state: FloatArray | None) -> Ready:
        if state is None:
            state = self._alone.start(k, arm)
        history = self._alone.history(k, arm, state, relative_tolerance(self._settings, arm))
        loads, touch = self._touching(self._loads_on(arm), arm, state)
        return Ready(k, arm, state, loads, history, touch=touch)

    def _counts(self, method: LaneIntegrator, run: Ready, runs: LaneRuns, place: int) -> bool:
        if not super()._counts(method, run, runs, place):
            return False
        if not method.adaptive:
            return True
        tolerance = self._tolerance_of(run.arm)._replace(unit=self._unit_of(runs, place))
        samples = runs.samples[place, : runs.counts[place, SAMPLES]]
        default = self._settings.atol is None
        steps = int(runs.counts[place, STEPS])
        return small_motion(tolerance, tolerance.relative, default, samples, steps) is None

    def _touching(
        self, loads: LoadHistory, arm: Arm, state: FloatArray
    ) -> tuple[LoadHistory, float]:
        """Return loads with the contacts of a run, and the frequency of the arm on them, rad/s."""
        if not self._shared.environment.contacts:
            return loads, 0.0
        contacts = contacts_of_run(arm, self._shared.environment.contacts, state)
        refuse_deep_start(arm, state, contacts)
        placed = loads.placed._replace(contacts=contacts)
        return replace(loads, placed=placed), contact_frequency(arm, contacts)

    def _choice(self, run: Ready, tolerance: Tolerance) -> Choice:
        choice = super()._choice(run, tolerance)
        stops = run.loads.stops_with(run.drive)
        choice = choose_by_drive(choice, run.arm, stops, self._shared.duration)
        touch = max(tolerance.fastest, run.touch)
        start = Start(
            run.arm,
            run.state,
            self._tolerance_of(run.arm)._replace(fastest=touch),
            self._shared.duration,
            partial(system_of, run.arm, (), run.loads, run.drive),
        )
        return choose_by_work(choice, start)

    def _carry(self, advance: Advance, ready: Sequence[Ready], runs: LaneRuns) -> dict[int, str]:
        histories = [run.drive for run in ready]
        advance(drive_of_runs(ready[0].arm, histories, ready[0].loads), runs, MOST_STEPS)
        return {}

    def _verified(
        self,
        method: LaneIntegrator,
        key: tuple[float, ...],
        ready: Sequence[Ready],
        runs: LaneRuns,
        done: NDArray[np.intp],
        carried: dict[int, str],
    ) -> tuple[NDArray[np.intp], dict[int, str]]:
        """Return the runs that ``alone`` does not repeat, and warnings by place in ``ready``.

        The comparison is that of ``simulate``, see `impacts.may_grow`.
        """
        far = [int(k) for k in done if self._is_compared(method, ready[k].arm, runs, int(k))]
        if not far:
            return done, carried
        compared = [ready[k] for k in far]
        others = self._begin(method, compared, runs.fastest[far])
        stepper = self._stepper(key, method, compared[0], LOOSER)
        self._carry(partial(stepper.advance, method), compared, others)
        repeated = []
        for row, place in enumerate(far):
            if others.status[row] != Status.DONE:
                continue
            runs.counts[place, EVALUATIONS] += others.counts[row, EVALUATIONS]
            arm, request = ready[place].arm, request_of(self._settings, ready[place].arm)
            assert request is not None
            samples = runs.samples[place, : runs.counts[place, SAMPLES]]
            error = growth_error(arm, samples, others.samples[row, : others.counts[row, SAMPLES]])
            if repeats_growth(error, request):
                repeated.append(place)
            carried[place] = doubt_of_growth(arm, self._times, error, request)
        return np.setdiff1d(done, repeated), carried

    def _is_compared(self, method: LaneIntegrator, arm: Arm, runs: LaneRuns, place: int) -> bool:
        """Return whether a run at the default accuracy is compared with another one."""
        if self._settings.accuracy is not None or request_of(self._settings, arm) is None:
            return False
        samples = runs.samples[place, : runs.counts[place, SAMPLES]]
        return may_grow(
            method.name, samples, constants_with(arm, ()), self._unit_of(runs, place), self._times
        )

    @staticmethod
    def _unit_of(runs: LaneRuns, place: int) -> FloatArray:
        unit: FloatArray = runs.unit[min(place, len(runs.unit) - 1)]
        return unit

    def _warnings(self, notices: str, run: Ready, place: int, carried: dict[int, str]) -> list[str]:
        return [notices, carried.get(place, "")]

    def _torques(
        self, times: FloatArray, ready: Sequence[Ready], places: NDArray[np.intp], carried: Any
    ) -> dict[str, FloatArray]:
        return {"torque": np.array([ready[k].drive.at(times) for k in places])}


def _structure(run: Ready) -> tuple[int, ...]:
    """Return numbers that are equal for runs in lanes of one pack.

    They are the sizes of the arrays of the arm, the bodies of its loads and contacts, and the
    identity of the factors of the loads, which are common.
    """
    sizes = map(len, run_time_sizes(run.arm.assembly.constants))
    placed = run.loads.placed
    bodies = *placed.body.tolist(), -1, *placed.contacts.body.tolist()
    return (*sizes, *bodies, id(run.loads.factors))


def arms_of_runs(
    arms: Sequence[Arm], loads: Sequence[Loads], atol: float | None, horizon: float
) -> tuple[ArmConstants, FloatArray, Loads, Contacts]:
    """Return constants, units of the tolerance, loads and contacts, in the form of ``LaneRuns``.

    Args:
        arms: of each run, or one of all.
        loads: of each run, on the same bodies. With one arm, only the contacts differ.
        atol, horizon: of all runs, see ``tolerance_of``.
    """
    found = [arm.assembly.constants for arm in arms]
    constants = ArmConstants(*(np.stack(arrays) for arrays in zip(*found, strict=True)))
    scales = [absolute_tolerance(arm, atol, 1.0)[1] for arm in arms]
    units = np.stack([tip_units(*pair, horizon) for pair in zip(arms, scales, strict=True)])
    touching = [one.contacts for one in loads]
    contacts = _stacked(touching[: len(arms)], CONTACT_PLACES)
    contacts = contacts._replace(law=np.stack([one.law for one in touching]))
    return constants, units, _stacked(loads[: len(arms)], LOAD_VALUES + LOAD_PLACES), contacts


def _stacked(records: Sequence[Any], names: Sequence[str]) -> Any:
    """Return the first record, with some of its arrays stacked with those of the others."""
    arrays = {name: np.stack([getattr(one, name) for one in records]) for name in names}
    return records[0]._replace(**arrays)


def drive_of_runs(arm: Arm, histories: Sequence[PiecewiseCubic], loads: LoadHistory) -> LaneDrive:
    """Join the torques of the runs; equal objects are stored once."""
    different = list({id(history): history for history in histories}.values())
    places, starts = {}, np.zeros(3, dtype=np.int64)
    stops = [loads.stops_with(history) for history in different]
    for history, own in zip(different, stops, strict=True):
        sizes = [history.breaks.size, len(history.coefficients), own.size]
        ends = starts + sizes
        places[id(history)] = np.stack([starts, ends], axis=1).ravel()
        starts = ends
    return LaneDrive(
        breaks=np.concatenate([history.breaks for history in different]),
        coefficients=np.concatenate(
            [arm.padded_torque(history.coefficients) for history in different]
        ),
        stops=np.concatenate(stops),
        places=np.array([places[id(history)] for history in histories]),
        **_factors_of(loads),
    )


def held_drive(count: int, pieces: int, bodies: int, loads: LoadHistory) -> LaneDrive:
    """Return a drive of runs with torques of their own, zero here, in a number of pieces."""
    first, stops = pieces * np.arange(count), loads.factors.stops
    places = np.zeros((count, 6), dtype=np.int64)
    places[:, 1], places[:, 2], places[:, 3] = pieces + 1, first, first + pieces
    places[:, 5] = stops.size
    coefficients = np.zeros((count * pieces, 4, bodies))
    return LaneDrive(np.arange(pieces + 1.0), coefficients, stops, places, **_factors_of(loads))


def _factors_of(loads: LoadHistory) -> dict[str, FloatArray]:
    """Return the fields of ``LaneDrive`` for loads."""
    return {
        "amplitude": loads.placed.value,
        "factor_breaks": loads.factors.breaks,
        "factor_coefficients": np.ascontiguousarray(loads.factors.coefficients),
    }
