"""Devices of the sampled loop: exact sensors, instruments, and the motors that apply commands."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.actions import marker, place_loads
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import KernelView, as_slice
from flexarm.arm.observe import channels_of, contact_forces, contact_values
from flexarm.base.errors import InputError, Problem, raise_any
from flexarm.control.contract.base import Controller, around, joint_problems
from flexarm.control.hardware.measurement import Readings
from flexarm.integrate.base import FloatArray, System
from flexarm.integrate.torque import slope_at, torque_at
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.forces.contact import GAP
from flexarm.kernels.observation.observables import poses
from flexarm.kernels.observation.point_motion import MOTION_COLUMNS, point_motions
from flexarm.model import Hardware, Instrument, Motors, Sensor
from flexarm.model.hardware import LIMITS

if TYPE_CHECKING:
    from flexarm.simulation.run.stepping import Run

#: A first-order lag is approximated by cubics over this fraction of its time constant, up to this
#: many time constants, within 1e-5 and 5e-5 of the change of torque.
_PIECE, _SETTLED = 0.25, 10.0
#: Relative difference of times that is rounding.
_SAME = 1e-12


def _remaining(target: Any, initial: Any, left: Any) -> Any:
    """Return the torque of which the share ``left`` of the change to the target remains."""
    return target + (initial - target) * left


def _towards(target: Any, start: Any, shapes: Any) -> Any:
    """Return the coefficients (pieces, 4, ...) of a torque that approaches its target."""
    coefficients = shapes.reshape(*shapes.shape, *(1,) * target.ndim) * (start - target)
    return np.concatenate([coefficients[:, :1] + target, coefficients[:, 1:]], axis=1)


@lru_cache(maxsize=64)
def _lag_shapes(followed: float, lag: float, count: int) -> tuple[float, FloatArray]:
    """Return the length (s) of a piece, and coefficients (count, 4) of the remaining torque.

    The torque that remains falls by the same factor in each piece, so that all pieces have the
    coefficients of the first one, times the torque that remains at their starts.
    """
    h = followed / (count - 1)
    fallen = -math.expm1(-h / lag)
    mean = fallen / h
    first = [1.0, -1.0 / lag, 0.0, 0.0]
    first[2] = -(3.0 * mean - (3.0 - fallen) / lag) / h
    first[3] = -((2.0 - fallen) / lag - 2.0 * mean) / h**2
    shapes = np.multiply.outer(np.exp(-h / lag * np.arange(count)), first)
    shapes[-1, 1:] = 0.0  # the torque is constant after the last break
    return h, shapes


def torque_limits(hardware: Hardware | None, joints: int, at_rest: bool = True) -> FloatArray:
    """Return the limits (joints,) N m of motors at rest, or at all rates; infinite without one."""
    motors = (hardware and hardware.motors) or Motors()
    if not at_rest and motors.back_voltage:
        motors = motors.replace(voltage_limit=math.inf)
    limits: FloatArray = motors.allowed(np.full(joints, np.inf), np.zeros(joints))
    return limits


def hand_limits(
    controller: object, hardware: Hardware | None, joints: int
) -> list[tuple[Any, Any]]:
    """Hand the limits of motors to laws with ``knows_limits``; return each with its own limit.

    Their integrals and estimates then include the limits, and do not wind up.
    """
    limits = torque_limits(hardware, joints, at_rest=False)
    if not np.isfinite(limits).any():
        return []
    laws: Any = (law for law in around(controller) if isinstance(law, Controller))
    before = [(law, law.torque_limit) for law in laws if law.knows_limits]
    for law, limit in before:
        law._limit_torque(limits if limit is None else np.minimum(limit, limits))
    return before


@contextmanager
def knowing_limits(controller: object, hardware: Hardware | None, joints: int) -> Iterator[None]:
    """Hand the limits of motors to a controller, see ``hand_limits``, for a run."""
    before = hand_limits(controller, hardware, joints)
    try:
        yield
    finally:
        for law, limit in before:
            law._limit_torque(limit)


class Acting:
    """Motors between the sample times of a controller.

    From each time in ``since`` on, the applied torque changes from ``initial`` to ``target`` with
    the factor ``1 - exp(-(t - since) / time_constant)``. Without ``keep`` only the last change is
    stored. The motors of several runs with the same sample times have torques (runs, joints)
    instead of (joints,).
    """

    def __init__(
        self, hardware: Hardware | None, arm: Arm, keep: bool = True, runs: int | None = None
    ) -> None:
        joints = arm.n_joints
        given = hardware.motors if hardware is not None else None
        self.plain = given is None  # the commanded torque acts immediately
        self._motors = given or Motors()
        limits = {f"hardware.motors.{name}": getattr(self._motors, name) for name in LIMITS}
        problems = joint_problems(joints, limits)
        if self._motors.back_voltage and any(joint.winding for joint in arm.spec.joints):
            rule = "is not supported for joints with a winding"
            hint = "Their torque is that at standstill: give its limit as torque_limit."
            problems.append(Problem("hardware.motors.voltage_limit", rule, hint=hint))
        raise_any(problems)
        self._limits = torque_limits(hardware, joints, at_rest=False)
        self._lag, self._delay = self._motors.time_constant, self._motors.delay
        self._waiting: deque[tuple[float, FloatArray]] = deque()
        self._since: list[float] = []
        self._initial: list[FloatArray] = []
        self._target: list[FloatArray] = []
        self._requested: list[FloatArray] = []
        self._nothing = np.zeros(joints if runs is None else (runs, joints))
        self._keep = keep

    @property
    def limited(self) -> bool:
        """Whether the torque of any motor has a limit."""
        motors = self._motors
        limits = motors.torque_limit, motors.current_limit, motors.voltage_limit
        return any(np.isfinite(limit).any() for limit in limits)

    @property
    def pieces(self) -> int:
        """Number of cubics for the torque over one hold interval."""
        return 1 if self._lag == 0.0 else round(_SETTLED / _PIECE) + 1

    @property
    def target(self) -> FloatArray:
        """Torque (joints,) that the motors currently approach."""
        return self._target[-1]

    def command(self, t: float, torque: FloatArray) -> None:
        """Command a torque (joints,) at time t."""
        self._waiting.append((t + self._delay, torque))

    def next_change(self, t: float, until: float) -> float:
        """Return the time at which the commanded torque changes next, at most ``until``."""
        if not self._waiting:
            return until
        # A command that is due earlier than ``until`` by rounding alone is due then.
        latest = until * (1.0 - _SAME)
        return min([until, *(due for due, _ in self._waiting if t < due < latest)])

    def hold(self, t: float, rate: FloatArray | None) -> None:
        """Apply the due command; rates (joints,) rad/s matter unless motors are ``plain``."""
        due = None
        # A command that is due later by rounding alone is due now.
        while self._waiting and self._waiting[0][0] <= t * (1.0 + _SAME):
            due = self._waiting.popleft()[1]
        if due is None and self._since:
            return
        now = self._now(t) if self._since and self._lag > 0.0 else self._nothing
        target = self._nothing if due is None else due
        if rate is not None:
            target = self._motors.allowed(target, rate)
        if not self._keep:
            for past in (self._since, self._initial, self._target, self._requested):
                past.clear()
        self._since.append(t)
        self._requested.append(self._nothing if due is None else due)
        self._initial.append(now if self._lag > 0.0 else target)
        self._target.append(target)

    def add_holds(
        self,
        times: FloatArray,
        requested: FloatArray,
        target: FloatArray | None = None,
        initial: FloatArray | None = None,
    ) -> None:
        """Note torques (k, joints) of changes at times (k,); by default those that are before."""
        target = requested if target is None else target
        self._since += times.tolist()
        self._requested += list(requested)
        self._target += list(target)
        self._initial += list(target if initial is None else initial)

    def cubics(self, t: float, until: float) -> tuple[FloatArray, FloatArray]:
        """Return breaks (pieces + 1,) of the torque, and coefficients (pieces, 4, joints)."""
        target = self._target[-1]
        if self._lag == 0.0:
            coefficients = np.zeros((self.pieces, 4, *target.shape), dtype=target.dtype)
            coefficients[:, 0] = target
            return np.array([t, until]), coefficients
        breaks, shapes = self.shapes(t, until)
        coefficients = _towards(target, self._now(t), shapes)
        return breaks, coefficients

    def shapes(self, t: float, until: float) -> tuple[FloatArray, FloatArray]:
        """Return breaks (pieces + 1,), and coefficients (pieces, 4) of the remaining torque."""
        lag, count = self._lag, self.pieces
        followed = min(until - t, _SETTLED * lag)
        h, shapes = _lag_shapes(followed, lag, count)
        breaks = np.empty(count + 1)
        breaks[:-1] = t + h * np.arange(count)
        breaks[-1] = max(until, t + followed)
        if breaks[-1] == breaks[-2]:  # breaks must increase, even if the last piece is empty
            breaks[-1] += lag
        return breaks, shapes

    def delay_in(self, sample_time: float) -> int | None:
        """Return the delay in samples; None if it is not a multiple of the sample time."""
        count = self._delay / sample_time
        return round(count) if abs(count - round(count)) <= _SAME * count else None

    def numbers(self) -> dict[str, FloatArray]:
        """Return the state between samples by name."""
        state = {f"waiting {i}": torque for i, (_, torque) in enumerate(self._waiting)}
        if self._lag > 0.0:
            state |= {"initial": self._initial[-1], "target": self._target[-1]}
        return state

    def planned(self, t: float, until: float, before: float) -> tuple[dict[str, Any], FloatArray]:
        """Return what ``step`` requires at a sample time t, and the breaks of ``cubics``.

        The sample before is at ``before``. There are no breaks if the motors are ``plain``.
        """
        if self._lag == 0.0:
            return {}, np.zeros(0) if self.plain else np.array([t, until])
        breaks, shapes = self.shapes(t, until)
        return {"left": math.exp(-(t - before) / self._lag), "shapes": shapes}, breaks

    def step(
        self, numbers: Mapping[str, Any], torque: Any, rate: Any, planned: Mapping[str, Any]
    ) -> tuple[dict[str, Any], Any, list[Any]]:
        """Return the next ``numbers``, torques as in ``Drive``, and rows for ``add_holds``.

        The samples before have commands, and the delay is a multiple of the sample time.
        """
        waiting = [numbers[name] for name in numbers if name.startswith("waiting")]
        request, *waiting = [*waiting, torque]
        target = request if self.plain else self._motors.allowed(request, rate)
        after = {f"waiting {i}": row for i, row in enumerate(waiting)}
        if self._lag == 0.0:
            return after, target.reshape(1, 1, -1), [] if self.plain else [request, target]
        initial = _remaining(numbers["target"], numbers["initial"], planned["left"])
        start = _remaining(target, initial, 1.0)
        after |= {"initial": initial, "target": target}
        return after, _towards(target, start, planned["shapes"]), [request, target, initial]

    def set_numbers(self, numbers: Mapping[str, Any], times: FloatArray) -> None:
        """Set the commands that wait, the first of them given at the first of ``times``."""
        rows = [numbers[name] for name in numbers if name.startswith("waiting")]
        due = (times + self._delay).tolist()
        self._waiting = deque(zip(due[: len(rows)], rows, strict=True))

    def saturated(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the times (k,) s of all changes, and which motors (k, joints) are at a limit."""
        requested, target = np.asarray(self._requested), np.asarray(self._target)
        # A law that knows the limits requests them, and no more.
        limited = np.abs(target) == self._limits
        return np.asarray(self._since), (requested != target) | limited

    def _now(self, t: float) -> FloatArray:
        """Return the torque (joints,) at a time t since the last change."""
        if self._lag == 0.0:
            return self._target[-1]
        left = math.exp(-(t - self._since[-1]) / self._lag)
        now: FloatArray = _remaining(self._target[-1], self._initial[-1], left)
        return now

    def at(self, times: FloatArray) -> FloatArray:
        """Return the applied torque (T, joints) at times (T,)."""
        since = np.asarray(self._since)
        index = np.clip(np.searchsorted(since, times * (1.0 + 1e-12), side="right") - 1, 0, None)
        target = np.asarray(self._target)[index]
        if self._lag == 0.0:
            return target
        left = np.exp(-np.maximum(times - since[index], 0.0) / self._lag)
        left = left.reshape(-1, *(1,) * self._nothing.ndim)
        return np.asarray(target + (np.asarray(self._initial)[index] - target) * left)


