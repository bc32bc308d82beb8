"""Sliding variable of joint errors, and sliding-mode control with a boundary layer."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.contract.base import (
    JOINTS,
    Arrays,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    Step,
)
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.design.arm_scales import default_cutoff, slow_rate, typical_torque
from flexarm.control.design.rigid_model import RigidParameters
from flexarm.model.drives.controllers import SlidingModeParameters

#: Smoothing rate of adapted friction, relative to the bandwidth (rad).
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


class SlidingVariable:
    """Reference rates and s = qd - qd_r, theory page "control under uncertainty", (C.40).

    The reference rate is the rate of the motion, plus ``bandwidth`` times the angle error, plus
    ``strain_gain`` times the high-pass filtered curvature at the root of the joint's link.
    """

    def __init__(
        self, arm: Arm, bandwidth: FloatArray, strain_gain: FloatArray, washout: float
    ) -> None:
        self.bandwidth, self.strain_gain, self.washout = bandwidth, strain_gain, washout
        self.smoothing_rate = _SMOOTHED * bandwidth
        self._gauge = np.zeros(arm.joints, dtype=np.intp)
        self._per_strain = np.zeros(arm.joints)
        self._fed = bool(np.any(self.strain_gain > 0.0))
        for joint in np.flatnonzero(self.strain_gain > 0.0):
            self._find_gauge(arm, int(joint))
        self.reset(1.0)

    def _find_gauge(self, arm: Arm, joint: int) -> None:
        """Select the gauge nearest to the root of the joint's link."""
        link = arm.joint_numbers[joint] - 1
        own = [(station, k) for k, (i, station, d) in enumerate(arm.gauges) if i == link and d]
        if not own:
            rule = f"be 0 at joint {link + 1} (its link has no gauge off the neutral axis)"
            raise InputError(Problem("strain_gain", rule, shown(float(self.strain_gain[joint]))))
        self._gauge[joint] = min(own)[1]
        self._per_strain[joint] = -self.strain_gain[joint] / arm.gauges[min(own)[1]][2]

    def requirements(self, arm: Arm) -> ControllerRequirements:
        """Return the requirements of a controller of ``arm``."""
        if self._fed:
            return ControllerRequirements(arm.joints, (*JOINTS, "strain"), len(arm.gauges))
        return ControllerRequirements(arm.joints, JOINTS)

    def reset(self, sample_time: float) -> None:
        """Set the sample time (s)."""
        self._forget_slow = 1.0 - math.exp(-2.0 * math.pi * self.washout * sample_time)
        self._rise_fast = 1.0 - math.exp(-2.0 * math.pi * _NOISE_CUTOFF)
        self._sample_time = sample_time

    def initial_memory(self, readings: Measurement) -> Arrays:
        """Return the low-pass and the high-pass filtered curvature at the first sample."""
        if not self._fed:
            return {}
        bent = self._per_strain * readings.strain[self._gauge]
        return {"slow": bent, "fast": 0.0 * bent}

    def at(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> tuple[Arrays, Sliding]:
        """Return the next memory, and the sliding variable of a sample."""
        angle, rate = readings.joint_angle, readings.joint_rate
        desired = inputs["reference_rate"]
        reference_rate = desired + self.bandwidth * (inputs["reference_angle"] - angle)
        change = self.bandwidth * (desired - rate)
        acceleration = inputs["reference_acceleration"] + change
        after = {}
        if self._fed:
            bent = self._per_strain * readings.strain[self._gauge]
            step = self._rise_fast * (bent - memory["slow"] - memory["fast"])
            after["slow"] = memory["slow"] + self._forget_slow * (bent - memory["slow"])
            after["fast"] = memory["fast"] + step
            reference_rate = reference_rate + after["fast"]
            acceleration = acceleration + step / self._sample_time
        return after, Sliding(angle, rate, reference_rate, acceleration, rate - reference_rate)


class SlidingController(OfArm, Controller):
    """Base of controllers with a `SlidingVariable`.

    A subclass has the parameters ``bandwidth``, ``strain_gain`` and ``washout``, in its own order.
    """

    def __post_init__(self) -> None:
        own: Any = self
        if own.washout is None:
            own.washout = default_cutoff(self.arm, self.sample_time)
        self._sliding = SlidingVariable(self.arm, own.bandwidth, own.strain_gain, own.washout)

    def reset(self) -> None:
        """Clear the state of the previous run."""
        super().reset()
        self._sliding.reset(self.sample_time)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return self._sliding.initial_memory(readings)

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        return self._sliding.requirements(self.arm)


#: Default excess of the switching torque, relative to typical torques.
_REACHING = 0.01


class SlidingMode(SlidingModeParameters, SlidingController):
    """Torque of the rigid model plus a switching torque that exceeds its errors; (C.47), (C.48).

    Slotine and Li, Applied Nonlinear Control, 1991, chapter 7. The switching gain is computed at
    every sample from the largest errors of the parameters. Within the boundary layer the switching
    torque is linear in s.

    Raises:
        InputError: if a name is unknown, or a number is negative or not finite.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        named = self.uncertainty or {}
        if self.reaching is None:
            rate = slow_rate(self.arm, self.sample_time)
            self.reaching = _REACHING * typical_torque(self.arm, None, rate)
        self._model = RigidParameters(self.arm, tuple(named), self._sliding.smoothing_rate)
        # Nominal value and largest error of each row of the regressor.
        known = self._model.known
        self._believed = self._model.placed(np.concatenate([np.ones(known), self._model.values]))
        errors = np.array([*named.values()])
        self._errors = self._model.placed(np.concatenate([np.zeros(known), errors]))
        self._floor = self.disturbance + self.reaching

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after, now = self._sliding.at(memory, readings, inputs)
        rows = self._model.regressor(
            now.angle, now.rate, now.reference_rate, now.reference_acceleration, ordered=False
        )
        switching = self._errors.dot(abs(rows))
        switching += self._floor
        # ``minimum`` and ``maximum`` take half the time of ``clip``.
        switching *= np.minimum(np.maximum(now.s / self.boundary_layer, -1.0), 1.0)
        torque: FloatArray = self._believed.dot(rows)
        torque -= self.damping * now.s
        torque -= switching
        return after, torque
