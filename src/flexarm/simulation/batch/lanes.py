"""Execution of runs in packs of eight, for the cases that ``integrate.lanes`` supports."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.bending import BendingErrors, theory_error
from flexarm.arm.observe import channels_of, contact_channels
from flexarm.base.errors import InputError, SimulationError
from flexarm.integrate.base import FloatArray, Status, System, Tolerance
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
from flexarm.kernels.columns import IS_FREE
from flexarm.kernels.compilation.cache import has_number_types
from flexarm.kernels.layout import ArmConstants, Array, Contacts, Loads
from flexarm.model.scenarios.scenario import DURATION
from flexarm.simulation.batch.execution import Alone, Batch, OpenLoop, Outcome, attempt
from flexarm.simulation.calls.limits import deep_contact
from flexarm.simulation.calls.result import BY_CONTACTS, BY_FORCES
from flexarm.simulation.histories.loads import LoadHistory, constants_with
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.coarse import (
    coarse,
    coarse_choice,
    coarse_errors,
    coarse_tolerance,
    is_sudden,
    most_steps,
)
from flexarm.simulation.run.contacts import contact_frequency, contacts_of_run, refuse_deep_start
from flexarm.simulation.run.impacts import (
    LOOSER,
    doubt_of_growth,
    growth_error,
    joined,
    may_grow,
    repeats_growth,
    returns_to_surface,
    scaled,
)
from flexarm.simulation.run.integrator_choice import (
    Choice,
    choose_by_drive,
    choose_integrator,
    fastest_of,
)
from flexarm.simulation.run.settings import relative_tolerance, request_of, tolerances_of
from flexarm.simulation.run.small_motion import small_motion
from flexarm.simulation.run.stepping import system_of
from flexarm.simulation.run.tolerance import (
    absolute_tolerance,
    fastest_frequencies,
    reach_of,
    tip_units,
)
from flexarm.simulation.run.validity import axial_loads
from flexarm.simulation.run.work import Start, choose_by_work

#: Attempted steps of a run in a lane. Longer runs are executed one at a time, where Ctrl-C and
#: steps that become ever shorter are noticed.
MOST_STEPS = 200_000
#: Samples whose channels are computed together, which bounds the scratch memory.
_CHUNK = 4096
_TORQUES = frozenset({"torque", "torque_command"})


def fits_lanes(batch: Batch) -> bool:
    """Return whether lanes support the runs, as far as that is known before their start."""
    shared, settings = batch.shared, batch.shared.settings
    special = shared.events or shared.prescribed or shared.changes or settings.specialized
    if special or settings.stations:
        return False
    unknown = BY_FORCES - BY_CONTACTS if shared.environment.contacts else BY_FORCES
    return all(map(arm_fits_lanes, batch.runs.arms)) and not unknown.intersection(batch.channels)


def arm_fits_lanes(arm: Arm) -> bool:
    """Return whether lanes support the arm."""
    free = (joint.limits is None and not joint.backlash for joint in arm.spec.joints)
    assembly = arm.assembly
    followed = assembly.has_bristles or assembly.has_sticking or arm.closure_rows
    isolated = assembly.constants.arm[IS_FREE] > 0.0  # its momentum is kept
    return has_number_types() and all(free) and not followed and not isolated


class Ready(NamedTuple):
    """A run before its start."""

    number: int
    arm: Arm
    state: FloatArray  # (2, n, 1 + m)
    loads: LoadHistory
    drive: Any  # torque over time, or what computes it
    group: tuple[Any, ...] = ()  # runs with equal groups are executed together
    touch: float = 0.0  # rad/s, of the arm on the stiffest surface of a contact
    large: float | None = None  # relative tolerance, which a second run verifies
    spent: int = 0  # evaluations of an earlier attempt


@dataclass
class Group:
    """Runs that lanes advance together, by one method."""

    method: LaneIntegrator
    sizes: tuple[float, ...]  # see `_structure`
    ready: Sequence[Ready]
    runs: LaneRuns
    most_steps: int  # attempted ones of each run
    carried: Any = None  # what advanced them, for their channels and warnings
    inaccurate: list[int] = field(default_factory=list)  # places of runs with large tolerances
    errors: dict[int, float] = field(default_factory=dict)  # m, of tips, by place

    def samples(self, place: int) -> FloatArray:
        """Return the samples (k, 2, n, 1 + m) of a run."""
        return np.asarray(self.runs.samples[place, : self.runs.counts[place, SAMPLES]])

    def unit(self, place: int) -> FloatArray:
        """Return `Tolerance.unit` of a run."""
        return np.asarray(self.runs.unit[min(place, len(self.runs.unit) - 1)])


class Lanes(ABC):
    """Runs eight at a time in each thread.

    Runs that fail, that need another method, or whose functions of time fail are executed by
    ``alone``. This depends on the run alone, so that a run has the same numbers in every batch.
    """

    def __init__(self, batch: Batch, alone: Alone) -> None:
        self._batch, self._alone = batch, alone
        self._shared, self._settings = batch.shared, batch.shared.settings
        self._factors: dict[tuple[int, ...], PiecewiseCubic] = {}
        self._loads: LoadHistory | None = None  # of the only arm
        self._times = batch.shared.times
        self._observed = set(batch.channels) - BY_CONTACTS
        self._steppers: dict[tuple[float, ...], LaneStepper] = {}
        arm = batch.runs.arms[0]
        self._arm = arm if batch.runs.same_arm else None
        self._bending = BendingErrors(arm)
        self._tolerance = self._tolerance_of(arm)
        #: Runs whose channels are computed together.
        self._together = max(1, _CHUNK // max(1, self._times.size)) if self._arm else 1

    def _tolerance_of(self, arm: Arm) -> Tolerance:
        """Return the small tolerance of runs of an arm, without their highest frequencies."""
        horizon = self._shared.duration
        relative, absolute, scale = tolerances_of(self._settings, arm)
        return Tolerance(absolute, relative, tip_units(arm, scale, horizon), 1.0 / horizon, scale)

    @abstractmethod
    def prepare(self) -> None:
        """Validate what the first run shares with the others."""

    def __call__(self, runs: range) -> Iterator[Outcome]:
        """Execute the runs of a block; yield their outcomes."""
        done: set[int] = set()
        waiting = self._ready(runs)
        while waiting:
            groups, waiting = self._groups(waiting), []
            for group in groups:
                for outcome in self._executed(group):
                    done.update(outcome.runs)
                    yield outcome
                waiting += self._again(group)
        for k in runs:
            if k not in done:
                yield attempt(self._alone, k)

    def _groups(self, ready: Sequence[Ready]) -> list[Group]:
        """Return runs at their start, in groups that lanes advance together."""
        fastest = self._fastest(ready)
        groups: dict[tuple[Any, ...], tuple[LaneIntegrator, list[int]]] = {}
        method = None
        for place, run in enumerate(ready):
            rate = float(fastest[place])
            if place == 0 or self._settings.integrator == "auto":
                method = self._method(run, rate)
            if method is not None:
                sizes = () if self._arm else _structure(run)
                relative = self._tolerance_of_run(run).relative
                key = (method.name, (*sizes, relative), self._most_steps(run, rate), *run.group)
                groups.setdefault(key, (method, []))[1].append(place)
        return [
            self._begin(method, key[1], [ready[place] for place in places], fastest[places], key[2])
            for key, (method, places) in groups.items()
        ]

    def _ready(self, runs: range) -> list[Ready]:
        """Return the runs whose arguments are valid; ``alone`` reports the others."""
        states, ready = self._starts(runs), []
        for row, k in enumerate(runs):
            with suppress(SimulationError, InputError):
                arm = self._arm or self._batch.runs.arm(k)
                ready.append(self._run(k, arm, None if states is None else states[row]))
        return ready

    @abstractmethod
    def _run(self, k: int, arm: Arm, state: FloatArray | None) -> Ready:
        """Return run k before its start, by default from the start of its motion."""

    def _most_steps(self, run: Ready, fastest: float) -> int:
        """Return the attempted steps of a run in a lane; ``fastest``: rad/s."""
        return MOST_STEPS

    def _again(self, group: Group) -> list[Ready]:
        """Return the runs of an executed group that lanes execute again."""
        return []

    def _tolerance_of_run(self, run: Ready) -> Tolerance:
        tolerance = self._tolerance_of(run.arm)
        return tolerance if run.large is None else coarse(tolerance, run.arm, run.large)

    def _loads_on(self, arm: Arm) -> LoadHistory:
        """Return the loads of a run."""
        if self._loads is not None:
            return self._loads
        with self._batch.users:
            loads = self._shared.loads_of(arm, self._factors)
        if self._arm is not None:
            self._loads = loads
        return loads

    def _starts(self, runs: range) -> FloatArray | None:
        """Return the initial states (runs, 2, n, 1 + m) together; None if they depend on a run."""
        own = self._batch.runs
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
        duration = self._shared.duration
        return choose_integrator(*requested, run.arm, tolerance, run.touch, duration=duration)

    def _executed(self, group: Group) -> Iterator[Outcome]:
        """Yield the outcomes of the runs that reach their end."""
        self._carry(group)
        done = np.flatnonzero(group.runs.status == Status.DONE)
        done = self._verified(group, done[[self._counts(group, int(k)) for k in done]])
        for first in range(0, len(done), self._together):
            yield self._outcome(group, done[first : first + self._together])

    def _begin(
        self,
        method: LaneIntegrator,
        sizes: tuple[float, ...],
        ready: Sequence[Ready],
        fastest: FloatArray,
        most_steps: int,
    ) -> Group:
        """Return runs of one group at their start."""
        arms = [run.arm for run in (ready[:1] if self._arm else ready)]
        placed = [run.loads.placed for run in ready]
        states, end = np.array([run.state for run in ready]), self._shared.duration
        constants = arms_of_runs(arms, placed, self._settings.atol, end)
        fastest, until = np.maximum(fastest, [run.touch for run in ready]), np.full(len(ready), end)
        runs = lane_runs(constants, states, fastest, until, self._times)
        runs.clock[:, STEP] = [method.first_step(float(rate)) for rate in runs.fastest]
        runs.counts[:, EVALUATIONS] = [run.spent for run in ready]
        return Group(method, sizes, ready, runs, most_steps)

    def _verified(self, group: Group, done: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the runs ``done`` that remain after a comparison with others."""
        return done

    def _counts(self, group: Group, place: int) -> bool:
        """Return whether a completed run is the result, and not to be repeated by ``alone``.

        Runs that return to surfaces are repeated: ``alone`` estimates their errors.
        """
        run, touches = group.ready[place], int(group.runs.counts[place, TOUCHES])
        counted, contacts = touches if group.method.adaptive else None, run.loads.placed.contacts
        return not returns_to_surface(run.arm, contacts, group.samples(place), counted)

    @abstractmethod
    def _carry(self, group: Group, looser: float = 1.0) -> None:
        """Advance the runs of a group, with tolerances multiplied by a factor."""

    @abstractmethod
    def _torques(
        self, group: Group, places: NDArray[np.intp], times: FloatArray
    ) -> dict[str, FloatArray]:
        """Return the channels of torques (k, samples, joints) of the runs at ``places`` (k,)."""

    def _warnings(self, group: Group, place: int, notices: str) -> list[str]:
        """Return the warnings of a run; ``notices``: those of its result, or empty."""
        return [notices]

    def _limits(
        self, group: Group, places: NDArray[np.intp], times: FloatArray, samples: FloatArray
    ) -> tuple[dict[str, FloatArray], list[list[str]]]:
        """Return numbers of ``LIMITS`` (k, ...) and warnings of the runs at ``places`` (k,)."""
        pairs = zip([group.ready[place] for place in places], samples, strict=True)
        deep = [deep_contact(run.arm, run.loads.placed.contacts, row) for run, row in pairs]
        errors = [group.errors.get(place, np.nan) for place in places.tolist()]
        numbers = {"integration_error": np.array(errors)} if group.errors else {}
        return numbers, [[text] for text in deep]

    def _outcome(self, group: Group, places: NDArray[np.intp]) -> Outcome:
        """Return the outcome of some runs of one arm, whose channels are computed together."""
        counts, wanted = group.runs.counts, self._batch.channels
        # If the last sample time is a rounding error before the end, there is one sample less.
        count, own = int(counts[places[0], SAMPLES]), [group.ready[place] for place in places]
        times, samples = self._times[:count], group.runs.samples[places, :count]
        arm, shape = own[0].arm, samples.shape[:2]
        channels: dict[str, FloatArray] = {}
        if self._observed:
            observed = channels_of(arm, samples.reshape(-1, *samples.shape[2:]), self._observed)
            channels = {name: row.reshape(*shape, *row.shape[1:]) for name, row in observed.items()}
        if not _TORQUES.isdisjoint(wanted):
            channels |= self._torques(group, places, times)
        if not BY_CONTACTS.isdisjoint(wanted):
            pairs = zip(own, samples, strict=True)
            rows = [contact_channels(r.arm, r.loads.placed.contacts, row) for r, row in pairs]
            channels |= {name: np.array([row[name] for row in rows]) for name in rows[0]}
        largest = np.abs(samples[:, :, 0, :, 1:]).max(axis=1)
        small = self._bending.surely_small(largest) if self._arm else np.zeros(len(own), bool)
        limits, texts = self._limits(group, places, times, samples)
        if "contact_gap" in channels:
            limits["contact_depth"] = np.maximum(-channels["contact_gap"].min(axis=1), 0.0)
        # Runs of one arm have the same loads, but not the same contacts.
        together = self._arm and not self._shared.environment.contacts
        parts = samples[None] if together else samples[:, None]
        loaded = [axial_loads(r.arm, times, x, r.loads) for r, x in zip(own, parts, strict=False)]
        pulled = [text for texts_of_runs in loaded for text in texts_of_runs]
        warnings = []
        for row, place in enumerate(places.tolist()):
            bent = "" if small[row] else theory_error(arm, samples[row])
            notices = joined(bent, pulled[row], *texts[row])
            warnings.append(joined(*self._warnings(group, place, notices)))
        numbers = [run.number for run in own]
        reached = self._shared.duration, DURATION, "", group.method.name
        work = counts[places, STEPS].tolist(), counts[places, EVALUATIONS].tolist()
        return Outcome(numbers, times, channels, *reached, warnings, *work, limits)

    def _stepper(self, group: Group, looser: float) -> LaneStepper:
        """Return the stepper of a group, whose arms and loads have arrays of equal sizes."""
        key, run = (*group.sizes, looser), group.ready[0]
        if key not in self._steppers:  # by two threads at the same time: one is not kept
            own = run.arm.assembly.constants, run.loads.placed
            tolerance = scaled(self._tolerance_of_run(run), looser)
            self._steppers[key] = LaneStepper(*own, tolerance, several=self._arm is None)
        return self._steppers[key]


