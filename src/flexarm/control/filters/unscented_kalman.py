"""Unscented Kalman filter for elastic states and payload, from encoders and strain gauges."""

from __future__ import annotations

import numpy as np

from flexarm.control.filters.kalman_filter import KalmanFilter
from flexarm.control.filters.payload_hypotheses import Hypothesis
from flexarm.control.filters.predicted_readings import PredictedReadings
from flexarm.control.hardware.measurement import FloatArray

#: Weight of the central point for the covariance, beyond its weight for the mean (van der Merwe's
#: beta): the best for Gaussians, for which it represents terms of fourth order.
_BETA = 2.0


class UnscentedKalmanFilter(KalmanFilter):
    """Unscented Kalman filter for joint angles, rates, modal coordinates and payload mass.

    A set of states with the mean and covariance of the estimate, the sigma points, is carried
    through the nonlinear equations of the arm and of the readings. Mean and covariance of the
    results are of second order, without derivatives; theory page "control-uncertain". It differs
    from `ExtendedKalmanFilter` where the estimate is so uncertain that the equations are not linear
    over its covariance. The treatment of the payload, the parameters, and the use are the same: in
    a loop with ``EstimatorController``, on a record with ``run``, or in your own loop.

    Raises:
        InputError: if a number is negative or not finite, or the filter cannot use the instruments.

    References:
        S. J. Julier and J. K. Uhlmann, Proc. IEEE 92 (2004) 401-422.
        E. A. Wan and R. van der Merwe, IEEE Adaptive Systems Symposium, 2000, 153-158.
    """

    def _propagate(self, part: Hypothesis) -> FloatArray:
        assert self._step is not None
        joints = self.arm.joints
        points = _sigma_points(part.x, part.P, np.zeros((part.x.size, joints)))
        before, errors = points[:, :-joints], points[:, -joints:]
        after = before.copy()
        states = self._layout.states
        for old, error, new in zip(before, errors, after, strict=True):
            torque = self._acting(old) + self._noise * error
            new[states] = self._step.advance(old[states], torque, self._change(old))
        part.x, part.P = _mean(after), _covariance(after, after)
        self._add_drift(part)
        return _covariance(after, errors)

    def _update(
        self,
        part: Hypothesis,
        moved: FloatArray,
        seen: PredictedReadings,
        readings: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        from scipy.linalg import cho_factor, cho_solve

        assert self._step is not None
        joints = self.arm.joints
        # Accelerometers measure the error of the torque that has changed the state.
        points = _sigma_points(part.x, part.P, moved)
        states, outputs = points[:, :-joints], np.zeros((len(points), seen.size))
        for k, (x, error) in enumerate(zip(states, points[:, -joints:], strict=True)):
            torque = self._acting(x) + self._noise * error
            constants = self._step.free.at(self._change(x))
            outputs[k] = seen.values(x[self._layout.states], torque, constants)
            outputs[k] += seen.bias @ x[self._layout.biases]
        predicted = _mean(outputs)
        S = _covariance(outputs, outputs) + np.diag(seen.variance)
        K = cho_solve(cho_factor(S), _covariance(states, outputs).T).T
        part.x = part.x + K @ (readings - predicted)
        part.P = part.P - K @ S @ K.T
        part.P = 0.5 * (part.P + part.P.T)
        return predicted, S


def _sigma_points(x: FloatArray, P: FloatArray, with_errors: FloatArray) -> FloatArray:
    """Return the sigma points (2 n + 1, n) of a state and the torque errors, the mean first.

    ``with_errors`` is their covariance. The errors have unit variance and zero mean.
    """
    joints = with_errors.shape[1]
    whole = np.block([[P, with_errors], [with_errors.T, np.eye(joints)]])
    roots = square_root(whole)
    mean = np.concatenate([x, np.zeros(joints)])
    apart = np.sqrt(mean.size) * roots.T
    found: FloatArray = np.vstack([mean, mean + apart, mean - apart])
    return found


def square_root(covariance: FloatArray) -> FloatArray:
    """Return a matrix whose product with its transpose is a covariance, which may be singular."""
    # Variances differ by many orders of magnitude, and some may be zero.
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(deviation > 0.0, deviation, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root: FloatArray = (deviation[:, None] * vectors) * np.sqrt(np.maximum(values, 0.0))
    return root


def _mean(points: FloatArray) -> FloatArray:
    """Return the mean of sigma points; the central one has no weight."""
    # Relative to it, because numbers that are the same in all points must stay exact.
    found: FloatArray = points[0] + (points[1:] - points[0]).mean(axis=0)
    return found


def _covariance(points: FloatArray, others: FloatArray) -> FloatArray:
    """Return the covariance of two functions of the same sigma points."""
    a, b = points - _mean(points), others - _mean(others)
    found: FloatArray = a[1:].T @ b[1:] / (len(points) - 1) + _BETA * np.outer(a[0], b[0])
    return found
