"""Sliding-mode control with a boundary layer, robust against bounded model errors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_kind
from flexarm.arm import Arm
from flexarm.control.base import Controller, FloatArray, Measurement, Needs, Reference
from flexarm.control.gains import Gains
from flexarm.control_design.rigid_parameters import RigidParameters
from flexarm.controllers.sliding import SlidingVariable


class SlidingMode(Controller):
    """Torque of the rigid model plus a switching torque that exceeds its errors; (C.47), (C.48).

    Slotine and Li, Applied Nonlinear Control, 1991, chapter 7. The switching gain is computed at
    every sample from the largest errors of the parameters. Within the boundary layer the switching
    torque is linear in s.

    Args:
        arm: model of the arm.
        bandwidth: 1/s, one number or one per joint: decay rate of angle errors on s = 0.
        boundary_layer: rad/s, one number or one per joint: width of s within which the torque does
            not switch.
        uncertainty: mapping from parameters (names as in ``Adaptive``) to the largest errors of
            their values.
        disturbance: N m, one number or one per joint: bound of other disturbance torques.
        reaching: N m, one number or one per joint: excess of the switching torque over the bounds.
        damping: N m s/rad, one number or one per joint: gain of s, inside and outside the layer.
        strain_gain, washout, sample_time: as in ``Adaptive``.

    Raises:
        InputError: if a name is unknown, or a number is negative or not finite.
    """

    name = "sliding_mode"
    memory = ("_sliding._slow", "_sliding._fast")

    def __init__(
        self,
        arm: Arm,
        bandwidth: ArrayLike,
        boundary_layer: ArrayLike,
        uncertainty: Mapping[str, float] | None = None,
        disturbance: ArrayLike = 0.0,
        reaching: ArrayLike = 0.1,
        damping: ArrayLike = 0.0,
        strain_gain: ArrayLike = 0.0,
        washout: float = 0.5,
        sample_time: float = 1e-3,
    ) -> None:
        self.arm, gains = check_kind("SlidingMode", "arm", arm, Arm), Gains("SlidingMode")
        self.uncertainty = gains.mapping("uncertainty", uncertainty)
        gains.done()
        self._model = RigidParameters("SlidingMode", arm, tuple(self.uncertainty))
        self._sliding = SlidingVariable(gains, arm, bandwidth, strain_gain, washout)
        self.bandwidth, self.strain_gain = self._sliding.bandwidth, self._sliding.strain_gain
        self.washout = self._sliding.washout
        joints = arm.joints
        self.boundary_layer = gains.each("boundary_layer", boundary_layer, joints, positive=True)
        self.disturbance = gains.each("disturbance", disturbance, joints)
        self.reaching = gains.each("reaching", reaching, joints, positive=True)
        self.damping = gains.each("damping", damping, joints)
        self.sample_time = gains.one("sample_time", sample_time, positive=True)
        errors = [gains.one(f"uncertainty of {k}", v) for k, v in self.uncertainty.items()]
        gains.done()
        # Nominal value and largest error of each row of the regressor.
        known = self._model.known
        self._believed = self._model.placed(np.concatenate([np.ones(known), self._model.values]))
        self._errors = self._model.placed(np.concatenate([np.zeros(known), errors]))
        self._floor = self.disturbance + self.reaching

    def reset(self) -> None:
        """Clear the state of the previous run."""
        self._sliding.reset(self.sample_time)

    def needs(self, arm: Arm, reference: Reference | None) -> Needs:
        """See ``Controller.needs``."""
        return self._sliding.needs(self.arm)

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        now = self._sliding
        now.take(t, measurement, reference)
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
        return torque
