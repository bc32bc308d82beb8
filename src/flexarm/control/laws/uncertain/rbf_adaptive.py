"""Adaptive control with a network of radial basis functions, without a model of the arm."""

from __future__ import annotations

import math

import numpy as np

from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.contract.base import Arrays, FloatArray, Measurement, Step
from flexarm.control.design.rigid_model import RigidParameters
from flexarm.control.laws.uncertain.sliding_mode import SlidingController
from flexarm.kernels.controller_terms.adaptation import network_torque
from flexarm.model.drives.controllers import RBFAdaptiveParameters

#: Rate over which the sign of a rate is smoothed, relative to the bandwidth (rad).
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
            there are too many Gaussians.
    """

    linearizable = False
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
        self._start = np.zeros((joints, len(self._centres), 1 + 3 * joints + len(self._pairs[0])))

    @property
    def weights(self) -> FloatArray:
        """Current weights (joints, Gaussians, signals)."""
        return np.array(self.memory.get("weights", self._start))

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {"weights": self._start, **super().initial_memory(readings, inputs)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after, now = self._sliding.at(memory, readings, inputs)
        weights, torque = memory["weights"].copy(), np.zeros_like(now.s)
        first, second = self._pairs
        signals = np.concatenate(
            [
                np.ones(1),
                now.reference_acceleration,
                now.reference_rate,
                np.tanh(now.reference_rate / (_SIGN * self.bandwidth)),
                now.rate[first] * now.reference_rate[second],
            ]
        )
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
            weights,
            torque,
        )
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
