"""Computed torque: joint control with the inverse dynamics of the rigid model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.control.contract.base import Arrays, FloatArray, Measurement, Reference, Step, applied
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.design.rigid_model import RigidModel
from flexarm.control.laws.joint.joint_pd import JointFollower
from flexarm.model.drives.controllers import ComputedTorqueParameters


class ComputedTorque(JointFollower, ComputedTorqueParameters, OfArm):
    """Computed torque with the rigid model of an arm.

    Without a reference the controller keeps the angles of its first measurement. On a rigid arm the
    errors satisfy a linear equation of second order, (C.2). The model has no flexible links, so on
    a flexible arm the frequency should be below the lowest one with locked joints.
    """

    vectorized = True

    _: KW_ONLY
    feedforward: Callable[[float], ArrayLike] | None = Field(
        default=None,
        description="None for feedback linearisation, with the torques of the model at the "
        "measured angles and rates; or a function of time that returns torques (joints,) N m to "
        "follow the reference, such as the ``torque`` of `tip_inversion` together with its "
        "``reference``. The mass matrix of the model then converts only the errors to torques.",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self._model = RigidModel(self.arm)
        omega = 2.0 * np.pi * self.frequency_hz
        self._proportional, self._derivative = omega**2, 2.0 * self.damping_ratio * omega

    def planned(self, t: float, reference: Reference) -> Arrays:
        more = (
            {} if self.feedforward else {"reference_acceleration": reference.joint_acceleration(t)}
        )
        return {**super().planned(t, reference), **more}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        now, speed = readings.joint_angle, readings.joint_rate
        desired: FloatArray = self._proportional * (inputs["reference_angle"] - now)
        desired = desired + self._derivative * (inputs["reference_rate"] - speed)
        if self.feedforward is not None:
            errors = applied(self._model.mass_matrix(now), desired)
            return memory, inputs["feedforward"] + errors
        desired = desired + inputs["reference_acceleration"]
        # Return a copy, because the next call of the model overwrites the array.
        return memory, self._model.torque(now, speed, desired).copy()
