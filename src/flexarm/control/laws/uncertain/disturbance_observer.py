"""Disturbance observer around any controller, with compensation of the estimated torque."""

from __future__ import annotations

import math

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.control.analysis.linear_controller import memory_of
from flexarm.control.contract.base import (
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    report_of,
    requirements_of,
)
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.contract.requirements import JOINTS
from flexarm.control.design.default_requirements import lowest_frequency
from flexarm.control.design.rigid_parameters import RigidParameters
from flexarm.model.drives.around import DisturbanceObserverParameters

#: Largest default cutoff, relative to the sampling frequency.
_MOST = 0.005


class DisturbanceObserver(DisturbanceObserverParameters, OfArm, Controller):
    """Generalised-momentum observer that compensates disturbance torques at the joints.

    De Luca and Mattone, Actuator failure detection and isolation using generalized momenta, ICRA
    2003; (C.52) to (C.54). The estimate is the torque that the rigid model does not explain, passed
    through a first-order filter. It needs neither accelerations nor the inverse mass matrix.

    The observer uses the measured "torque" if an instrument reads it, and the requested torque
    otherwise.

    Raises:
        InputError: if a number is negative or not finite, ``compensation`` exceeds 1, or ``inner``
            is not a controller.
    """

    inner: Controller

    def __post_init__(self) -> None:
        if self.cutoff is None:
            hertz = min(lowest_frequency(self.arm) / (4.0 * math.pi), _MOST / self.sample_time)
            self.cutoff = np.full(self.arm.joints, hertz)
        self._model = RigidParameters(self.arm)
        self._estimate = np.zeros(self.arm.joints)
        self._last: FloatArray | None = None
        self._commanded = np.zeros(self.arm.joints)

    @property
    def memory(self) -> tuple[str, ...] | None:  # type: ignore[override]
        """Attributes kept between samples; None if ``inner`` does not declare its own."""
        inside = memory_of(self.inner)
        if inside is None:
            return None
        return ("_estimate", "_last", "_commanded", *(f"inner.{name}" for name in inside))

    @property
    def sample_time(self) -> float:
        """Sample time of the inner controller, s."""
        return self.inner.sample_time

    @sample_time.setter
    def sample_time(self, value: float) -> None:
        self.inner.sample_time = value

    @property
    def estimate(self) -> FloatArray:
        """Estimated disturbance torque at the joints, (joints,) N m."""
        return self._estimate.copy()

    def reset(self) -> None:
        """Clear the state of the previous run, including the inner controller."""
        self.inner.reset()
        self._estimate[:] = 0.0
        self._last = None
        self._taken = np.array(
            [
                1.0 - math.exp(-2.0 * math.pi * hertz * self.sample_time)
                for hertz in np.asarray(self.cutoff)
            ]
        )

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """See ``Controller.requirements``."""
        inner = requirements_of(self.inner, arm, reference)
        joints = self.arm.joints if self.arm.joints != arm.joints else inner.joints
        return ControllerRequirements(
            joints, tuple(dict.fromkeys([*JOINTS, *inner.measured])), inner.gauges
        )

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        now = self._model.momentum(measurement.joint_angle, measurement.joint_rate).copy()
        if self._last is not None:
            # The trapezoidal rule is accurate, because the torque is constant over the sample and
            # the other terms are nearly linear.
            pushed = (now[0] - self._last[0]) / self.sample_time
            pushed -= measurement.get("torque", self._commanded)
            pushed -= 0.5 * (now[1] + self._last[1])
            pushed -= self._estimate
            self._estimate += self._taken * pushed
        self._last = now
        torque = np.asarray(self.inner.update(t, measurement, reference))
        self._commanded = torque - self.compensation * self._estimate
        return self._commanded.copy()

    def report(self) -> dict[str, float]:
        """Return the report of the inner controller."""
        return report_of(self.inner)