class OpenLanes(Lanes):
    """Runs under given torques, eight at a time in each thread."""

    _alone: OpenLoop

    def prepare(self) -> None:
        self._alone.prepare()

    def _run(self, k: int, arm: Arm, state: FloatArray | None) -> Ready:
        state = self._alone.start(k, arm) if state is None else state
        loads, touch, contacts = self._loads_on(arm), 0.0, self._shared.environment.contacts
        large = None if contacts else coarse_tolerance(self._settings, arm)
        relative = relative_tolerance(self._settings, arm) if large is None else large
        history = self._alone.history(k, arm, state, relative)
        if contacts:
            placed = contacts_of_run(arm, contacts, state)
            refuse_deep_start(arm, state, placed)
            loads = replace(loads, placed=loads.placed._replace(contacts=placed))
            touch = contact_frequency(arm, placed)
        run = Ready(k, arm, state, loads, history, touch=touch, large=large)
        if large is not None and is_sudden(self._settings, arm, _system(run), history, state):
            return self._small(run, 0)
        return run

    def _most_steps(self, run: Ready, fastest: float) -> int:
        if run.large is None:
            return MOST_STEPS
        tolerance = self._tolerance_of_run(run)._replace(fastest=fastest)
        stops = len(run.loads.stops_with(run.drive))
        return most_steps(fastest_of(run.arm, tolerance), self._shared.duration, stops)

    def _again(self, group: Group) -> list[Ready]:
        if group.ready[0].large is None:
            return []
        stopped = np.flatnonzero(group.runs.status == Status.PAUSED).tolist()
        places = [*stopped, *group.inaccurate]
        return [self._small(group.ready[k], group.runs.counts[k, EVALUATIONS]) for k in places]

    def _small(self, run: Ready, spent: int) -> Ready:
        """Return a run with small tolerances, after one that was not accurate, or not cheap."""
        small = relative_tolerance(self._settings, run.arm)
        history = self._alone.history(run.number, run.arm, run.state, small)
        return run._replace(drive=history, large=None, spent=int(spent))

    def _counts(self, group: Group, place: int) -> bool:
        if not super()._counts(group, place):
            return False
        if not group.method.adaptive:
            return True
        arm, unit, samples = group.ready[place].arm, group.unit(place), group.samples(place)
        tolerance = self._tolerance_of_run(group.ready[place])._replace(unit=unit)
        default, steps = self._settings.atol is None, int(group.runs.counts[place, STEPS])
        return small_motion(arm, tolerance, tolerance.relative, default, samples, steps) is None

    def _choice(self, run: Ready, tolerance: Tolerance) -> Choice:
        if run.large is not None:
            return coarse_choice(fastest_of(run.arm, tolerance))
        choice = super()._choice(run, tolerance)
        stops = run.loads.stops_with(run.drive)
        choice = choose_by_drive(choice, run.arm, stops, self._shared.duration)
        touch = max(tolerance.fastest, run.touch)
        tolerance = self._tolerance_of(run.arm)._replace(fastest=touch)
        duration, system = self._shared.duration, partial(_system, run)
        start = Start(run.arm, run.state, tolerance, duration, system)
        return choose_by_work(choice, start)

    def _carry(self, group: Group, looser: float = 1.0) -> None:
        first, histories = group.ready[0], [run.drive for run in group.ready]
        drive = drive_of_runs(first.arm, histories, first.loads)
        self._stepper(group, looser).advance(group.method, drive, group.runs, group.most_steps)
        group.carried = {}

    def _verified(self, group: Group, done: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the runs that ``alone`` does not repeat; ``carried`` has warnings by place.

        The comparison is that of ``simulate``, see `impacts.may_grow`.
        """
        far = [int(k) for k in done if self._is_compared(group, int(k))]
        if not far:
            return done
        compared = [group.ready[k]._replace(spent=0) for k in far]
        again = group.method, group.sizes, compared, group.runs.fastest[far]
        others = self._begin(*again, MOST_STEPS)
        self._carry(others, LOOSER)
        ended = np.flatnonzero(others.runs.status == Status.DONE).tolist()
        for row in ended:
            group.runs.counts[far[row], EVALUATIONS] += others.runs.counts[row, EVALUATIONS]
        if group.ready[0].large is not None:
            group.inaccurate = [*self._inaccurate(group, others, far)]
            return np.setdiff1d(done, group.inaccurate)
        repeated = []
        for row in ended:
            place, arm = far[row], compared[row].arm
            request = request_of(self._settings, arm)
            assert request is not None
            error = growth_error(arm, group.samples(place), others.samples(row))
            if repeats_growth(error, request):
                repeated.append(place)
            group.carried[place] = doubt_of_growth(arm, self._times, error, request)
        return np.setdiff1d(done, repeated)

    def _inaccurate(self, group: Group, others: Group, places: list[int]) -> Iterator[int]:
        """Yield the places of runs of large tolerances that ``others`` do not verify."""
        for first in range(0, len(places), self._together):
            rows = slice(first, first + self._together)
            judged = places[rows]
            count, arm = int(group.runs.counts[judged[0], SAMPLES]), group.ready[judged[0]].arm
            pair = group.runs.samples[judged, :count], others.runs.samples[rows, :count]
            steps = np.array([group.runs.counts[judged, STEPS], others.runs.counts[rows, STEPS]])
            with np.errstate(all="ignore"):  # of runs that failed
                errors = coarse_errors(arm, *pair, steps, self._settings)
            request = request_of(self._settings, arm)
            assert request is not None
            failed = others.runs.status[rows] != Status.DONE
            group.errors |= zip(judged, (errors * reach_of(arm)).tolist(), strict=True)
            yield from np.array(judged)[failed | ~(errors <= request)].tolist()

    def _is_compared(self, group: Group, place: int) -> bool:
        """Return whether a run is compared with another one."""
        arm, samples, settings = group.ready[place].arm, group.samples(place), self._settings
        large, constants = group.ready[place].large is not None, constants_with(arm, ())
        if settings.accuracy is not None or request_of(settings, arm) is None:
            return large
        how = constants, group.unit(place), self._times, large
        return may_grow(group.method.name, samples, *how)

    def _warnings(self, group: Group, place: int, notices: str) -> list[str]:
        return [notices, group.carried.get(place, "")]

    def _torques(
        self, group: Group, places: NDArray[np.intp], times: FloatArray
    ) -> dict[str, FloatArray]:
        return {"torque": np.array([group.ready[k].drive.at(times) for k in places])}


def _system(run: Ready) -> System:
    return system_of(run.arm, (), run.loads, run.drive)


def _structure(run: Ready) -> tuple[int, ...]:
    """Return numbers that are equal for runs in lanes of one pack."""
    sizes = run.arm.assembly.sizes
    order = *sizes.joints.ravel().tolist(), *sizes.ends.ravel().tolist()
    placed = run.loads.placed
    bodies = *placed.body.tolist(), -1, *placed.contacts.body.tolist()
    return (*map(len, sizes), *order, *bodies, id(run.loads.factors))


def lane_runs(
    constants: tuple[ArmConstants, FloatArray, Loads, Contacts],
    states: Array,
    fastest: Array,
    until: Array,
    times: Array,
) -> LaneRuns:
    """Return runs at their start; the arguments are fields of ``LaneRuns``."""
    count = len(states)
    clock, status = np.zeros((count, CLOCK_PLACES)), np.full(count, Status.PAUSED.value)
    counts = np.zeros((count, COUNT_PLACES), dtype=np.int64)
    samples = np.empty((count, times.size, *states.shape[1:]))
    progress = states, fastest, clock, counts, status
    return LaneRuns(*constants, *progress, times, samples, until)


def arms_of_runs(
    arms: Sequence[Arm], loads: Sequence[Loads], atol: float | None, horizon: float
) -> tuple[ArmConstants, FloatArray, Loads, Contacts]:
    """Return constants, units of the tolerance, loads and contacts, in the form of ``LaneRuns``."""
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
    breaks = np.concatenate([history.breaks for history in different])
    cubics = np.concatenate([arm.padded_torque(history.coefficients) for history in different])
    of_runs = np.array([places[id(history)] for history in histories])
    return LaneDrive(breaks, cubics, np.concatenate(stops), of_runs, **factors_of(loads))


def factors_of(loads: LoadHistory) -> dict[str, FloatArray]:
    """Return the fields of ``LaneDrive`` for loads."""
    return {
        "amplitude": loads.placed.value,
        "factor_breaks": loads.factors.breaks,
        "factor_coefficients": np.ascontiguousarray(loads.factors.coefficients),
    }
