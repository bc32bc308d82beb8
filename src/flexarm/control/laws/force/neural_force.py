"""Hybrid force control with a network that learns the shape of the surface."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from flexarm.control.contract.base import Arrays, FloatArray
from flexarm.control.laws.force.adaptive_force import AdaptiveForce, surface_of
from flexarm.model.drives.controllers import NeuralForceParameters


class NeuralForce(NeuralForceParameters, AdaptiveForce):
    """Adaptive force control with a network that learns a surface of unknown shape.

    The network adds a push that depends on the requested position of the tip, and one that depends
    on the position and is proportional to the speed. Its signals are random Fourier features of the
    position (Rahimi and Recht 2007) in place of the coefficients of `AdaptiveForce`, which it
    contains. It learns from stroke to stroke. Theory page "control-force", (F.19) and (F.20).

    Raises:
        InputError: if a gain is negative or not finite, or a number that must be positive is not.
    """

    references: ClassVar[str] = "RoyWhitcomb2002 RahimiRecht2007"
    _shares: ClassVar[dict[str, float]] = {
        **AdaptiveForce._shares,
        "learning": 1.9,
        "feature_length": 0.04,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        random = np.random.default_rng(self.seed)
        self._waves = random.normal(size=(self.features, 2)) / self.feature_length
        self._phases = random.uniform(0.0, 2.0 * np.pi, self.features)
        self._gains[2:] = self.learning

    @property
    def _terms(self) -> int:
        return 2 + 2 * self.features

    def _signals(self, inputs: Arrays) -> FloatArray:
        known, now = super()._signals(inputs), surface_of(inputs)
        place = self._waves[:, 0] * now.x + self._waves[:, 1] * now.y + self._phases
        network = np.sqrt(2.0 / self.features) * np.cos(place)
        moving = np.tanh(now.speed / self.nominal_speed)
        return np.concatenate([known, network, moving * network])

    def _adapt(
        self, memory: dict[str, Any], inputs: Arrays, signals: FloatArray, error: float
    ) -> None:
        """Update the estimates; those of the network only while the tip slides."""
        estimate = memory["estimate"]
        if self._slides(inputs):
            decay = self.sample_time * (self.leakage + self.e_modification * abs(error))
            network = estimate[2:] * max(0.0, 1.0 - decay)
            memory["estimate"] = np.concatenate([estimate[:2], network])
        else:
            signals = np.concatenate([signals[:2], 0.0 * signals[2:]])
        super()._adapt(memory, inputs, signals, error)
