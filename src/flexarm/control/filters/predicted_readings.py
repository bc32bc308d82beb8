"""Predicted samples and readings of an arm and their derivatives, for filters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flexarm.arm.actions import marker, place_loads
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import IntArray
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.base.arguments import check_numbers
from flexarm.base.errors import InputError, Problem, few, one_of, raise_any, shown
from flexarm.control.filters.estimates import Layout
from flexarm.control.hardware.measurement import FloatArray, Measurement
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.derivatives.point_sensitivity import point_jacobian
from flexarm.kernels.layout import ArmConstants
from flexarm.kernels.observation.point_motion import MOTION_COLUMNS
from flexarm.linear.step_derivatives.sampled_step import SampledStep, state_places
from flexarm.model import Instrument, Sensor

#: Largest accepted reading in its standard deviations: rounding of larger ones becomes noise.
_LARGEST = 1e13
#: Signals that are linear in the state.
LINEAR_SIGNALS = ("joint_angle", "joint_rate", "strain")
#: Constants of an arm, and those with the imaginary step of each parameter.
Constants = tuple[ArmConstants, tuple[ArmConstants, ...]]


class Predicted(NamedTuple):
    """Predicted readings of a state, and their derivatives."""

    values: FloatArray  # (size,)
    state: FloatArray  # (size, 2 dof), derivative by [q, qd]
    parameters: FloatArray  # (size, p), derivative by the parameters of ``SampledStep``
    torque: FloatArray  # (size, joints), derivative by the acting torque


class PredictedReadings:
    """Readings of instruments as a function of the state, stacked in one column.

    Attributes:
        arm, instruments: as given. size: number of readings. counts: of each instrument.
        biased: names of instruments with biases and numbers of their readings.
        bias: (size, biases), derivative of the readings by the biases.
        variance: (size,), of their errors, rounding included.
        linear: whether all readings are linear in the state.
        linear_rows: (size, 2 dof), derivative of the linear readings by the state.
        sensors: the `Sensor` objects. places: (k, 2) of their readings. stations: on the arm.
    """

    def __init__(
        self, arm: Arm, instruments: Sequence[Instrument], biased: Sequence[tuple[str, int]] = ()
    ) -> None:
        self.arm, self.instruments, self.biased = arm, tuple(instruments), biased
        self._labels = [item.label for item in instruments]
        self.sensors = [i.output for i in instruments if isinstance(i.output, Sensor)]
        self.linear = not self.sensors
        rows = [reading_rows(arm, item) for item in instruments]
        self.size = sum(len(row) for row in rows)
        self.linear_rows = np.concatenate(rows)
        pairs = zip(rows, instruments, strict=True)
        variances = [np.full(len(row), i.noise**2 + i.resolution**2 / 12.0) for row, i in pairs]
        self.variance = np.concatenate(variances)
        self.counts = [len(row) for row in rows]
        blocks = [
            [np.eye(count, columns) * (label == name) for name, columns in self.biased]
            for label, count in zip(self._labels, self.counts, strict=True)
        ]
        self.bias = np.block(blocks) if self.biased else np.zeros((self.size, 0))
        starts = np.cumsum([0, *self.counts])
        places = [starts[k] for k, i in enumerate(instruments) if isinstance(i.output, Sensor)]
        self.places = np.array(places, dtype=int)[:, None] + np.arange(2)
        columns = [np.arange(MOTION_COLUMNS)[sensor.columns] for sensor in self.sensors]
        self._columns = np.arange(len(columns))[:, None], np.array(columns, int).reshape(-1, 2)
        points = [marker(sensor.link, sensor.station) for sensor in self.sensors]
        self.stations = place_loads(arm, points, what="Sensor")
        self._kernels = kernels = KernelView(arm.assembly.constants, complex)
        self._point_jacobian = Entry(point_jacobian)
        self._acceleration = kernels.zeros()
        self._poses, self._tip = kernels.pose_arrays()
        shape = (len(self.sensors), MOTION_COLUMNS)
        self._motions = np.zeros(shape, dtype=complex)
        self._state_places = state_places(arm)
        self._found = np.zeros((len(self._state_places) + 2, *shape))
        self._pushed = np.zeros((2, *shape))

    def stacked(self, measurement: Measurement) -> FloatArray:
        """Return the readings (size,) of a measurement."""
        given = [measurement.get(name) for name in self._labels]
        missing = [name for name, one in zip(self._labels, given, strict=True) if one is None]
        if missing:
            hint = (
                f"Add an instrument of {missing[0]} to the hardware of the arm, as in the filter."
            )
            raise InputError(Problem("measurement", f"has no {missing[0]!r}", hint=hint))
        pairs = zip(self._labels, given, strict=True)
        readings = np.concatenate([check_numbers(*pair).ravel() for pair in pairs])
        if readings.size != self.size:
            rule = f"have {self.size} readings of {', '.join(self._labels)}"
            raise InputError(Problem("measurement", rule, str(readings.size)))
        if not np.all(np.abs(readings) < _LARGEST * np.sqrt(self.variance)):
            rule = f"be finite readings below {_LARGEST:g} standard deviations"
            raise InputError(Problem("measurement", rule, few(readings)))
        return readings

    def predict(self, x: FloatArray, torque: FloatArray, constants: Constants) -> Predicted:
        """Return the readings of a state x = [q, qd] (2 dof,) and their derivatives."""
        slopes, joints = self.linear_rows.copy(), self.arm.n_joints
        plain, moved = constants
        by_parameters = np.zeros((self.size, len(moved)))
        found = Predicted(slopes @ x, slopes, by_parameters, np.zeros((self.size, joints)))
        if not self.sensors:
            return found
        self._points(x, torque, (plain, moved[0]), self._state_places, self._found)
        places, columns = self.places, (slice(None), *self._columns)
        by = self._found[columns]
        found.state[places], found.parameters[places, 0] = np.moveaxis(by[:-2], 0, -1), by[-2]
        found.values[places] = by[-1]
        none = self._state_places[:0]
        for column, one in enumerate(moved[1:], 1):
            self._points(x, torque, (plain, one), none, self._pushed)
            found.parameters[places, column] = self._pushed[columns][-2]
        # Accelerations are linear in the torque, so the difference is exact except for rounding.
        step = float(np.abs(torque).max()) or 1.0
        for joint in range(joints):
            more = torque.copy()
            more[joint] += step
            self._points(x, more, (plain, plain), none, self._pushed)
            found.torque[places, joint] = (self._pushed[columns][-1] - by[-1]) / step
        return found

    def values(self, x: FloatArray, torque: FloatArray, constants: Constants) -> FloatArray:
        """Return the readings (size,) of ``predict`` alone."""
        found: FloatArray = self.linear_rows @ x
        if self.sensors:
            plain = constants[0]
            self._points(x, torque, (plain, plain), self._state_places[:0], self._pushed)
            found[self.places] = self._pushed[-1, *self._columns]
        return found

    def _points(
        self,
        x: FloatArray,
        torque: FloatArray,
        constants: tuple[ArmConstants, ArmConstants],
        places: IntArray,
        found: FloatArray,
    ) -> None:
        arm, kernels = self.arm, self._kernels
        state, tau = arm.padded(x.reshape(2, -1)), arm.padded_torque(torque)
        point = state.astype(complex), tau.astype(complex), kernels.loads, self.stations
        buffers = kernels.work, self._acceleration, self._poses, self._tip, self._motions
        self._point_jacobian(kernels.sizes, *constants, places, *point, *buffers, found)


class Link(NamedTuple):
    """The next sample, and its derivatives."""

    after: FloatArray  # (s,)
    F: FloatArray  # (s, s)
    G: FloatArray  # (s, joints)


class Readings(NamedTuple):
    """Predicted readings, and their derivatives."""

    values: FloatArray  # (size,)
    H: FloatArray  # (size, s)
    D: FloatArray  # (size, joints)


def _last(x: FloatArray) -> tuple[float, float]:
    return float(x[-1]), 1.0


@dataclass(frozen=True, eq=False)
class ArmModel:
    """Next samples and readings of an arm as functions of the estimated numbers x of `Layout`."""

    step: SampledStep
    layout: Layout
    noise: FloatArray  # (joints,) deviation of the torque, N m
    walk: FloatArray  # (s,) variances of the random walks over a sample
    #: Function of x that returns the payload mass, kg, and its derivative by the last number of x.
    mass: Callable[[FloatArray], tuple[float, float]] = _last

    def carry(self, x: FloatArray, torque: FloatArray, error: FloatArray) -> Link:
        """Return x at the next sample under a torque with an error w."""
        layout = self.layout
        acting = layout.acting(x, torque + self.noise * error)
        step = self.step.take(x[layout.states], acting, self.changes(x))
        after, F = x.copy(), np.eye(layout.size)
        after[layout.states] = step.after
        slopes = step.state, step.parameters, step.torque
        F[layout.states] = layout.derivative(slopes, self.mass(x)[1])
        G = np.zeros((layout.size, self.noise.size))
        G[layout.states] = step.torque * self.noise
        return Link(after, F, G)

    def observe(
        self, seen: PredictedReadings, x: FloatArray, torque: FloatArray, error: FloatArray
    ) -> Readings:
        """Return the readings at a sample to which a torque with an error w has led."""
        layout = self.layout
        constants = self.step.free.at(self.changes(x))
        acting = layout.acting(x, torque + self.noise * error)
        observed = seen.predict(x[layout.states], acting, constants)
        slopes = observed.state, observed.parameters, observed.torque
        H = layout.derivative(slopes, self.mass(x)[1], seen.bias)
        values = observed.values + seen.bias @ x[layout.biases]
        return Readings(values, H, observed.torque * self.noise)

    def changes(self, x: FloatArray) -> FloatArray:
        """Return the changes (1 + p,) of payload mass and parameters from their nominals."""
        numbers = np.append(self.mass(x)[0], x[self.layout.parameters])
        return np.asarray(numbers - self.step.free.values)


def check_instruments(arm: Arm, instruments: Sequence[Instrument]) -> None:
    """Raise if a filter cannot use instruments on an arm."""
    problems = []
    for item in instruments:
        if not (isinstance(item.output, Sensor) or item.signal in LINEAR_SIGNALS):
            rule, hint = one_of(item.signal, LINEAR_SIGNALS, "a Sensor or ")
            problems.append(Problem("instruments", rule, shown(item.signal), hint))
        elif item.signal == "strain" and not arm.gauges:
            problems.append(Problem("instruments", "contain strain, but the arm has no gauges"))
        if not (item.noise or item.resolution):
            rule = f"{item.label!r} has no noise and no resolution"
            problems.append(Problem("instrument", rule, hint="They define its variance."))
    if "joint_angle" not in [item.signal for item in instruments]:
        rule = "do not measure 'joint_angle', from which the estimate starts"
        problems.append(Problem("instruments", rule))
    raise_any(problems)


def reading_rows(arm: Arm, item: Instrument) -> FloatArray:
    """Return the derivative (readings, 2 dof) of a linear reading; zeros for a `Sensor`."""
    count = arm.dof
    if isinstance(item.output, Sensor):
        return np.zeros((2, 2 * count))
    if item.signal == "strain":
        states = arm.padded(np.stack([np.eye(count), np.zeros((count, count))], axis=1))
        return np.hstack([arm.strains(states).T, np.zeros((len(arm.gauges), count))])
    row = np.zeros((arm.n_joints, 2 * count))
    row[np.arange(arm.n_joints), arm.joint_index + count * (item.signal == "joint_rate")] = 1.0
    return row
