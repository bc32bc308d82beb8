"""Sliding variable of the controllers for uncertain arms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.contract.base import (
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
)
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.contract.requirements import JOINTS

#: Cutoff of the low-pass filter of the curvature, which limits noise in its rate, relative to the
#: sampling frequency.
_NOISE_CUTOFF = 0.1


class SlidingVariable:
    """Reference rates and s = qd - qd_r, theory page "control under uncertainty", (C.40).

    The reference rate is the rate of the motion, plus ``bandwidth`` times the angle error, plus
    ``strain_gain`` times the high-pass filtered curvature at the root of the joint's link. Without
    a reference, the angles of the first measurement are the reference.

    Attributes, after ``take``: angle, rate, reference_rate, reference_acceleration, s, (joints,).
    """

    def __init__(
        self, arm: Arm, bandwidth: FloatArray, strain_gain: FloatArray, washout: float
    ) -> None:
        self.bandwidth, self.strain_gain, self.washout = bandwidth, strain_gain, washout
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
        """Clear the state of the previous run; ``sample_time`` in s."""
        self._held: FloatArray | None = None
        self._slow: FloatArray | None = None
        self._fast = np.zeros_like(self.bandwidth)
        self._forget_slow = 1.0 - math.exp(-2.0 * math.pi * self.washout * sample_time)
        self._rise_fast = 1.0 - math.exp(-2.0 * math.pi * _NOISE_CUTOFF)
        self._sample_time = sample_time

    def take(self, t: float, measurement: Measurement, reference: Reference | None) -> None:
        """Compute all attributes at sample time t (s)."""
        self.angle, self.rate = measurement.joint_angle, measurement.joint_rate
        if reference is None:
            if self._held is None:
                self._held = self.angle.copy()
            pull = self.bandwidth * (self._held - self.angle)
            self.reference_rate = pull
            self.reference_acceleration = -self.bandwidth * self.rate
        else:
            desired = reference.joint_rate(t)
            self.reference_rate = desired + self.bandwidth * (reference.joint_angle(t) - self.angle)
            change = self.bandwidth * (desired - self.rate)
            self.reference_acceleration = reference.joint_acceleration(t) + change
        if self._fed:
            self._feed(measurement.strain[self._gauge])
        self.s = self.rate - self.reference_rate

    def _feed(self, strain: FloatArray) -> None:
        bent = self._per_strain * strain
        if self._slow is None:
            self._slow = bent.copy()
        step = self._rise_fast * (bent - self._slow - self._fast)
        self._fast += step
        self._slow += self._forget_slow * (bent - self._slow)
        self.reference_rate = self.reference_rate + self._fast
        self.reference_acceleration = self.reference_acceleration + step / self._sample_time


class SlidingController(OfArm, Controller):
    """Base of controllers with a `SlidingVariable`.

    A subclass has the parameters ``bandwidth``, ``strain_gain`` and ``washout``, in its own order.
    """

    def __post_init__(self) -> None:
        own: Any = self
        self._sliding = SlidingVariable(self.arm, own.bandwidth, own.strain_gain, own.washout)

    def reset(self) -> None:
        """Clear the state of the previous run."""
        self._sliding.reset(self.sample_time)

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """See ``Controller.requirements``."""
        return self._sliding.requirements(self.arm)
