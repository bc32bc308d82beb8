"""Sliding-mode control with a boundary layer, robust against bounded model errors."""

from __future__ import annotations

import numpy as np

from flexarm.control.contract.base import Arrays, FloatArray, Measurement
from flexarm.control.design.arm_scales import slow_rate
from flexarm.control.design.default_requirements import typical_torque
from flexarm.control.design.rigid_parameters import RigidParameters
from flexarm.control.laws.uncertain.sliding import SlidingController
from flexarm.model.drives.controllers import SlidingModeParameters

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

    def step(
        self, memory: Arrays, readings: Measurement, inputs: Arrays
    ) -> tuple[Arrays, FloatArray]:
        """See ``Controller.step``."""
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