#: Function of the state (2, n, 1 + m), the system and the time that returns a signal's value.
Reader = Callable[[FloatArray, System, float], FloatArray]
#: Columns of the tip in the results of ``poses``.
_TIP = {"tip": slice(0, 2), "tip_angle": slice(2, 3)}
_TIP |= {"tip_velocity": slice(3, 5), "tip_angle_rate": slice(5, 6)}


class TipMotion:
    """Position x, y and angle of the tip and their rates, computed without the other channels."""

    def __init__(self, arm: Arm) -> None:
        self._kernels = KernelView(arm.assembly.constants)
        self._poses, self._tip = self._kernels.pose_arrays()

    def __call__(self, state: FloatArray) -> FloatArray:
        """Return (6,) m, rad, m/s, rad/s at a state (2, n, 1 + m); reused by the next call."""
        self._kernels.call(poses, state, self._poses, self._tip)
        return self._tip


class Sensing:
    """Sensors of a loop, each with the function that reads its signal from the rows.

    Args:
        sensors: states of instruments, or names of exact sensors, with their readers.
        constant: values that are the same at all sample times, by name.
    """

    def __init__(
        self,
        sensors: Sequence[tuple[Readings | str, Callable[..., FloatArray]]],
        constant: dict[str, FloatArray] | None = None,
    ) -> None:
        self._sensors, self._constant = sensors, constant or {}

    @property
    def readings(self) -> list[Readings]:
        """States of the instruments between sample times."""
        return [sensor for sensor, _ in self._sensors if isinstance(sensor, Readings)]

    def recalled(self, readings: Sequence[Readings]) -> Sensing:
        """Return these sensors with other states of the instruments, if there are any."""
        readers = [read for _, read in self._sensors]
        sensors = list(zip(readings, readers, strict=True)) if readings else self._sensors
        return Sensing(sensors, self._constant)

    def values(self, k: int, *rows: Any) -> dict[str, FloatArray]:
        """Return the readings at sample time k by name; ``rows``: arguments of the readers."""
        values: dict[str, FloatArray] = {}
        for sensor, read in self._sensors:
            if isinstance(sensor, str):
                values[sensor] = read(*rows)
            elif sensor.exact:
                values[sensor.labels[0]] = read(*rows)
            else:
                if sensor.wants(k):
                    sensor.take(k, read(*rows))
                sensor.write_available(k, values)
        values.update(self._constant)
        return values


