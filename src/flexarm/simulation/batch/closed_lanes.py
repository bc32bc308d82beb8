"""Runs with controllers in packs of eight, which lanes advance from one sample time to the next."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from copy import deepcopy
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import as_slice
from flexarm.arm.observe import channels_of
from flexarm.base.errors import FlexarmError, InputError, check_array
from flexarm.control.contract.base import Controller, Reference, declares, report_of
from flexarm.control.hardware.instruments import NoiseOfRuns, Readings, stride_and_delay
from flexarm.control.hardware.measurement import Measurement
from flexarm.integrate.base import FloatArray, Status, Tolerance
from flexarm.integrate.lanes.data import LaneDrive, LaneRuns
from flexarm.integrate.memory import REJECTED, STEPS
from flexarm.model import Hardware, Sensor
from flexarm.simulation.batch.execution import ClosedLoop
from flexarm.simulation.batch.lanes import Advance, Lanes, Ready, factors_of, fits_lanes
from flexarm.simulation.batch.variations import Variations
from flexarm.simulation.calls.compare import INCONSISTENT
from flexarm.simulation.calls.limits import (
    instrument_numbers,
    instrument_warning,
    motor_numbers,
    motor_warning,
)
from flexarm.simulation.calls.preparation import Situation, start_of
from flexarm.simulation.histories.loads import LoadHistory
from flexarm.simulation.loop.actuators import Acting
from flexarm.simulation.loop.control_loop import ControlLoop, misfits, sampled_reference
from flexarm.simulation.loop.sensors import Sensing, measured_names
from flexarm.simulation.loop.stability import AnalysedLoop, Poles, instability
from flexarm.simulation.run.integrator_choice import Choice, friction_doubt
from flexarm.simulation.run.validity import RunawayWatch
from flexarm.simulation.run.work import choose_by_samples

#: Attempted steps of a run between two sample times. Longer runs are executed one at a time.
_MOST_STEPS = 200_000
#: Signals of instruments that are not functions of the state alone.
_BY_TORQUE = ("torque", "contact_force", "contact_gap")

Rows = NDArray[np.intp]
#: Function of the states (runs, 2, n, 1 + m) that returns the values (runs, k) of a signal.
_Reader = Callable[[FloatArray], FloatArray]


class LoopOfRun(NamedTuple):
    """Controller of a run, before its start.

    Attributes:
        controller, reference: as given by the user.
        sampled: the reference, tabulated at the sample times if possible.
        hardware: with the seed of the run.
        unstable: warning of an unstable loop, or empty.
    """

    controller: Controller
    reference: Reference | None
    sampled: Reference | None
    hardware: Hardware | None
    unstable: str


def can_read(hardware: Hardware | None) -> bool:
    """Return whether the signals of all instruments are functions of the state alone."""
    instruments = (hardware.instruments if hardware is not None else None) or ()
    signals = [item.output for item in instruments]
    return not any(isinstance(signal, Sensor) or signal in _BY_TORQUE for signal in signals)


class _Team(NamedTuple):
    """A controller and the runs for which it computes torques."""

    controller: Controller
    reference: Reference | None
    rows: Rows
    together: bool  # one call for all rows; otherwise there is one row

    def torque(self, t: float, values: dict[str, FloatArray], joints: int) -> FloatArray:
        """Return the torques (rows, joints) N m from the readings of all runs.

        Raises:
            Exception: any, from the controller; InputError if the shape is wrong, or the torque
                of a single run is not finite.
        """
        if not self.together:
            row = int(self.rows[0])
            own = Measurement(**{name: value[row] for name, value in values.items()})
            given = self.controller.update(t, own, self.reference)
            return check_array("torque", given, (joints,))
        everybody = self.rows.size == len(next(iter(values.values())))
        rows = slice(None) if everybody else self.rows
        own = Measurement(**{name: value[rows] for name, value in values.items()})
        given = np.asarray(self.controller.update(t, own, self.reference))
        if given.dtype != np.float64 or given.shape != (self.rows.size, joints):
            return check_array("torque", given, (self.rows.size, joints))
        return given


def fits_closed_lanes(variations: Variations, shared: Situation, channels: Collection[str]) -> bool:
    """Return whether lanes support runs with controllers, as far as known before their start."""
    fits = fits_lanes(variations, shared, channels) and not shared.environment.contacts
    return fits and can_read(variations.hardware)


class ClosedLanes(Lanes):
    """Runs with controllers, eight at a time in each thread.

    Controllers are called by one thread at a time.
    """

    _alone: ClosedLoop

    def __init__(
        self,
        variations: Variations,
        shared: Situation,
        channels: Collection[str],
        alone: ClosedLoop,
    ) -> None:
        super().__init__(variations, shared, channels, alone)
        self._references: dict[tuple[int, float], Reference | None] = {}
        self._poles: dict[tuple[Any, ...], Poles] = {}

    def prepare(self) -> None:
        """Validate the first run.

        Raises:
            InputError: if ``simulate`` would raise it.
        """
        arm = self._variations.arm(0)
        try:
            self._run(0, arm, None)
        except FlexarmError:
            self._alone(0)

    def _run(self, k: int, arm: Arm, state: FloatArray | None) -> Ready:
        """Return run k before its start."""
        own, duration = self._variations, self._shared.duration
        controller, reference, hardware = own.controller(k), own.reference(k), own.hardware_of(k)
        assert controller is not None
        sample_time, loads = controller.sample_time, self._loads_on(arm)
        with self._alone.users:
            if state is None:
                state = start_of(arm, *own.state_of(k), reference, None)
            if problems := misfits(controller, arm, reference, hardware, 0):
                raise InputError(*problems)
            Acting(hardware, arm)
            for instrument in (hardware.instruments if hardware is not None else None) or ():
                stride_and_delay(instrument, sample_time)
            key = id(reference), sample_time
            if key not in self._references:
                self._references[key] = sampled_reference(reference, sample_time, duration)
            unstable = self._instability(k, arm, state)
        loop = LoopOfRun(controller, reference, self._references[key], hardware, unstable)
        return Ready(k, arm, state, loads, loop, (sample_time,))

    def _choice(self, run: Ready, tolerance: Tolerance, duration: float | None = None) -> Choice:
        choice = super()._choice(run, tolerance, duration)
        longest = float(run.drive.controller.sample_time)
        by_accuracy = self._by_accuracy(run.arm)
        choice = choose_by_samples(choice, run.arm, longest, self._shared.duration, by_accuracy)
        return choice._replace(doubt=friction_doubt(choice.integrator, run.arm, longest))

    def _instability(self, k: int, arm: Arm, state: FloatArray) -> str:
        """Return the warning of an unstable loop; equal loops are analysed once."""
        own = self._variations
        controller, reference = own.controller(k), own.reference(k)
        assert controller is not None
        # Arms with changed parameters are not kept, so that another one may have the same id.
        simulated = arm.spec if own.parameters else id(arm)
        known = self._poles.setdefault((simulated, id(controller), id(reference)), {})
        model, q = self._alone.model or arm, arm.unpadded(state[0])
        loop = model, arm, controller, reference, own.hardware, (), q, self._shared.duration
        return instability(AnalysedLoop(*loop), known)

    def _carry(self, advance: Advance, ready: Sequence[Ready], runs: LaneRuns) -> LaneLoop:
        loops = [run.drive for run in ready]
        duration, users = self._shared.duration, self._alone.users
        loads = ready[0].loads
        arms = [run.arm for run in ready]
        loop = LaneLoop(advance, runs, arms, loops, duration, users, loads)
        loop.execute()
        runs.status[~loop.alive] = Status.PAUSED
        return loop

    def _torques(
        self, times: FloatArray, ready: Sequence[Ready], places: NDArray[np.intp], carried: LaneLoop
    ) -> dict[str, FloatArray]:
        return {
            "torque": carried.acting.at(times)[:, places].swapaxes(0, 1),
            "torque_command": carried.command_at(times)[:, places].swapaxes(0, 1),
        }

    def _limits(
        self,
        times: FloatArray,
        ready: Sequence[Ready],
        samples: FloatArray,
        places: NDArray[np.intp],
        carried: LaneLoop,
    ) -> tuple[dict[str, FloatArray], list[list[str]]]:
        numbers = {name: values[places] for name, values in carried.limits().items()}
        if not numbers:
            return {}, [[] for _ in ready]
        texts, joints = [], ready[0].arm.assembly.joint_body
        for row, (run, place) in enumerate(zip(ready, places.tolist(), strict=True)):
            own = {name: values[row] for name, values in numbers.items()}
            found = [instrument_warning(carried.instruments, own)]
            if carried.acting.limited:
                since, saturated = carried.acting.saturated()
                loop, angle = run.drive, samples[row][:, 0, joints, 0]
                limits = since, saturated[:, place]
                with self._alone.users:  # the reference may be an object of the user
                    found.append(
                        motor_warning(
                            run.arm, loop.controller, loop.reference, times, angle, limits, own
                        )
                    )
            texts.append(found)
        return numbers, texts

    def _warnings(self, notices: str, run: Ready, place: int, carried: LaneLoop) -> list[str]:
        found = [run.drive.unstable, notices]
        if place in carried.controllers:
            with self._alone.users:
                report = report_of(carried.controllers[place])
            found += [INCONSISTENT] * (report.get("estimator_consistent", 1) == 0)
        return found


class LaneLoop(ControlLoop):
    """Loop of runs with the same sample times and hardware, except for the seeds.

    Runs that fail are marked in ``alive``; the caller executes them again, one at a time, for the
    reason.

    Args:
        advance: function that advances ``runs`` under a drive to their ``until``, in at most a
            number of steps.
        arms: of the runs. loops: their controllers.
        users: lock of functions of users, and of objects that runs share.
        loads: of all runs.

    Attributes:
        alive: (runs,) whether a run has not failed.
        controllers: that of each run, if it is one of its own.
    """

    def __init__(
        self,
        advance: Advance,
        runs: LaneRuns,
        arms: Sequence[Arm],
        loops: Sequence[LoopOfRun],
        duration: float,
        users: Lock,
        loads: LoadHistory,
    ) -> None:
        self._advanced, self._runs = advance, runs
        self._arms, self._loops, self._count = arms, loops, len(arms)
        self._arm = arms[0] if all(arm is arms[0] for arm in arms) else None
        self._joints = arms[0].joints
        self._duration, self._now, self._users = duration, 0.0, users
        hardware = loops[0].hardware
        acting = Acting(hardware, arms[0], runs=self._count)
        super().__init__(acting, loops[0].controller.sample_time)
        self._bodies = as_slice(arms[0].assembly.joint_body)
        self._drive = self._new_drive(arms[0].assembly.bodies, loads)
        self._sensing = self._sensors()
        self._watches = _by_object(arms, RunawayWatch)
        self._small = np.array([watch.surely_small for watch in self._watches])
        self.alive = np.ones(self._count, dtype=bool)
        self.controllers: dict[int, Controller] = {}
        with users:
            self._teams = self._new_teams()

    def _new_drive(self, bodies: int, loads: LoadHistory) -> LaneDrive:
        pieces, count = self.acting.pieces, self._count
        first = pieces * np.arange(count)
        places = np.zeros((count, 6), dtype=np.int64)
        places[:, 1] = pieces + 1
        places[:, 2], places[:, 3] = first, first + pieces
        coefficients, stops = np.zeros((count * pieces, 4, bodies)), loads.factors.stops
        places[:, 5] = stops.size
        breaks = np.arange(pieces + 1.0)
        return LaneDrive(breaks, coefficients, stops, places, **factors_of(loads))

    def _new_teams(self) -> list[_Team]:
        """Return the controllers, each with as many runs as it accepts."""
        groups: dict[tuple[int, int], list[int]] = {}
        teams = []
        for row, loop in enumerate(self._loops):
            if _vectorized(loop.controller):
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
        return Sensing(
            [
                (Readings(item, self.sample_time, noise), self._reader(str(item.output)))
                for item, noise in zip(hardware.instruments, noises, strict=True)
            ]
        )

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
        rates: FloatArray = self._runs.state[:, 1, self._bodies, 0]
        return rates

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


def _vectorized(controller: Controller) -> bool:
    given = bool(getattr(controller, "vectorized", False))
    return given and declares(controller, "vectorized")


def _channel(arm: Arm, states: FloatArray, name: str) -> FloatArray:
    """Return a channel at states (k, 2, n, 1 + m)."""
    return arm.strains(states) if name == "strain" else channels_of(arm, states, [name])[name]


def _by_object(items: Sequence[Any], create: Callable[[Any], Any]) -> list[Any]:
    """Return one created object for each item; equal items share it."""
    known = {id(item): create(item) for item in {id(item): item for item in items}.values()}
    return [known[id(item)] for item in items]
