"""Sliding-mode and adaptive control: controllers with a sliding variable of joint errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_each
from flexarm.base.errors import InputError, Problem, raise_any, shown
from flexarm.control.contract.base import (
    JOINTS,
    Arrays,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    Step,
    applied,
)
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.design.arm_scales import (
    check_sample_time,
    default_cutoff,
    joint_sizes,
    slow_rate,
    typical_torque,
)
from flexarm.control.design.rigid_model import RigidParameters, parameter_names
from flexarm.kernels.controller_terms.adaptation import network_torque
from flexarm.model.drives.controllers import (
    AdaptiveParameters,
    RBFAdaptiveParameters,
    SlidingModeParameters,
)
from flexarm.model.wording import nearest

#: Smoothing rate of adapted friction, relative to the bandwidth and to `joint_sizes`.
_SMOOTHED = 0.001
#: Cutoff of the low-pass filter of the curvature, which limits noise in its rate, relative to the
#: sampling frequency.
_NOISE_CUTOFF = 0.1


class Sliding(NamedTuple):
    """Sliding variable of a sample and the motion that it belongs to, (joints,) each."""

    angle: FloatArray
    rate: FloatArray
    reference_rate: FloatArray
    reference_acceleration: FloatArray
    s: FloatArray


class SlidingController(OfArm, Controller):
    """Base of controllers with reference rates and a sliding variable s = qd - qd_r.

    The reference rate is the rate of the motion, plus ``bandwidth`` times the angle error, plus
    ``strain_gain`` times the high-pass filtered curvature at the root of the joint's link; theory
    page "control under uncertainty", (C.40).
    """

    def __post_init__(self) -> None:
        arm, own = self.arm, cast("Any", self)  # every law has the parameters in its own order
        check_sample_time(arm, self.sample_time, own.bandwidth)
        if own.washout is None:
            own.washout = default_cutoff(arm, self.sample_time)
        self._bandwidth, self._washout, strain_gain = own.bandwidth, own.washout, own.strain_gain
        self._smoothing_rate = _SMOOTHED * self._bandwidth * joint_sizes(arm)
        self._gauge = np.zeros(arm.n_joints, dtype=np.intp)
        self._per_strain = np.zeros(arm.n_joints)
        self._fed = bool(np.any(strain_gain > 0.0))
        for joint in np.flatnonzero(strain_gain > 0.0).tolist():  # the gauge nearest the root
            link = arm.joint_numbers[joint] - 1
            gauges = [
                (station, k) for k, (i, station, d) in enumerate(arm.gauges) if i == link and d
            ]
            if not gauges:
                rule = f"be 0 at joint {link + 1} (its link has no gauge off the neutral axis)"
                value = shown(float(strain_gain[joint]))
                raise InputError(Problem("strain_gain", rule, value))
            self._gauge[joint] = min(gauges)[1]
            self._per_strain[joint] = -strain_gain[joint] / arm.gauges[min(gauges)[1]][2]
        self._rise_fast = 1.0 - math.exp(-2.0 * math.pi * _NOISE_CUTOFF)
        self.reset()

    def reset(self) -> None:
        super().reset()
        self._forget_slow = 1.0 - math.exp(-2.0 * math.pi * self._washout * self.sample_time)

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        if self._fed:
            gauges = len(self.arm.gauges)
            return ControllerRequirements(self.arm.n_joints, (*JOINTS, "strain"), gauges)
        return ControllerRequirements(self.arm.n_joints, JOINTS)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        """Return the low-pass and the high-pass filtered curvature at the first sample."""
        if not self._fed:
            return {}
        bent = self._per_strain * readings.strain[self._gauge]
        return {"slow": bent, "fast": 0.0 * bent}

    def _slid(
        self, memory: Arrays, readings: Measurement, inputs: Arrays
    ) -> tuple[Arrays, Sliding]:
        """Return the next memory, and the sliding variable of a sample."""
        angle, rate = readings.joint_angle, readings.joint_rate
        desired = inputs["reference_rate"]
        reference_rate = desired + self._bandwidth * (inputs["reference_angle"] - angle)
        change = self._bandwidth * (desired - rate)
        acceleration = inputs["reference_acceleration"] + change
        after = {}
        if self._fed:
            bent = self._per_strain * readings.strain[self._gauge]
            step = self._rise_fast * (bent - memory["slow"] - memory["fast"])
            after["slow"] = memory["slow"] + self._forget_slow * (bent - memory["slow"])
            after["fast"] = memory["fast"] + step
            reference_rate = reference_rate + after["fast"]
            acceleration = acceleration + step / self.sample_time
        return after, Sliding(angle, rate, reference_rate, acceleration, rate - reference_rate)


#: Default excess of the switching torque, relative to typical torques.
_REACHING = 0.01


class SlidingMode(SlidingModeParameters, SlidingController):
    """Torque of the rigid model plus a switching torque that exceeds its errors; (C.47), (C.48).

    Slotine and Li, Applied Nonlinear Control, 1991, chapter 7. The switching gain is computed at
    every sample from the largest errors of the parameters. Within the boundary layer the switching
    torque is linear in s.

    Raises:
        InputError: if a name is unknown, a number is negative or not finite, or ``sample_time`` is
            too long for the arm or the bandwidth.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        named = self.uncertainty or {}
        if self.reaching is None:
            rate = slow_rate(self.arm, self.sample_time)
            self.reaching = _REACHING * typical_torque(self.arm, None, rate)
        self._model = RigidParameters(self.arm, tuple(named), self._smoothing_rate)
        # Nominal value and largest error of each row of the regressor.
        known = self._model.known
        self._believed = self._model.placed(np.concatenate([np.ones(known), self._model.values]))
        errors = np.array([*named.values()])
        self._errors = self._model.placed(np.concatenate([np.zeros(known), errors]))
        self._floor = self.disturbance + self.reaching

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after, now = self._slid(memory, readings, inputs)
        rows = self._model.regressor(
            now.angle, now.rate, now.reference_rate, now.reference_acceleration, ordered=False
        )
        rows = np.swapaxes(rows, 0, 1)
        # ``minimum`` and ``maximum`` take half the time of ``clip``.
        within = np.minimum(np.maximum(now.s / self.boundary_layer, -1.0), 1.0)
        switching = within * (applied(abs(rows), self._errors) + self._floor)
        torque: FloatArray = applied(rows, self._believed) - self.damping * now.s - switching
        return after, torque