def measured_names(arm: Arm, hardware: Hardware | None, contacts: int) -> tuple[str, ...]:
    """Return the names in the measurements of an arm with a number of contacts.

    Without hardware the measurements of an arm without gauges contain an empty strain, which is
    not in this list.
    """
    if hardware is not None and hardware.instruments is not None:
        return tuple(label for item in hardware.instruments for label in item.labels)
    strain, force = bool(arm.gauges), contacts > 0
    return ("joint_angle", "joint_rate", *["strain"] * strain, *["contact_force"] * force)


def sensing_of_run(run: Run, hardware: Hardware | None, tick: float) -> Sensing:
    """Create the sensors of a run whose controller has the sample time ``tick`` (s)."""
    if hardware is None or hardware.instruments is None:
        names = measured_names(run.arm, None, run.loads.placed.contacts.body.size)
        readers = [
            _contact(run, name) if name == "contact_force" else _channel(run.arm, name)
            for name in names
        ]
        none = {} if run.arm.gauges else {"strain": np.zeros(0)}
        return Sensing(list(zip(names, readers, strict=True)), none)
    children = np.random.default_rng(hardware.seed).spawn(len(hardware.instruments))
    pairs = zip(hardware.instruments, children, strict=True)
    return Sensing([(Readings(item, tick, child), _reader(run, item)) for item, child in pairs])


