"""What instruments should say of a state, and how that changes with it: for filters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexarm.arguments import check_numbers
from flexarm.arm import Arm
from flexarm.assemble import IntArray
from flexarm.errors import InputError, Problem, few, shown
from flexarm.hardware.instruments import Instrument
from flexarm.hardware.measurement import FloatArray, Measurement
from flexarm.kernels.cache import Entry
from flexarm.kernels.layout import ArmConstants, new_workspace, no_loads, run_time_sizes
from flexarm.kernels.observables import POSE_COLUMNS
from flexarm.kernels.point_sensitivity import point_jacobian
from flexarm.linear.sampled_step import state_places
from flexarm.linear.signals import Sensor
from flexarm.loads import Load, place_loads

#: Readings, masses and covariances above this, in SI units, are mistakes.
LARGEST = 1e9
_SIGNALS = ("joint_angle", "joint_rate", "strain")


class Predicted(NamedTuple):
    """Readings that a state should give, and their slopes."""

    values: FloatArray  # (size,)
    state: FloatArray  # (size, 2 dof) by [q, qd]
    parameter: FloatArray  # (size,) by the parameter of ``SampledStep``
    torque: FloatArray  # (size, joints) by the torque that acts


class PredictedReadings:
    """Readings of instruments as a function of the state, stacked in one column.

    Attributes:
        size: readings in all. variance: (size,) of their errors, rounding included.
        linear: whether all are linear in the state.

    Raises:
        InputError: an instrument that a filter cannot use on this arm.
    """

    def __init__(self, where: str, arm: Arm, instruments: Sequence[Instrument]) -> None:
        self._arm, self._labels = arm, [item.label for item in instruments]
        self._check(where, instruments)
        self._sensors = [i.signal for i in instruments if isinstance(i.signal, Sensor)]
        self.linear = not self._sensors
        rows = [_linear(arm, item) for item in instruments]
        self.size = sum(len(row) for row in rows)
        self._linear = np.concatenate(rows)
        variances = [
            np.full(len(row), item.noise**2 + item.resolution**2 / 12.0)
            for row, item in zip(rows, instruments, strict=True)
        ]
        self.variance = np.concatenate(variances)
        starts = np.cumsum([0] + [len(row) for row in rows])
        self._places = [
            slice(starts[k], starts[k + 1])
            for k, item in enumerate(instruments)
            if isinstance(item.signal, Sensor)
        ]
        constants = arm.assembly.constants
        n, m = constants.S.shape
        self._stations = place_loads(
            arm, where, [Load(s.link, station=s.station) for s in self._sensors], what="Sensor"
        )
        self._sizes, self._loads = run_time_sizes(constants), no_loads(constants)
        self._work = new_workspace(constants, complex)
        self._point_jacobian = Entry(point_jacobian)
        self._acceleration = np.zeros((n, 1 + m), dtype=complex)
        self._poses = np.zeros((n, POSE_COLUMNS), dtype=complex)
        self._tip = np.zeros(6, dtype=complex)
        self._motions = np.zeros((len(self._sensors), 8), dtype=complex)
        self._state_places = state_places(arm)
        self._found = np.zeros((len(self._state_places) + 2, len(self._sensors), 8))
        self._pushed = np.zeros((2, len(self._sensors), 8))

    def _check(self, where: str, instruments: Sequence[Instrument]) -> None:
        problems = []
        for item in instruments:
            if not (isinstance(item.signal, Sensor) or item.signal in _SIGNALS):
                rule = "read a Sensor or one of " + ", ".join(map(repr, _SIGNALS))
                problems.append(Problem(where, "instruments", rule, shown(item.signal)))
            elif item.signal == "strain" and not self._arm.gauges:
                rule = "leave out the strain of an arm without gauges"
                problems.append(Problem(where, "instruments", rule, "'strain'"))
            if item.delay or item.sample_time is not None:
                rule = "be without delay and sample_time of their own"
                problems.append(Problem(where, "instruments", rule, shown(item.label)))
            if not (item.noise or item.resolution):
                rule = "have noise or resolution, by which they are weighted"
                problems.append(Problem(where, "instruments", rule, shown(item.label)))
        if "joint_angle" not in [item.signal for item in instruments]:
            rule = "hold one that reads 'joint_angle', where estimates begin"
            problems.append(Problem(where, "instruments", rule, ", ".join(self._labels)))
        if problems:
            raise InputError(*problems)

    def stacked(self, where: str, measurement: Measurement) -> FloatArray:
        """Return the readings (size,) of a measurement.

        Raises:
            InputError: if one is missing, of another length, not finite or too large.
        """
        given = [measurement.get(name) for name in self._labels]
        missing = [name for name, one in zip(self._labels, given, strict=True) if one is None]
        if missing:
            raise InputError(Problem(where, "measurement", f"have {missing[0]!r}", "without it"))
        pairs = zip(self._labels, given, strict=True)
        readings = np.concatenate([check_numbers(where, *pair).ravel() for pair in pairs])
        if readings.size != self.size:
            rule = f"have {self.size} readings of {', '.join(self._labels)}"
            raise InputError(Problem(where, "measurement", rule, f"of {readings.size}"))
        if not np.all(np.abs(readings) < LARGEST):
            rule = f"hold finite readings below {LARGEST:g}"
            raise InputError(Problem(where, "measurement", rule, few(readings)))
        return readings

    def predict(
        self,
        x: FloatArray,
        torque: FloatArray,
        constants: tuple[ArmConstants, ArmConstants],
    ) -> Predicted:
        """Return the readings of [q, qd] (2 dof,) and their slopes.

        ``torque`` (joints,) acts at that moment; ``constants`` as of ``SampledStep``.
        """
        slopes, joints = self._linear.copy(), self._arm.joints
        found = Predicted(slopes @ x, slopes, np.zeros(self.size), np.zeros((self.size, joints)))
        if not self._sensors:
            return found
        self._points(x, torque, constants, self._state_places, self._found)
        for k, (place, sensor) in enumerate(zip(self._places, self._sensors, strict=True)):
            by = self._found[:, k, sensor.columns]
            found.state[place], found.parameter[place] = by[:-2].T, by[-2]
            found.values[place] = by[-1]
        none = self._state_places[:0]
        for joint in range(joints):
            # Accelerations are linear in the torque: one newton metre more is the slope.
            more = torque.copy()
            more[joint] += 1.0
            self._points(x, more, constants, none, self._pushed)
            for k, (place, sensor) in enumerate(zip(self._places, self._sensors, strict=True)):
                change = self._pushed[-1, k, sensor.columns] - found.values[place]
                found.torque[place, joint] = change
        return found

    def _points(
        self,
        x: FloatArray,
        torque: FloatArray,
        constants: tuple[ArmConstants, ArmConstants],
        places: IntArray,
        found: FloatArray,
    ) -> None:
        arm = self._arm
        self._point_jacobian(
            self._sizes,
            *constants,
            places,
            arm.padded(x.reshape(2, -1)).astype(complex),
            arm.padded_torque(torque).astype(complex),
            self._loads,
            self._stations,
            self._work,
            self._acceleration,
            self._poses,
            self._tip,
            self._motions,
            found,
        )


def _linear(arm: Arm, item: Instrument) -> FloatArray:
    """Slope (readings, 2 dof) of what is linear in the state; zeros for the others."""
    count = arm.dof
    if isinstance(item.signal, Sensor):
        return np.zeros((2, 2 * count))
    if item.signal == "strain":
        states = arm.padded(np.stack([np.eye(count), np.zeros((count, count))], axis=1))
        return np.hstack([arm.strains(states).T, np.zeros((len(arm.gauges), count))])
    row = np.zeros((arm.joints, 2 * count))
    row[np.arange(arm.joints), arm.joint_index + count * (item.signal == "joint_rate")] = 1.0
    return row
