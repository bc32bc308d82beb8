"""Trials of a motion that is learned, by simulation or on a bench, and their lifted model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_positive
from flexarm.base.errors import FlexarmError, InputError, Problem, check_array, shown
from flexarm.base.late import xr
from flexarm.control.analysis.linear_controller import linear_controller
from flexarm.control.contract.base import (
    JOINTS,
    Around,
    Arrays,
    Controller,
    ControllerRequirements,
    Measurement,
    Reference,
    has_poles,
    requirements_of,
)
from flexarm.control.filters.predicted_readings import LINEAR_SIGNALS, reading_rows
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear.small_deviations.along import run_step_maps
from flexarm.model import Hardware, Instrument
from flexarm.motion.dynamics.dynamics_along import dynamics_along
from flexarm.motion.geometry.inverse_kinematics import rigid_chain, tip_jacobian
from flexarm.simulation.calls.metrics import tip_reference
from flexarm.simulation.calls.run import simulate

#: Intervals by default, and largest number of learned torques: the model is a dense matrix, and its
#: eigenvalues take the third power of that number, a minute for the largest.
_INTERVALS, _MOST = 400, 4000
#: Difference from a whole number that is rounding.
_ROUNDING = 1e-6


@dataclass(eq=False)
class Bench:
    """Trials of a motion, by simulation or on a bench, and the linear model of a trial."""

    arm: Arm
    reference: Reference
    window: Window
    output: str
    _plant: Arm | None
    _hardware: Hardware | None
    _trial: Callable[[Controller], ArrayLike] | None
    _options: dict[str, Any]

    def __post_init__(self) -> None:
        self._count, ends = 0, self.window.ends
        if self.output == "tip":
            self._wanted = tip_reference(self.arm, self.reference, ends)
        else:
            self._wanted = np.array([self.reference.joint_angle(float(t)) for t in ends])
        self.result: xr.Dataset | None = None

    def model(self, controller: AddedTorque) -> FloatArray:
        """Return the lifted model (N p, N joints) of the chosen output."""
        # Loads and changes are not part of the model.
        start: dict[str, Any] = {}
        plant = self._plant
        for name in ("initial", "initial_rate"):
            value = self._options.get(name)
            if value is not None and plant is not None and plant.dof != self.arm.dof:
                # Coordinates of the bending differ, so the links of the model start straight.
                coordinates = check_array(name, value, (plant.dof,))
                value = self.arm.rest(coordinates[plant.joint_index])
            start[name] = value
        result = self._simulate(controller, None, None, start)
        tip, angle = _lifted_model(self.arm, controller, self.reference, result, self.window)
        chosen = tip if self.output == "tip" else angle
        size = self.window.intervals
        return chosen.reshape(size * chosen.shape[1], size * self.arm.n_joints)

    def errors(self, controller: AddedTorque) -> FloatArray:
        """Return the errors (N, p) of the next trial."""
        if self._trial is not None:
            try:
                given = self._trial(controller)
            except FlexarmError:
                raise
            except Exception as error:
                words = " ".join(str(error).split())
                failure = Problem("trial", f"failed with {type(error).__name__}: {words}")
                raise InputError(failure) from error
            return self._wanted - check_array("trial", given, self._wanted.shape)
        hardware = self._hardware
        if hardware is not None:
            hardware = hardware.replace(seed=hardware.seed + self._count)
        self._count += 1
        self.result = result = self._simulate(controller, self._plant, hardware, self._options)
        reading = f"measured_{self.output}"
        values = result[reading if reading in result else self.output].values
        ends = self.window.stride * np.arange(1, self.window.intervals + 1)
        return np.asarray(self._wanted - values[ends, : self._wanted.shape[1]])

    def _simulate(
        self,
        controller: AddedTorque,
        plant: Arm | None,
        hardware: Hardware | None,
        options: dict[str, Any],
    ) -> xr.Dataset:
        # One sample more than the trial, because the readings of its end are taken there.
        sample_time = self.window.sample_time
        return simulate(
            self.arm,
            (self.window.intervals * self.window.stride + 1) * sample_time,
            controller=controller,
            reference=self.reference,
            plant=plant,
            hardware=hardware,
            rate=1.0 / sample_time,
            **{"progress": False, **options},
        )


def window_of(
    arm: Arm,
    reference: Reference,
    controller: Controller,
    duration: float | None,
    interval: float | None,
) -> Window:
    """Divide a trial into intervals."""
    sample_time = check_positive("controller.sample_time", controller.sample_time)
    end = getattr(reference, "end_time", None)
    until = end if duration is None else duration
    if until is None:
        raise InputError(Problem("duration", "is required, because the reference has no end_time"))
    samples = check_positive("duration", until) / sample_time
    if end is not None and until < end * (1.0 - _ROUNDING):
        rule = f"be at least the end of the reference, {end:.6g} s"
        raise InputError(Problem("duration", rule, shown(duration)))
    if interval is None:
        stride = max(1, math.ceil(samples / _INTERVALS * (1.0 - _ROUNDING)))
    else:
        given = check_positive("interval", interval) / sample_time
        stride = round(given)
        if stride < 1 or abs(given - stride) > _ROUNDING * stride:
            rule = f"be a multiple of the controller's sample time of {sample_time:.6g} s"
            raise InputError(Problem("interval", rule, shown(interval)))
    count = math.floor(samples / stride * (1.0 + _ROUNDING))
    if count < 2 or count * arm.n_joints > _MOST:
        rule = f"be divided into 2 to {_MOST // arm.n_joints} intervals"
        raise InputError(Problem("duration", rule, str(count), "Choose another interval."))
    return Window(sample_time, stride, count)


def joint_errors(arm: Arm, reference: Reference, window: Window, output: str) -> FloatArray:
    """Return the joint errors per error of the output, (N, joints, p)."""
    if output == "joint_angle":
        return np.broadcast_to(np.eye(arm.n_joints), (window.intervals, arm.n_joints, arm.n_joints))
    chain = rigid_chain(arm)
    angles = np.array([reference.joint_angle(float(t)) for t in window.ends])
    return np.asarray(np.linalg.pinv(tip_jacobian(chain.lengths, angles + chain.offset)))


class AddedTorque(Around):
    """Controller that adds torques (N, joints) N m, constant in intervals (s), to an inner one."""

    def __init__(self, inner: Controller, torque: FloatArray, interval: float) -> None:
        self.inner, self.torque, self.interval = inner, torque, interval

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        inner = requirements_of(self.inner, arm, reference)
        joints = self.torque.shape[1]
        return inner._replace(joints=joints if joints != arm.n_joints else inner.joints)

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the inputs of the inner controller, and the torque of the interval."""
        # The sample times are multiples of the interval except for rounding.
        k = min(int(t / self.interval + 1e-6), len(self.torque) - 1)
        return {**super().planned(t, reference), "added_torque": self.torque[k]}

    def step(
        self, memory: Arrays, readings: Measurement, inputs: Arrays
    ) -> tuple[Arrays, FloatArray]:
        inside, torque = self._inner_step(memory, readings, inputs)
        return inside, torque + inputs["added_torque"]