def _reader(run: Run, instrument: Instrument) -> Reader:
    signal = instrument.output
    if isinstance(signal, Sensor):
        return _point(run.arm, signal)
    if signal in ("contact_force", "contact_gap"):
        if not run.loads.placed.contacts.body.size:
            rule = f"measure {signal}, but there are no contacts"
            raise InputError(Problem("hardware.instruments", rule))
        return _contact(run, signal)
    if signal == "strain" and not run.arm.gauges:
        rule = "measure strain, but the arm has no gauges"
        raise InputError(Problem("hardware.instruments", rule))
    return _channel(run.arm, signal)


def _channel(arm: Arm, name: str) -> Reader:
    """Return the reader of a channel; frequent channels are computed without the others."""
    if name in ("joint_angle", "joint_rate"):
        level, joints = int(name == "joint_rate"), as_slice(arm.assembly.joint_body)
        return lambda state, system, t: state[level, joints, 0].copy()
    if name == "strain":
        return lambda state, system, t: arm.strains(state[None])[0]
    if name == "torque":
        return lambda state, system, t: _torque(arm, system, t)
    if name in _TIP:
        columns, tip = _TIP[name], TipMotion(arm)
        return lambda state, system, t: tip(state)[columns].copy()
    return lambda state, system, t: np.ravel(channels_of(arm, state[None])[name][0])


