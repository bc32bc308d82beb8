"""Extended Kalman filter for elastic states and payload, from encoders and strain gauges."""

from __future__ import annotations

import numpy as np

from flexarm.control.filters.innovation_test import innovation_covariance
from flexarm.control.filters.kalman_filter import KalmanFilter
from flexarm.control.filters.payload_hypotheses import Hypothesis
from flexarm.control.filters.predicted_readings import PredictedReadings
from flexarm.control.hardware.measurement import FloatArray

#: Number of linearisations in an update by readings that are not linear in the state.
ITERATIONS = 3


class ExtendedKalmanFilter(KalmanFilter):
    """Extended Kalman filter for joint angles, rates, modal coordinates and payload mass.

    Between samples the nonlinear equations of the arm propagate the estimate, and their exact
    derivative propagates the covariance: (C.55) to (C.58). The payload is a sum of Gaussians over
    the logarithm of the payload mass plus the effective mass of the tip. Each Gaussian has its own
    extended Kalman filter, until one is left. Use the filter in a loop with
    ``EstimatorController``, on a record with ``run``, or in your own loop: ``reset``, then
    ``correct`` and ``predict`` alternately. Other ``parameters`` of the arm and disturbance torques
    of the joints are further numbers of each Gaussian, which are random walks.

    Raises:
        InputError: if a number is negative or not finite, or the filter cannot use the instruments.

    The filter starts at the first readings of the encoders, with links at rest under gravity.
    """

    def _propagate(self, part: Hypothesis) -> FloatArray:
        assert self._step is not None
        layout = self._layout
        step = self._step.take(part.x[layout.states], self._acting(part.x), self._change(part.x))
        F, states = np.eye(layout.size), layout.states
        moving = self._moving(part.x)
        F[states] = layout.derivative(step.state, step.parameters, step.torque, moving)
        part.x[states] = step.after
        noisy = np.zeros((layout.size, self.arm.joints))
        noisy[states] = step.torque * self._noise
        part.P = F @ part.P @ F.T + noisy @ noisy.T
        self._add_drift(part)
        return noisy

    def _update(
        self,
        part: Hypothesis,
        moved: FloatArray,
        seen: PredictedReadings,
        readings: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        from scipy.linalg import cho_factor, cho_solve

        assert self._step is not None
        before, x, layout = part.x, part.x, self._layout
        for iteration in range(1 if seen.linear else ITERATIONS):
            constants = self._step.free.at(self._change(x))
            found = seen.predict(x[layout.states], self._acting(x), constants)
            slopes = found.state, found.parameters, found.torque
            H = layout.derivative(*slopes, self._moving(x), seen.bias)
            felt = found.torque * self._noise
            S, R, N = innovation_covariance(part.P, moved, H, felt, seen.variance)
            K = cho_solve(cho_factor(S), (part.P @ H.T + N).T).T
            expected = found.values + seen.bias @ x[layout.biases] + H @ (before - x)
            if iteration == 0:
                predicted, deviation = expected, S
            x = before + K @ (readings - expected)
        left = np.eye(x.size) - K @ H
        # The Joseph form keeps the covariance symmetric and positive despite rounding.
        both = left @ N @ K.T
        part.x, part.P = x, left @ part.P @ left.T + K @ R @ K.T - both - both.T
        return predicted, deviation