#: Number of instants along the trial at which a controller is linearised. Most controllers are
#: linear, and the gains of the others change as slowly as the posture.
_INSTANTS = 21


class Window(NamedTuple):
    """Division of a trial into N ``intervals`` of constant added torque, of ``stride`` samples."""

    sample_time: float
    stride: int
    intervals: int

    @property
    def interval(self) -> float:
        """Length of an interval, s."""
        return self.stride * self.sample_time

    @property
    def duration(self) -> float:
        """Length of the trial, s."""
        return self.intervals * self.interval

    @property
    def ends(self) -> FloatArray:
        """Ends of the intervals (N,), s, at which the outputs are measured."""
        return np.asarray(self.interval * np.arange(1.0, self.intervals + 1.0))


def check_linear(controller: Controller, arm: Arm, reference: Reference) -> tuple[str, ...]:
    """Return the readings of a controller that can be linearised along a trial."""
    if not has_poles(controller):
        hint = "It is needed to predict the next trial; see flexarm.Controller."
        raise InputError(Problem("controller", "have a step", shown(controller), hint))
    names = requirements_of(controller, arm, reference).measured or JOINTS
    if others := [name for name in names if name not in LINEAR_SIGNALS]:
        rule = "require no readings except " + ", ".join(LINEAR_SIGNALS)
        raise InputError(Problem("controller", rule, ", ".join(others)))
    return tuple(names)


def _lifted_model(
    arm: Arm, controller: Controller, reference: Reference, trial: xr.Dataset, window: Window
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of tip and joint angles at the ends of intervals; (C.100), (C.101).

    The closed loop is linearised along ``trial``, a result at the sample times of the controller.
    The derivatives of the tip (N, 2, N, joints) m and of the angles (N, joints, N, joints) rad are
    by the torque added in each interval, N m.
    """
    names = check_linear(controller, arm, reference)
    count, steps = window.intervals, window.intervals * window.stride
    q, qd = trial["q"].values[: steps + 1], trial["qd"].values[: steps + 1]
    read = np.concatenate([reading_rows(arm, Instrument(signal=name)) for name in names])
    laws = _laws(controller, reference, trial, names, window.sample_time, steps)
    ends = slice(window.stride, None, window.stride)
    tip_rows = dynamics_along(arm, q[ends], qd[ends], np.zeros_like(q[ends])).tip_by[:, :2, 0]
    n, m = 2 * arm.dof, arm.n_joints
    X = np.zeros((n + laws[0].shape[1], count * m))
    tip, angle = np.zeros((count, 2, count * m)), np.zeros((count, m, count * m))
    for k, by_state, by_stages in run_step_maps(arm, window.sample_time, q, qd):
        i = k // window.stride
        known = X[:, : (i + 1) * m]
        Ac, Bc, Cc, Dc = (law[k] for law in laws)
        torque = Dc @ read @ known[:n] + Cc @ known[n:]
        torque[:, i * m :] += np.eye(m)
        known[n:] = Bc @ read @ known[:n] + Ac @ known[n:]
        known[:n] = by_state @ known[:n] + by_stages.sum(axis=1) @ torque
        if (k + 1) % window.stride == 0:
            tip[i] = tip_rows[i] @ X[: arm.dof]
            angle[i] = X[arm.joint_index]
    return tip.reshape(count, 2, count, m), angle.reshape(count, m, count, m)


def _laws(
    controller: Controller,
    reference: Reference,
    trial: xr.Dataset,
    names: tuple[str, ...],
    sample_time: float,
    steps: int,
) -> list[FloatArray]:
    """Return the matrices of the linearised controller at each sample, (steps, ...) each."""
    at = np.unique(np.linspace(0, steps - 1, _INSTANTS).round().astype(int))
    found = []
    for k in at.tolist():
        measured = {name: trial[name].values[k] for name in names}
        found.append(linear_controller(controller, measured, reference, k * sample_time))
    samples = np.arange(steps)
    left = np.clip(np.searchsorted(at, samples, side="right") - 1, 0, max(at.size - 2, 0))
    right = np.minimum(left + 1, at.size - 1)
    weight = (samples - at[left]) / np.maximum(at[right] - at[left], 1)
    laws = []
    for part in zip(*found, strict=True):
        matrices = np.array(part)
        w = weight[:, None, None]
        laws.append((1.0 - w) * matrices[left] + w * matrices[right])
    return laws
