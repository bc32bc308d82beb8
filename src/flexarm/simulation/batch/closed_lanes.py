"""Runs with controllers, and plants, in packs of eight that lanes advance by sample times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from functools import partial
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.actions import EMPTY
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import as_slice
from flexarm.arm.observe import channels_of
from flexarm.base.errors import FlexarmError, InputError, SimulationError, check_array
from flexarm.control.contract.base import Controller, Reference, declares, report_of
from flexarm.control.hardware.measurement import Measurement, NoiseOfRuns, Readings
from flexarm.integrate.base import FloatArray, Status, Tolerance
from flexarm.integrate.lanes.data import LaneDrive, LaneRuns
from flexarm.integrate.lanes.stepper import LaneIntegrator, LaneStepper, lane_method
from flexarm.integrate.memory import CLOCK_PLACES, REJECTED, STEP, STEPS, TIME
from flexarm.kernels.compilation.packs import LANES
from flexarm.model import Hardware, Sensor
from flexarm.simulation.batch.execution import Alone, Batch, OpenLoop
from flexarm.simulation.batch.lanes import (
    Group,
    Lanes,
    OpenLanes,
    Ready,
    arms_of_runs,
    factors_of,
    fits_lanes,
    lane_runs,
)
from flexarm.simulation.calls.compare import INCONSISTENT
from flexarm.simulation.calls.limits import (
    instrument_numbers,
    instrument_warning,
    motor_numbers,
    motor_warning,
    sag_warning,
)
from flexarm.simulation.calls.preparation import UNBOUNDED, start_of
from flexarm.simulation.histories.loads import LoadHistory, load_history
from flexarm.simulation.loop.control_loop import ControlLoop, misfits, sampled_reference
from flexarm.simulation.loop.devices import Acting, Sensing, hand_limits, measured_names
from flexarm.simulation.loop.stability import AnalysedLoop, Poles, Stability, stability
from flexarm.simulation.run.integrator_choice import Choice, choose_integrator, friction_doubt
from flexarm.simulation.run.settings import DEFAULTS, tolerances_of
from flexarm.simulation.run.stepping import failure_of
from flexarm.simulation.run.tolerance import fastest_frequencies, tip_units
from flexarm.simulation.run.validity import RunawayWatch
from flexarm.simulation.run.work import choose_by_samples

#: Plants that a thread advances in one call: enough to hide the cost of the call, and few enough
#: that a thread which has finished early takes another block.
_BLOCK = 256


class _Block(NamedTuple):
    """Plants that a thread advances in one call."""

    method: LaneIntegrator
    rows: Rows  # in the arguments of ``step``
    places: Rows  # of the plants


class LanePlants:
    """Plants of one arm, with its exact state and with motors that apply the torque exactly.

    Each plant has the numbers of a ``flexarm.Plant`` with the same arguments, to the last bit, for
    any number of plants and threads.

    Attributes:
        state: (count, 2, n, 1 + m) of the plants at their current times.
        tick: (count,) number of completed steps of each since its start.
    """

    def __init__(self, arm: Arm, count: int, sample_time: float, threads: int) -> None:
        self.arm, self._sample_time = arm, sample_time
        n, m = arm.assembly.bodies, arm.assembly.modes
        self.state = np.zeros((count, 2, n, 1 + m))
        self.tick = np.zeros(count, dtype=np.int64)
        self._clock = np.zeros((count, CLOCK_PLACES))
        self._fastest = np.ones(count)
        self._methods: list[LaneIntegrator] = []
        self._method = np.zeros(count, dtype=np.int64)  # index in ``_methods``
        self._horizon = UNBOUNDED * sample_time
        relative, absolute, scale = tolerances_of(DEFAULTS, arm)  # those of a `Plant`
        unit = tip_units(arm, scale, self._horizon)
        self._tolerance = Tolerance(absolute, relative, unit, 1.0 / self._horizon, scale)
        self._loads = load_history(arm, EMPTY, sample_time, relative)
        placed = self._loads.placed
        self._stepper = LaneStepper(arm.assembly.constants, placed, self._tolerance, several=False)
        self._constants = arms_of_runs([arm], [placed], None, self._horizon)
        self._threads = threads
        self._pool = ThreadPoolExecutor(threads, "flexarm") if threads > 1 else None

    @property
    def time(self) -> FloatArray:
        """Time (count,) of each plant since its start, s."""
        return self._clock[:, TIME]

    def start(self, places: Rows, q: FloatArray) -> None:
        """Begin anew at rest at the coordinates q (k, dof) of the plants ``places`` (k,)."""
        states = self.arm.padded(np.stack([q, np.zeros_like(q)], axis=1))
        fastest = fastest_frequencies(self.arm, states, 1.0 / self._horizon)
        self.state[places], self._fastest[places] = states, fastest
        self._clock[places] = 0.0
        self.tick[places] = 0
        for place, frequency in zip(places.tolist(), fastest.tolist(), strict=True):
            tolerance = self._tolerance._replace(fastest=frequency)
            choice = choose_integrator("auto", None, self.arm, tolerance, duration=self._horizon)
            choice = choose_by_samples(choice, self.arm, self._sample_time, np.inf, tolerance)
            method = lane_method(choice.integrator)
            assert method is not None  # "auto" has step control
            if method not in self._methods:
                self._methods.append(method)
            self._method[place] = self._methods.index(method)
            self._clock[place, STEP] = method.first_step(frequency)

    def step(self, places: Rows, torque: FloatArray) -> dict[int, SimulationError]:
        """Apply torques (k, joints), N m, to the plants ``places`` (k,) for one sample time.

        Returns:
            The failures by the number of the plant. The plant keeps its last valid state and its
            time, and its ``tick`` does not change; start it before the next step.
        """
        padded = self.arm.padded_torque(torque)
        blocks = [
            block
            for k, method in enumerate(self._methods)
            for block in self._blocks(method, np.flatnonzero(self._method[places] == k), places)
        ]
        if self._pool is None or len(blocks) == 1:
            done = [self._advance(block, padded) for block in blocks]
        else:
            done = list(self._pool.map(self._advance, blocks, [padded] * len(blocks)))
        failed = {}
        for block, status in zip(blocks, done, strict=True):
            self.tick[block.places] += status == Status.DONE
            for row in np.flatnonzero(status != Status.DONE):
                place = int(block.places[row])
                failed[place] = self._failure(place, Status(status[row]))
        return failed

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def _blocks(self, method: LaneIntegrator, rows: Rows, places: Rows) -> list[_Block]:
        """Divide plants of one method into blocks of whole packs, at least one for each thread."""
        share = -(-len(rows) // self._threads)
        size = min(_BLOCK, -(-share // LANES) * LANES)
        parts = [rows[k : k + size] for k in range(0, len(rows), max(size, 1))]
        return [_Block(method, part, places[part]) for part in parts]

    def _advance(self, block: _Block, torque: FloatArray) -> NDArray[np.int64]:
        """Advance the plants of a block by one sample time; return their statuses."""
        places, count = block.places, len(block.places)
        now, until = self.tick[places], (self.tick[places] + 1) * self._sample_time
        state, fastest = self.state[places], self._fastest[places]
        runs = lane_runs(self._constants, state, fastest, until, np.zeros(0))
        runs.clock[:] = self._clock[places]
        runs.clock[:, TIME] = now * self._sample_time
        drive = _held_drive(count, 1, torque.shape[1], self._loads)
        drive.coefficients[:, 0] = torque[block.rows]
        self._stepper.advance(block.method, drive, runs, _MOST_STEPS)
        self.state[places], self._clock[places] = runs.state, runs.clock
        return runs.status

    def _failure(self, place: int, status: Status) -> SimulationError:
        state = self.arm.unpadded(self.state[place])
        reason = ""
        if status == Status.PAUSED:
            reason = f"a sample time takes more than {_MOST_STEPS} steps: the motion is unstable."
        return failure_of(status, float(self.time[place]), (state[0], state[1]), reason)


#: Attempted steps of a run between two sample times: longer runs are executed one at a time, and a
#: plant fails.
_MOST_STEPS = 200_000
#: Signals of instruments that are not functions of the state alone.
_BY_TORQUE = ("torque", "contact_force", "contact_gap")

Rows = NDArray[np.intp]
#: Function of the states (runs, 2, n, 1 + m) that returns the values (runs, k) of a signal.
_Reader = Callable[[FloatArray], FloatArray]


class LoopOfRun(NamedTuple):
    """Controller of a run, before its start."""

    controller: Controller  # as given by the user
    reference: Reference | None  # likewise
    sampled: Reference | None  # the reference, tabulated at the sample times if possible
    hardware: Hardware | None  # with the seed of the run
    stability: Stability


class _Team(NamedTuple):
    """A controller and the runs for which it computes torques."""

    controller: Controller
    reference: Reference | None
    rows: Rows
    together: bool  # one call for all rows; otherwise there is one row

    def torque(self, t: float, values: dict[str, FloatArray], joints: int) -> FloatArray:
        """Return the torques (rows, joints) N m from the readings of all runs."""
        everybody = self.rows.size == len(next(iter(values.values())))
        rows: Any = slice(None) if everybody else self.rows
        rows = rows if self.together else int(self.rows[0])
        readings = Measurement(**{name: value[rows] for name, value in values.items()})
        torque: Any = self.controller.update(t, readings, self.reference)
        if not self.together:
            return check_array("torque", torque, (joints,))
        torque = np.asarray(torque)
        shape = self.rows.size, joints
        right = torque.dtype == np.float64 and torque.shape == shape
        return torque if right else check_array("torque", torque, shape)


def lanes_of(batch: Batch, alone: Alone) -> Lanes | None:
    """Return lanes; None if they do not support the runs, as far as known before their start."""
    if not fits_lanes(batch):
        return None
    if isinstance(alone, OpenLoop):
        return OpenLanes(batch, alone)
    hardware = batch.runs.hardware
    signals = [item.output for item in (hardware and hardware.instruments) or ()]
    # They have to follow from the state alone.
    beyond = any(isinstance(signal, Sensor) or signal in _BY_TORQUE for signal in signals)
    return None if beyond or batch.shared.environment.contacts else ClosedLanes(batch, alone)


class ClosedLanes(Lanes):
    """Runs with controllers, eight at a time in each thread.

    Controllers are called by one thread at a time.
    """

    def __init__(self, batch: Batch, alone: Alone) -> None:
        super().__init__(batch, alone)
        self._references: dict[tuple[int, float], Reference | None] = {}
        self._poles: dict[tuple[Any, ...], Poles] = {}

    def prepare(self) -> None:
        """Validate the first run."""
        arm = self._batch.runs.arm(0)
        try:
            self._run(0, arm, None)
        except FlexarmError:
            self._alone(0)

    def _run(self, k: int, arm: Arm, state: FloatArray | None) -> Ready:
        """Return run k before its start."""
        own, duration = self._batch.runs, self._shared.duration
        controller, reference = own.item("controllers", k), own.item("references", k)
        hardware = own.hardware_of(k)
        sample_time, loads = controller.sample_time, self._loads_on(arm)
        with self._batch.users:
            if state is None:
                state = start_of(arm, *own.state_of(k), reference, None)
            if problems := misfits(controller, arm, reference, hardware, 0):
                raise InputError(*problems)
            Acting(hardware, arm)
            key = id(reference), sample_time
            if key not in self._references:
                self._references[key] = sampled_reference(reference, sample_time, duration)
            # Equal loops are analysed once. Arms with changed parameters are not kept, so that
            # another one may have the same id.
            simulated = arm.spec if own.parameters else id(arm)
            poles = self._poles.setdefault((simulated, id(controller), id(reference)), {})
            model, q = self._batch.model or arm, arm.unpadded(state[0])
            analysed = model, arm, controller, reference, own.hardware, (), q, duration
            judged = stability(AnalysedLoop(*analysed), poles)
        loop = LoopOfRun(controller, reference, self._references[key], hardware, judged)
        return Ready(k, arm, state, loads, loop, (sample_time,))

    def _choice(self, run: Ready, tolerance: Tolerance) -> Choice:
        choice = super()._choice(run, tolerance)
        longest = float(run.drive.controller.sample_time)
        choice = choose_by_samples(choice, run.arm, longest, self._shared.duration, tolerance)
        return choice._replace(doubt=friction_doubt(choice.integrator, run.arm, longest))

    def _carry(self, group: Group, looser: float = 1.0) -> None:
        advance = partial(self._stepper(group, looser).advance, group.method)
        loop = LaneLoop(advance, group, self._shared.duration, self._batch.users)
        loop.execute()
        group.runs.status[~loop.alive] = Status.PAUSED
        group.carried = loop

    def _torques(
        self, group: Group, places: NDArray[np.intp], times: FloatArray
    ) -> dict[str, FloatArray]:
        return {
            "torque": group.carried.acting.at(times)[:, places].swapaxes(0, 1),
            "torque_command": group.carried.command_at(times)[:, places].swapaxes(0, 1),
        }

    def _limits(
        self, group: Group, places: NDArray[np.intp], times: FloatArray, samples: FloatArray
    ) -> tuple[dict[str, FloatArray], list[list[str]]]:
        loop: LaneLoop = group.carried
        numbers = {name: values[places] for name, values in loop.limits().items()}
        growth = np.array([group.ready[place].drive.stability.growth for place in places])
        grown = {"loop_growth": growth} if np.isfinite(growth).any() else {}
        texts, arm = [], group.ready[0].arm
        for row, place in enumerate(places.tolist()):
            own = {name: values[row] for name, values in numbers.items()}
            run, states = group.ready[place], samples[row]
            law = run.drive.controller, run.drive.reference
            texts.append([instrument_warning(loop.instruments, own)])
            with self._batch.users:  # the reference may be an object of the user
                if loop.acting.limited:
                    since, saturated = loop.acting.saturated()
                    angle = states[:, 0, arm.assembly.joint_body, 0]
                    limits = since, saturated[:, place]
                    texts[row].append(motor_warning(run.arm, *law, times, angle, limits, own))
                tips = partial(_channel, run.arm, states, "tip")
                texts[row].append(sag_warning(*law, times, tips))
        return numbers | grown, texts

    def _warnings(self, group: Group, place: int, notices: str) -> list[str]:
        warnings = [group.ready[place].drive.stability.text, notices]
        if place in group.carried.controllers:
            with self._batch.users:
                report = report_of(group.carried.controllers[place])
            warnings += [INCONSISTENT] * (report.get("estimator_consistent", 1) == 0)
        return warnings


class LaneLoop(ControlLoop):
    """Loop of runs with the same sample times and hardware, except for the seeds.

    Runs that fail are marked in ``alive``; the caller executes them again, one at a time, for the
    reason.

    Attributes:
        alive: (runs,) whether a run has not failed.
        controllers: that of each run, if it is one of its own.
    """

    def __init__(
        self,
        advance: Callable[[LaneDrive, LaneRuns, int], None],
        group: Group,
        duration: float,
        users: Lock,
    ) -> None:
        self._advanced, self._runs = advance, group.runs
        arms = self._arms = [run.arm for run in group.ready]
        loops: list[LoopOfRun] = [run.drive for run in group.ready]
        self._loops, self._count = loops, len(arms)
        self._arm = arms[0] if all(arm is arms[0] for arm in arms) else None
        self._joints = arms[0].n_joints
        self._duration, self._now, self._users = duration, 0.0, users
        hardware = loops[0].hardware
        acting = Acting(hardware, arms[0], runs=self._count)
        super().__init__(acting, loops[0].controller.sample_time)
        self._bodies = as_slice(arms[0].assembly.joint_body)
        bodies = arms[0].assembly.bodies
        self._drive = _held_drive(self._count, acting.pieces, bodies, group.ready[0].loads)
        self._sensing = self._sensors()
        watches = {arm: RunawayWatch(arm) for arm in dict.fromkeys(arms)}
        self._watches = [watches[arm] for arm in arms]
        self._small = np.array([watch.surely_small for watch in self._watches])
        self.alive = np.ones(self._count, dtype=bool)
        self.controllers: dict[int, Controller] = {}
        with users:
            self._teams = self._new_teams()

    def _new_teams(self) -> list[_Team]:
        """Return the controllers, each with as many runs as it accepts."""
        groups: dict[tuple[int, int], list[int]] = {}
        teams = []
        for row, loop in enumerate(self._loops):
            vectorized = getattr(loop.controller, "vectorized", False)
            if vectorized and declares(loop.controller, "vectorized"):
                key = id(loop.controller), id(loop.reference)
                groups.setdefault(key, []).append(row)
            else:
                teams += self._team([row])
        for rows in groups.values():
            teams += self._team(rows, together=True)
        return teams

    def _team(self, rows: Sequence[int], together: bool = False) -> list[_Team]:
        """Return a copy of a controller for runs, because they may share an object or its parts.

        The list is empty if that is not possible: the runs are executed alone, with the object.
        """
        loop = self._loops[rows[0]]
        try:
            mine = deepcopy(loop.controller)
            hand_limits(mine, loop.hardware, self._joints)
            mine.reset()
        except Exception:
            self.alive[list(rows)] = False
            return []
        if not together:
            self.controllers[rows[0]] = mine
        return [_Team(mine, loop.sampled, np.array(rows), together)]

    def _sensors(self) -> Sensing:
        """Return the instruments with the readers of their signals; exact sensors by name."""
        hardware = self._loops[0].hardware
        if hardware is None or hardware.instruments is None:
            names = measured_names(self._arms[0], None, 0)
            none = {} if "strain" in names else {"strain": np.zeros((self._count, 0))}
            return Sensing([(name, self._reader(name)) for name in names], none)
        spawned = [
            np.random.default_rng(loop.hardware.seed).spawn(len(hardware.instruments))
            for loop in self._loops
            if loop.hardware is not None
        ]
        noises = map(NoiseOfRuns, zip(*spawned, strict=True))
        pairs = zip(hardware.instruments, noises, strict=True)
        readings = [(Readings(item, self.sample_time, noise), item.output) for item, noise in pairs]
        return Sensing([(item, self._reader(str(output))) for item, output in readings])

    def _reader(self, name: str) -> _Reader:
        if name in ("joint_angle", "joint_rate"):
            level, joints = int(name == "joint_rate"), self._bodies
            return lambda states: states[:, level, joints, 0].copy()
        count, arms = self._count, self._arms
        if self._arm is not None:
            return lambda states: _channel(arms[0], states, name).reshape(count, -1)

        def of_each(states: FloatArray) -> FloatArray:
            found = map(_channel, arms, states[:, None], [name] * count)
            return np.array(list(found)).reshape(count, -1)

        return of_each

    @property
    def end(self) -> float:
        """End of the runs, s."""
        return self._duration

    @property
    def now(self) -> float:
        """Time that the runs have reached, s."""
        return self._now

    def _runs_on(self) -> bool:
        return super()._runs_on() and bool(self.alive.any())

    def _command(self) -> FloatArray:
        """Return the torques (runs, joints) that the controllers command."""
        values = self._sensing.values(self.tick, self._runs.state)
        torque = np.zeros((self._count, self._joints))
        with self._users:
            teams, self._teams = self._teams, []
            for team in teams:
                self._teams += self._commanded(team, self.time, values, torque)
        bad = ~np.isfinite(torque).all(axis=1)
        if bad.any():
            self.alive[bad], torque[bad] = False, 0.0
        return torque

    def _commanded(
        self, team: _Team, t: float, values: dict[str, FloatArray], torque: FloatArray
    ) -> list[_Team]:
        """Write the torques of a team; return those that go on, without runs that fail.

        If a controller does not accept the first readings of many runs, each run gets its own.
        """
        if not self.alive[team.rows].any():
            return []
        try:
            torque[team.rows] = team.torque(t, values, self._joints)
        except Exception:  # executed alone, which reports the reason
            if not team.together or self.times:
                self.alive[team.rows] = False
                return []
            own = [one for row in team.rows.tolist() for one in self._team([row])]
            return [one for each in own for one in self._commanded(each, t, values, torque)]
        return [team]

    def _rates(self) -> FloatArray:
        return np.asarray(self._runs.state[:, 1, self._bodies, 0])

    def _advance(self, now: float, until: float) -> None:
        acting, drive, runs = self.acting, self._drive, self._runs
        if acting.plain:
            drive.coefficients[:, 0, self._bodies] = acting.target
        else:
            drive.breaks[:], cubics = acting.cubics(now, until)
            by_run = drive.coefficients.reshape(self._count, acting.pieces, 4, -1)
            by_run[:, :, :, self._bodies] = cubics.transpose(2, 0, 1, 3)
        # A run that has failed is not advanced.
        runs.until[:] = np.where(self.alive, until, -1.0)
        most = int((runs.counts[:, STEPS] + runs.counts[:, REJECTED]).max())
        self._advanced(drive, runs, most + _MOST_STEPS)
        self.alive &= runs.status == Status.DONE
        self._now = until

    def _look(self) -> None:
        """Mark the runs with a link that bends by many times its length."""
        states = self._runs.state
        size = np.abs(states[:, 0, :, 1:]).reshape(self._count, -1).max(axis=1, initial=0.0)
        for row in np.flatnonzero(self.alive & ~(size < self._small)).tolist():
            self.alive[row] = not self._watches[row](states[row])

    @property
    def instruments(self) -> list[Readings]:
        """States of the instruments, of all runs."""
        return self._sensing.readings

    def limits(self) -> dict[str, FloatArray]:
        """Return the numbers of motors and instruments at their limits, each (runs, ...)."""
        numbers = instrument_numbers(self.instruments)
        if self.acting.limited:
            numbers |= motor_numbers(*self.acting.saturated(), self._duration)
        return numbers


def _channel(arm: Arm, states: FloatArray, name: str) -> FloatArray:
    """Return a channel at states (k, 2, n, 1 + m)."""
    return arm.strains(states) if name == "strain" else channels_of(arm, states, [name])[name]


def _held_drive(count: int, pieces: int, bodies: int, loads: LoadHistory) -> LaneDrive:
    """Return a drive of runs with torques of their own, zero here, in a number of pieces."""
    first, stops = pieces * np.arange(count), loads.factors.stops
    places = np.zeros((count, 6), dtype=np.int64)
    places[:, 1], places[:, 2], places[:, 3] = pieces + 1, first, first + pieces
    places[:, 5] = stops.size
    coefficients = np.zeros((count * pieces, 4, bodies))
    return LaneDrive(np.arange(pieces + 1.0), coefficients, stops, places, **factors_of(loads))