class Adaptive(AdaptiveParameters, SlidingController):
    """Computed torque of a rigid model with adapted parameters; (C.40) to (C.46).

    Slotine and Li, On the adaptive control of robot manipulators, Int. J. Robotics Research 6(3),
    1987. ``torque = Y a - damping s``, with Y the regressor of the rigid model, and
    ``a' = -adaptation Y' s - leakage (a - initial)``, clipped to the bounds.

    Raises:
        InputError: if a name is unknown, a number is negative or not finite, or a lower bound
            exceeds the upper one, or ``sample_time`` is too long.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self.parameters = _listed(self.arm, self.parameters)
        self._model = RigidParameters(self.arm, self.parameters, self._smoothing_rate)
        if not self.parameters:
            raise InputError(Problem("parameters", "name at least one", "[]"))
        bounds, initial = self.bounds or {}, self.initial or {}
        self._check_names(bounds=bounds, initial=initial)
        count = len(self.parameters)
        gains = check_each("adaptation", self.adaptation, count)
        self.adaptation = np.full(count, gains)
        own = dict(zip(self.parameters, self._model.values, strict=True))
        start = [initial.get(name, own[name]) for name in self.parameters]
        limits = np.array([bounds.get(name, (0.0, np.inf)) for name in self.parameters])
        self._lower, self._upper = limits.T.copy()
        self._start = np.clip(start, self._lower, self._upper)

    def _check_names(self, **given: Mapping[str, Any]) -> None:
        rule = f"be names from {', '.join(self.parameters)}"
        problems = [
            Problem(argument, rule, shown(name), nearest(name, self.parameters))
            for argument, named in given.items()
            for name in named
            if name not in self.parameters
        ]
        raise_any(problems)

    @property
    def estimate(self) -> dict[str, float]:
        """Current estimate of each parameter."""
        now = self.memory.get("estimate", self._start)
        return dict(zip(self.parameters, now.tolist(), strict=True))

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {"estimate": self._start, **super().initial_memory(readings, inputs)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after, now = self._slid(memory, readings, inputs)
        estimate, known = memory["estimate"], self._model.known
        reference = now.reference_rate, now.reference_acceleration
        columns = self._model.regressor(now.angle, now.rate, *reference)
        per_parameter = columns[known:]
        torque = applied(np.swapaxes(per_parameter, 0, 1), estimate) - self.damping * now.s
        for column in columns[:known]:
            torque = torque + column
        # The error is counted from the edge of the dead zone, so that adaptation starts smoothly.
        size = np.sqrt(np.add.accumulate(now.s * now.s, axis=0)[-1])
        counted = np.maximum(size - self.dead_zone, 0.0) / np.maximum(size, 1e-300)
        rate = -self.adaptation * (counted * applied(per_parameter, now.s))
        rate = rate - self.leakage * (estimate - self._start)
        moved = estimate + self.sample_time * rate
        estimate = np.minimum(np.maximum(moved, self._lower), self._upper)
        return {"estimate": estimate, **after}, torque


def _listed(arm: Arm, parameters: str | Sequence[str]) -> tuple[str, ...]:
    groups = {
        "payload": ("payload.mass",),
        "links": tuple(n for n in parameter_names(arm) if n.startswith("link_")),
        "friction": tuple(n for n in parameter_names(arm) if n.startswith("joint_")),
    }
    listed = [parameters] if isinstance(parameters, str) else parameters
    return tuple(name for item in listed for name in groups.get(item, (item,)))


#: Rate over which the sign of a rate is smoothed, relative to the bandwidth and to `joint_sizes`.
_SIGN = 0.01
#: Largest number of Gaussians; more of them take longer than a sample time.
_MOST_CENTRES = 10_000


class RBFAdaptive(RBFAdaptiveParameters, SlidingController):
    """Adaptive control with a neural network that learns the inverse dynamics; (C.49) to (C.51).

    Ge, Lee and Harris, Adaptive Neural Network Control of Robotic Manipulators, 1998; Lewis,
    Yesildirek and Liu, IEEE Trans. Neural Networks 7(2), 1996. Gaussians of the joint
    angles multiply the signals in which the dynamics are linear: accelerations, products of rates,
    a constant for gravity, rates and signs of rates.

    Raises:
        InputError: if a number is negative or not finite, ``upper`` is less than ``lower``, or
            there are too many Gaussians, or ``sample_time`` is too long.
    """

    linearizable = False
    _law = staticmethod(network_torque)

    def __post_init__(self) -> None:
        super().__post_init__()
        joints = self.arm.n_joints
        if np.any(self.upper < self.lower):
            raise InputError(Problem("upper", "be at least lower", shown(self.upper)))
        counts = self.centres.tolist()
        if math.prod(counts) > _MOST_CENTRES:
            rule = f"have a product of at most {_MOST_CENTRES}"
            raise InputError(Problem("centres", rule, shown(counts)))
        self.centres = tuple(counts)
        self._model = RigidParameters(self.arm) if self.prior else None
        self._sign_rate = _SIGN * self.bandwidth * joint_sizes(self.arm)
        self._centres, self._sharpness = _grid(self.lower, self.upper, self.centres)
        self._pairs = np.triu_indices(joints)
        self._start = np.zeros((joints, len(self._centres), 1 + 3 * joints + len(self._pairs[0])))

    @property
    def weights(self) -> FloatArray:
        """Current weights (joints, Gaussians, signals)."""
        return np.array(self.memory.get("weights", self._start))

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {"weights": self._start, **super().initial_memory(readings, inputs)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after, now = self._slid(memory, readings, inputs)
        weights, torque = memory["weights"].copy(), np.zeros_like(now.s)
        first, second = self._pairs
        signs = np.tanh(now.reference_rate / self._sign_rate)
        requested = now.reference_acceleration, now.reference_rate, signs
        products = now.rate[first] * now.reference_rate[second]
        signals = np.concatenate([np.ones(1), *requested, products])
        gains = self.damping, self.adaptation, self.leakage, self.e_modification, self.sample_time
        centres, sharpness = self._centres, self._sharpness
        self._law(now.angle, signals, now.s, centres, sharpness, *gains, weights, torque)
        after = {"weights": weights, **after}
        if self._model is None:
            return after, torque
        rows = self._model.regressor(
            now.angle, now.rate, now.reference_rate, now.reference_acceleration
        )
        return after, torque + rows[0] + rows[1]


def _grid(
    lower: FloatArray, upper: FloatArray, counts: tuple[int, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return centres (c, joints) on a grid, and the inverse widths of the Gaussians (joints,)."""
    axes = [
        np.linspace(a, b, k) if k > 1 else np.array([0.5 * (a + b)])
        for a, b, k in zip(lower, upper, counts, strict=True)
    ]
    many = np.array(counts) > 1
    spacing = np.where(many, (upper - lower) / np.maximum(np.array(counts) - 1, 1), 1.0)
    # Angles (rad) have no scale; spacings below 1e-9 are rounding.
    sharpness = np.where(many & (spacing > 0.0), 1.0 / np.maximum(spacing, 1e-9), 0.0)
    mesh = np.meshgrid(*axes, indexing="ij")
    return np.stack([axis.ravel() for axis in mesh], axis=1), sharpness