def _contact(run: Run, signal: str) -> Reader:
    """Return the reader of contact forces (contacts, 2) N, world axes, or gaps (contacts,) m."""
    arm, placed = run.arm, run.loads.placed.contacts
    kernels = KernelView(arm.assembly.constants)
    if signal == "contact_force":
        return lambda state, system, t: contact_forces(arm, placed, state[None], kernels)[0]
    return lambda state, system, t: contact_values(arm, placed, state[None], kernels)[0, :, GAP]


def _torque(arm: Arm, system: System, t: float) -> FloatArray:
    """Return the motor torque just before t."""
    torque = np.zeros(arm.assembly.bodies)
    torque_at(system, t, True, torque)
    return torque[arm.assembly.joint_body]


def _point(arm: Arm, sensor: Sensor) -> Reader:
    """Return the reader of a point's motion; accelerations use the torque just before t."""
    places = place_loads(arm, [marker(sensor.link, sensor.station)], what="Sensor")
    kernels = KernelView(arm.assembly.constants)
    stages, torque = kernels.zeros(1, 2), np.zeros(kernels.shape[0])
    motion = np.zeros((1, MOTION_COLUMNS))
    body_poses, tip = kernels.pose_arrays()
    slope, motions = Entry(slope_at), Entry(point_motions)

    def read(state: FloatArray, system: System, t: float) -> FloatArray:
        slope(system, t, True, state, torque, stages, 0, True)
        now = system.sizes, system.constants, state, stages[0, 1], system.drive.loads
        motions(*now, places, system.work, body_poses, tip, motion)
        return motion[0, sensor.columns].copy()

    return read
