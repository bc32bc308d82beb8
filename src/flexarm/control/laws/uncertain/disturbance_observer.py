"""Disturbance observer around any controller, with compensation of the estimated torque."""

from __future__ import annotations

import math

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.control.contract.base import (
    Around,
    Arrays,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    Step,
)
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.design.arm_scales import default_cutoff
from flexarm.control.design.rigid_model import RigidParameters
from flexarm.model.drives.around import DisturbanceObserverParameters


class DisturbanceObserver(DisturbanceObserverParameters, OfArm, Around):
    """Generalised-momentum observer that compensates disturbance torques at the joints.

    De Luca and Mattone, Actuator failure detection and isolation using generalized momenta, ICRA
    2003; (C.52) to (C.54). The estimate is the torque that the rigid model does not explain, passed
    through a first-order filter. It needs neither accelerations nor the inverse mass matrix.

    The observer uses the measured "torque" if an instrument reads it, and the requested torque
    otherwise.
    """

    inner: Controller

    def __post_init__(self) -> None:
        if self.cutoff is None:
            hertz = default_cutoff(self.arm, self.sample_time)
            self.cutoff = np.full(self.arm.joints, hertz)
        self._model = RigidParameters(self.arm)
        self._taken = self._filtered()

    def _filtered(self) -> FloatArray:
        """Return the part of the new estimate that a sample takes over, (joints,)."""
        # One by one, because the vector function rounds differently.
        turns = [-2.0 * math.pi * hertz * self.sample_time for hertz in np.asarray(self.cutoff)]
        return np.array([1.0 - math.exp(angle) for angle in turns])

    @property
    def estimate(self) -> FloatArray:
        """Estimated disturbance torque at the joints, (joints,) N m."""
        return np.array(self.memory.get("estimate", np.zeros(self.arm.joints)))

    def reset(self) -> None:
        """Clear the state of the previous run, including the inner controller."""
        super().reset()
        self._taken = self._filtered()

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        return self._required(arm, reference, self.arm.joints)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        now = self._model.momentum(readings.joint_angle, readings.joint_rate).copy()
        nothing = 0.0 * now[0]
        # The first sample has no interval before it that the estimate could follow.
        own = {"momentum": now, "commanded": nothing, "estimate": nothing, "intervals": np.zeros(1)}
        return {**own, **super().initial_memory(readings, inputs)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        now = self._model.momentum(readings.joint_angle, readings.joint_rate).copy()
        # The trapezoidal rule is accurate, because the torque is constant over the sample and
        # the other terms are nearly linear.
        pushed = (now[0] - memory["momentum"][0]) / self.sample_time
        pushed -= readings.get("torque", memory["commanded"])
        pushed -= 0.5 * (now[1] + memory["momentum"][1])
        pushed -= memory["estimate"]
        estimate = memory["estimate"] + memory["intervals"] * (self._taken * pushed)
        inside, torque = self._inner_step(memory, readings, inputs)
        torque = torque - self.compensation * estimate
        own = {"momentum": now, "commanded": torque, "estimate": estimate, "intervals": np.ones(1)}
        return {**own, **inside}, torque
