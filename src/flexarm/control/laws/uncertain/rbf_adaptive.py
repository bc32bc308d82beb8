"""Adaptive control with a network of radial basis functions, without a model of the arm."""

from __future__ import annotations

import math

import numpy as np

from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.contract.base import FloatArray, Measurement, Reference
from flexarm.control.design.rigid_parameters import RigidParameters
from flexarm.control.laws.uncertain.sliding import SlidingController
from flexarm.kernels.controller_terms.adaptation import network_torque
from flexarm.model.drives.uncertain import RBFAdaptiveParameters

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
            there are too many Gaussians.
    """

    _law = staticmethod(network_torque)

    def __post_init__(self) -> None:
        super().__post_init__()
        joints = self.arm.joints
        if np.any(self.upper < self.lower):
            raise InputError(Problem("upper", "be at least lower", shown(self.upper)))
        counts = self.centres.tolist()
        if math.prod(counts) > _MOST_CENTRES:
            rule = f"have a product of at most {_MOST_CENTRES}"
            raise InputError(Problem("centres", rule, shown(counts)))
        self.centres = tuple(counts)
        self._model = RigidParameters(self.arm) if self.prior else None
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
        super().reset()

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        now, n = self._sliding, self.arm.joints
        now.take(t, measurement, reference)
        signals = self._signals
        signals[1 : 1 + n] = now.reference_acceleration
        signals[1 + n : 1 + 2 * n] = now.reference_rate
        signals[1 + 2 * n : 1 + 3 * n] = np.tanh(now.reference_rate / (_SIGN * now.bandwidth))
        first, second = self._pairs
        signals[1 + 3 * n :] = now.rate[first] * now.reference_rate[second]
        self._law(
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


#: Rate over which the sign of a rate is smoothed, relative to the bandwidth (rad).
_SIGN = 0.01


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
