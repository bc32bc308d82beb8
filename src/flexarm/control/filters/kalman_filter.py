"""Base of the Kalman filters for elastic states and payload, from encoders and strain gauges."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace

import numpy as np

from flexarm.control.filters.estimator import StateEstimator
from flexarm.control.filters.first_estimate import tip_mass
from flexarm.control.filters.innovation_test import squared_innovation
from flexarm.control.filters.payload_hypotheses import (
    Hypothesis,
    combined,
    moments,
    reduced,
    split,
)
from flexarm.control.filters.predicted_readings import PredictedReadings
from flexarm.control.hardware.measurement import FloatArray


class KalmanFilter(StateEstimator):
    """Base of the Kalman filters: a sum of Gaussians, each propagated and corrected alone.

    A filter defines ``_propagate`` and ``_update``. The payload is a sum of Gaussians over the
    logarithm of the payload mass plus the effective mass of the tip, the last number of each.
    """

    _changing = ("_parts", "_moved")

    def __post_init__(self) -> None:
        self._own = tip_mass(self.arm)
        super().__post_init__()

    def _start(self, x: FloatArray, covariance: FloatArray) -> None:
        """See ``StateEstimator._start``."""
        self._scale, parts = split(x + self._own * np.eye(x.size)[-1], covariance)  # kg
        self._parts = [part for part in parts if self._moving(part.x) >= self._own] or parts
        # Change of the numbers of each hypothesis by the error of the last torque.
        self._moved = [np.zeros((x.size, self.arm.joints))] * len(self._parts)

    def _correct(self, seen: PredictedReadings, readings: FloatArray) -> float:
        """See ``StateEstimator._correct``."""
        from scipy.linalg import cho_factor, cho_solve

        # The innovation test needs the weights of the hypotheses before the update changes them.
        before = [replace(part) for part in self._parts]
        predicted, expected = [], []
        for part, moved in zip(self._parts, self._moved, strict=True):
            values, S = self._update(part, moved, seen, readings)
            predicted.append(values)
            expected.append(S)
            factor = cho_factor(S)
            missed = readings - values
            part.log_weight -= 0.5 * float(missed @ cho_solve(factor, missed))
            part.log_weight -= float(np.sum(np.log(np.diag(factor[0]))))
        mean, covariance = combined(before, predicted, expected)
        self._parts = reduced(self._parts)
        self._moved = [np.zeros_like(self._moved[0])] * len(self._parts)
        return squared_innovation(readings - mean, covariance)

    def _predict(self) -> None:
        """See ``StateEstimator._predict``."""
        self._moved = [self._propagate(part) for part in self._parts]

    @abstractmethod
    def _propagate(self, part: Hypothesis) -> FloatArray:
        """Carry a hypothesis to the next sample; return its covariance with the torque error.

        (s, joints), for torque errors relative to ``torque_noise``.
        """

    @abstractmethod
    def _update(
        self,
        part: Hypothesis,
        moved: FloatArray,
        seen: PredictedReadings,
        readings: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Correct a hypothesis; return its predicted readings and their covariance.

        ``moved`` is the result of ``_propagate``, zero before the first prediction.
        """

    def _add_drift(self, part: Hypothesis) -> None:
        """Add the random walks over a sample to the covariance."""
        part.P[np.diag_indices_from(part.P)] += self._walk
        if self.payload_drift:
            wandered = self.payload_drift**2 * self.sample_time
            part.P[-1, -1] += np.log1p(wandered / self._moving(part.x) ** 2)

    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """See ``StateEstimator._moments``."""
        return moments(self._parts, self._scale, self._own)

    def _moving(self, x: FloatArray) -> float:
        """Return the mass (kg) whose logarithm is estimated: payload plus effective tip mass."""
        return self._scale * float(np.exp(x[-1]))

    def _change(self, x: FloatArray) -> FloatArray:
        """Return the changes (1 + p,) of payload mass and parameters for the step."""
        mass = max(self._moving(x) - self._own, 0.0)
        return self._layout.changes(x, mass, self._nominal)
