"""Sensors of the sampled loop: exact values of the state, and the readings of instruments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.actions import marker, place_loads
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import KernelView, as_slice
from flexarm.arm.observe import channels_of, contact_forces, contact_values
from flexarm.base.errors import InputError, Problem
from flexarm.control.hardware.instruments import Readings
from flexarm.integrate.base import FloatArray, System
from flexarm.integrate.torque import slope_at, torque_at
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.forces.contact import GAP
from flexarm.kernels.observation.observables import poses
from flexarm.kernels.observation.point_motion import MOTION_COLUMNS, point_motions
from flexarm.model import Hardware, Instrument, Sensor

if TYPE_CHECKING:
    from flexarm.simulation.run.stepping import Run

#: Function of the state (2, n, 1 + m), the system and the time that returns a signal's value.
Reader = Callable[[FloatArray, System, float], FloatArray]
#: Columns of the tip in the results of ``poses``.
_TIP = {
    "tip": slice(0, 2),
    "tip_angle": slice(2, 3),
    "tip_velocity": slice(3, 5),
    "tip_angle_rate": slice(5, 6),
}


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
    """Create the sensors of a run whose controller has the sample time ``tick`` (s).

    Raises:
        InputError: if an instrument does not fit the arm or the contacts, or its sample
            time is not a multiple of ``tick``.
    """
    if hardware is None or hardware.instruments is None:
        names = measured_names(run.arm, None, run.loads.placed.contacts.body.size)
        readers = [
            _contact_force(run) if name == "contact_force" else _channel(run.arm, name)
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
        return _contact_force(run) if signal == "contact_force" else _contact_gap(run)
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


def _contact_force(run: Run) -> Reader:
    """Return the reader of the contact forces (contacts, 2) on the arm, N, world axes."""
    arm, placed = run.arm, run.loads.placed.contacts
    kernels = KernelView(arm.assembly.constants)
    return lambda state, system, t: contact_forces(arm, placed, state[None], kernels)[0]


def _contact_gap(run: Run) -> Reader:
    """Return the reader of the contact gaps (contacts,), m; negative in contact."""
    arm, placed = run.arm, run.loads.placed.contacts
    kernels = KernelView(arm.assembly.constants)
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
        motions(
            system.sizes,
            system.constants,
            state,
            stages[0, 1],
            system.drive.loads,
            places,
            system.work,
            body_poses,
            tip,
            motion,
        )
        return motion[0, sensor.columns].copy()

    return read
