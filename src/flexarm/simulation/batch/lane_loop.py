"""Sampled control loops of many runs side by side, which lanes advance to each sample time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import as_slice
from flexarm.arm.observe import channels_of
from flexarm.base.errors import check_array
from flexarm.control.contract.base import Controller, Reference, declares
from flexarm.control.hardware.instruments import NoiseOfRuns, Readings
from flexarm.control.hardware.measurement import Measurement
from flexarm.integrate.base import FloatArray, Status
from flexarm.integrate.lanes.data import LaneDrive, LaneRuns
from flexarm.integrate.memory import REJECTED, STEPS
from flexarm.model import Hardware, Sensor
from flexarm.simulation.batch.lane_arrays import factors_of
from flexarm.simulation.calls.limits import instrument_numbers, motor_numbers
from flexarm.simulation.histories.loads import LoadHistory
from flexarm.simulation.loop.actuators import Acting
from flexarm.simulation.loop.sensors import measured_names
from flexarm.simulation.run.validity import RunawayWatch

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


class LaneLoop:
    """Sampled loop of runs with the same sample times and hardware, except for the seeds.

    The rules are those of ``loop.SampleSchedule`` and ``loop.ClosedLoop``. Runs that fail are
    marked in ``alive``; the caller executes them again, one at a time, for the reason.

    Args:
        arms: of the runs. loops: their controllers.
        users: lock of functions of users, and of objects that runs share.
        loads: of all runs.

    Attributes:
        alive: (runs,) whether a run has not failed.
        commands: torques (runs, joints) of each sample time; times: (s).
        controllers: that of each run, if it is one of its own.
    """

    def __init__(
        self,
        arms: Sequence[Arm],
        loops: Sequence[LoopOfRun],
        duration: float,
        users: Lock,
        loads: LoadHistory,
    ) -> None:
        self._arms, self._loops, self._count = arms, loops, len(arms)
        self._arm = arms[0] if all(arm is arms[0] for arm in arms) else None
        self._joints = arms[0].joints
        self._duration, self._users = duration, users
        self._sample_time = loops[0].controller.sample_time
        hardware = loops[0].hardware
        self.acting = Acting(hardware, arms[0], runs=self._count)
        self._bodies = as_slice(arms[0].assembly.joint_body)
        self._drive = self._new_drive(arms[0].assembly.bodies, loads)
        self._exact = hardware is None or hardware.instruments is None
        self._readers = self._sensors()
        self._watches = _by_object(arms, RunawayWatch)
        self._small = np.array([watch.surely_small for watch in self._watches])
        self.alive = np.ones(self._count, dtype=bool)
        self.times: list[float] = []
        self.commands: list[FloatArray] = []
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

    def _sensors(self) -> list[tuple[Readings | str, _Reader]]:
        """Return the instruments with the readers of their signals; exact sensors by name."""
        hardware = self._loops[0].hardware
        if hardware is None or hardware.instruments is None:
            names = measured_names(self._arms[0], None, 0)
            return [(name, self._reader(name)) for name in names]
        found: list[tuple[Readings | str, _Reader]] = []
        spawned = [
            np.random.default_rng(loop.hardware.seed).spawn(len(hardware.instruments))
            for loop in self._loops
            if loop.hardware is not None
        ]
        for item, generators in zip(hardware.instruments, zip(*spawned, strict=True), strict=True):
            readings = Readings(item, self._sample_time, NoiseOfRuns(generators))
            found.append((readings, self._reader(str(item.output))))
        return found

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

    def _measured(self, tick: int, states: FloatArray) -> dict[str, FloatArray]:
        """Return the readings (runs, k) by name."""
        values: dict[str, FloatArray] = {}
        for sensor, read in self._readers:
            if isinstance(sensor, str):
                values[sensor] = read(states)
            elif sensor.exact:
                values[sensor.labels[0]] = read(states)
            else:
                if sensor.wants(tick):
                    sensor.take(tick, read(states))
                sensor.write_available(tick, values)
        if self._exact and "strain" not in values:
            values["strain"] = np.zeros((self._count, 0))
        return values

    def execute(self, advance: Callable[[LaneDrive, LaneRuns, int], None], runs: LaneRuns) -> None:
        """Advance all runs to their ends, except for those that fail.

        Args:
            advance: function that advances ``runs`` under a drive to their ``until``, in at most a
                number of steps.
        """
        tick, now = 0, 0.0
        # Skip a last sample time that lies before the end by rounding alone.
        while now < self._duration * (1.0 - 1e-12) and self.alive.any():
            values = self._measured(tick, runs.state)
            torque = self._updated(now, values)
            self.times.append(now)
            self.commands.append(torque)
            self.acting.command(now, torque)
            tick += 1
            following = tick * self._sample_time
            self._hold(advance, runs, now, min(following, self._duration))
            self._look(runs.state)
            now = following

    def _updated(self, t: float, values: dict[str, FloatArray]) -> FloatArray:
        """Return the torques (runs, joints) that the controllers command at time t."""
        torque = np.zeros((self._count, self._joints))
        with self._users:
            teams, self._teams = self._teams, []
            for team in teams:
                self._teams += self._commanded(team, t, values, torque)
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

    def _hold(
        self,
        advance: Callable[[LaneDrive, LaneRuns, int], None],
        runs: LaneRuns,
        now: float,
        until: float,
    ) -> None:
        """Advance from a sample time to the next one, in parts of constant commands."""
        acting, drive, pieces = self.acting, self._drive, self.acting.pieces
        while now < until:
            acting.hold(now, None if acting.plain else runs.state[:, 1, self._bodies, 0])
            change = acting.next_change(now, until)
            if acting.plain:
                drive.coefficients[:, 0, self._bodies] = acting.target
            else:
                breaks, cubics = acting.cubics(now, change)
                drive.breaks[:] = breaks
                by_run = drive.coefficients.reshape(self._count, pieces, 4, -1)
                by_run[:, :, :, self._bodies] = cubics.transpose(2, 0, 1, 3)
            # A run that has failed is not advanced.
            runs.until[:] = np.where(self.alive, change, -1.0)
            most = int((runs.counts[:, STEPS] + runs.counts[:, REJECTED]).max())
            advance(drive, runs, most + _MOST_STEPS)
            self.alive &= runs.status == Status.DONE
            now = change

    def _look(self, states: FloatArray) -> None:
        """Mark the runs with a link that bends by many times its length."""
        size = np.abs(states[:, 0, :, 1:]).reshape(self._count, -1).max(axis=1, initial=0.0)
        for row in np.flatnonzero(self.alive & ~(size < self._small)).tolist():
            self.alive[row] = not self._watches[row](states[row])

    @property
    def instruments(self) -> list[Readings]:
        """States of the instruments, of all runs."""
        return [sensor for sensor, _ in self._readers if isinstance(sensor, Readings)]

    def limits(self) -> dict[str, FloatArray]:
        """Return the numbers of motors and instruments at their limits, each (runs, ...)."""
        numbers = instrument_numbers(self.instruments)
        if self.acting.limited:
            numbers |= motor_numbers(*self.acting.saturated(), self._duration)
        return numbers

    def applied_at(self, times: FloatArray, rows: Rows) -> FloatArray:
        """Return the torques (k, T, joints) applied to runs (k,) at times (T,)."""
        return self.acting.at(times)[:, rows].swapaxes(0, 1)

    def commanded_at(self, times: FloatArray, rows: Rows) -> FloatArray:
        """Return the last commanded torques (k, T, joints) of runs (k,) at times (T,)."""
        index = np.searchsorted(np.asarray(self.times), times * (1.0 + 1e-12), side="right") - 1
        commands = np.asarray(self.commands)[:, rows]
        return commands[np.clip(index, 0, None)].swapaxes(0, 1)


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
