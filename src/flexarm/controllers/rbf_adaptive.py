"""Adaptive control with a network of radial basis functions, without a model of the arm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_kind
from flexarm.arm import Arm
from flexarm.control.base import Controller, FloatArray, Measurement, Needs, Reference
from flexarm.control.gains import Gains
from flexarm.control_design.rigid_parameters import RigidParameters
from flexarm.controllers.sliding import SlidingVariable
from flexarm.errors import is_count
from flexarm.kernels.adaptation import network_torque

#: Largest number of Gaussians; more of them take longer than a sample time.
_MOST_CENTRES = 10_000


class RBFAdaptive(Controller):
    """Adaptive control with a neural network that learns the inverse dynamics; (C.49) to (C.51).

    Ge, Lee and Harris, Adaptive Neural Network Control of Robotic Manipulators, 1998; Lewis,
    Yesildirek and Liu, IEEE Trans. Neural Networks 7(2), 1996. Gaussians of the joint
    angles multiply the signals in which the dynamics are linear: accelerations, products of rates,
    a constant for gravity, rates and signs of rates.

    Args:
        arm: gives the number of joints, and with ``prior`` the rigid model.
        bandwidth: 1/s, one number or one per joint: decay rate of angle errors on s = 0.
        damping: N m s/rad, one number or one per joint: gain of s.
        adaptation: adaptation gain of the weights, positive.
        lower, upper: rad, (joints,): bounds of the joint angles of the motion.
        centres: number of Gaussians along each joint angle, one number or one per joint; 1 for a
            joint whose angle does not affect the dynamics, such as the first one without gravity.
            Their width is their spacing.
        leakage: 1/s, decay rate of the weights (sigma modification).
        e_modification: 1/rad, decay rate of the weights per norm of s.
        prior: whether to add the torque of the arm's rigid model, so that the network learns the
            remainder.
        strain_gain, washout, sample_time: as in ``Adaptive``.

    Raises:
        InputError: if a number is negative or not finite, ``upper`` is less than ``lower``, or
            there are too many Gaussians.
    """

    name = "rbf_adaptive"

    def __init__(
        self,
        arm: Arm,
        bandwidth: ArrayLike,
        damping: ArrayLike,
        adaptation: float,
        lower: ArrayLike,
        upper: ArrayLike,
        centres: int | Sequence[int] = 5,
        leakage: float = 0.0,
        e_modification: float = 0.01,
        prior: bool = False,
        strain_gain: ArrayLike = 0.0,
        washout: float = 0.5,
        sample_time: float = 1e-3,
    ) -> None:
        arm, gains = check_kind("RBFAdaptive", "arm", arm, Arm), Gains("RBFAdaptive")
        joints = arm.joints
        self.arm, self.prior = arm, gains.flag("prior", prior)
        self._sliding = SlidingVariable(gains, arm, bandwidth, strain_gain, washout)
        self.bandwidth, self.strain_gain = self._sliding.bandwidth, self._sliding.strain_gain
        self.washout = self._sliding.washout
        self.damping = gains.each("damping", damping, joints)
        self.adaptation = gains.one("adaptation", adaptation, positive=True)
        self.leakage = gains.one("leakage", leakage)
        self.e_modification = gains.one("e_modification", e_modification)
        self.sample_time = gains.one("sample_time", sample_time, positive=True)
        self.lower, self.upper = _box(gains, lower, upper, joints)
        self.centres = _counts(gains, centres, joints)
        gains.done()
        self._model = RigidParameters("RBFAdaptive", arm) if self.prior else None
        self._centres, self._sharpness = _grid(self.lower, self.upper, self.centres)
        self._pairs = np.triu_indices(joints)
        self._signals = np.ones(1 + 3 * joints + len(self._pairs[0]))
        self._weights = np.zeros((joints, len(self._centres), self._signals.size))
        self._torque = np.zeros(joints)

    @property
    def weights(self) -> FloatArray:
        """Current weights (joints, Gaussians, signals)."""
        return self._weights.copy()

    def reset(self) -> None:
        """Reset the weights to zero."""
        self._weights[:] = 0.0
        self._sliding.reset(self.sample_time)

    def needs(self, arm: Arm, reference: Reference | None) -> Needs:
        """See ``Controller.needs``."""
        return self._sliding.needs(self.arm)

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        now, n = self._sliding, self.arm.joints
        now.take(t, measurement, reference)
        signals = self._signals
        signals[1 : 1 + n] = now.reference_acceleration
        signals[1 + n : 1 + 2 * n] = now.reference_rate
        signals[1 + 2 * n : 1 + 3 * n] = np.tanh(now.reference_rate / SIGN_RATE)
        first, second = self._pairs
        signals[1 + 3 * n :] = now.rate[first] * now.reference_rate[second]
        network_torque(
            now.angle,
            signals,
            now.s,
            self._centres,
            self._sharpness,
            self.damping,
            self.adaptation,
            self.leakage,
            self.e_modification,
            self.sample_time,
            self._weights,
            self._torque,
        )
        if self._model is None:
            return self._torque.copy()
        rows = self._model.regressor(
            now.angle, now.rate, now.reference_rate, now.reference_acceleration
        )
        torque: FloatArray = self._torque + rows[0] + rows[1]
        return torque


#: Rate over which the sign of a rate is smoothed, rad/s.
SIGN_RATE = 0.05


def _box(
    gains: Gains, lower: ArrayLike, upper: ArrayLike, joints: int
) -> tuple[FloatArray, FloatArray]:
    ends = []
    for name, value in (("lower", lower), ("upper", upper)):
        ends.append(gains.each(name, value, joints, negative=True))
    if np.any(ends[1] < ends[0]):
        gains.refuse("upper", "be at least lower", upper)
    return ends[0], ends[1]


def _counts(gains: Gains, centres: int | Sequence[int], joints: int) -> tuple[int, ...]:
    counts: list[Any] = list(centres) if isinstance(centres, list | tuple) else [centres] * joints
    whole = all(map(is_count, counts))
    if not whole or len(counts) != joints or math.prod(counts) > _MOST_CENTRES:
        rule = f"be one whole number or {joints} of them, at least 1, with a product of at most "
        gains.refuse("centres", rule + f"{_MOST_CENTRES}", centres)
        return (1,) * joints
    return tuple(int(k) for k in counts)


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
    sharpness = np.where(many & (spacing > 0.0), 1.0 / np.maximum(spacing, 1e-9), 0.0)
    mesh = np.meshgrid(*axes, indexing="ij")
    return np.stack([axis.ravel() for axis in mesh], axis=1), sharpness
