"""Kalman filters for elastic states and payload, from encoders and strain gauges.

If rates and bending are as uncertain as they are large, their product with an unknown mass is far
from linear, and the mass estimate of a single Gaussian follows its linearisation errors. The
filters have a sum of Gaussians over the logarithm of the mass. In each of them the mass is certain
enough for linear theory, and the readings update the weights of the Gaussians.

References:
    D. L. Alspach and H. W. Sorenson, IEEE Trans. Automatic Control 17 (1972) 439-448.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np

from flexarm.base.late import linalg
from flexarm.control.filters.estimates import Matrix, innovation_covariance, squared_innovation
from flexarm.control.filters.estimator import StateEstimator, tip_mass
from flexarm.control.filters.predicted_readings import ArmModel, Link, PredictedReadings, Readings
from flexarm.control.hardware.measurement import FloatArray

#: Number of Gaussians; distance of the outermost ones from the mean, in standard deviations; and
#: standard deviation of each, relative to their spacing. Nine Gaussians, each 35 % of the mass
#: wide, were too wide: for light payloads some random seeds gave squared errors nine times as large
#: as the covariance allowed.
_COUNT, _RANGE, _WIDTH = 25, 2.5, 0.9
#: Standard deviation of the logarithm up to which one Gaussian is sufficient.
_NARROW = 0.1
#: Gaussians with a lower probability than this are dropped; those closer than half a standard
#: deviation are merged.
_LEAST, _CLOSE = 1e-6, 0.5


@dataclass
class Hypothesis:
    """Gaussian over [state, log(mass / scale)]: mean (n + 1,), covariance and log weight.

    ``moved`` (n + 1, joints) is its covariance with the error of the last torque, relative to
    ``torque_noise``; zero after a correction.
    """

    x: FloatArray
    P: FloatArray
    log_weight: float
    moved: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))


def split(x: FloatArray, P: FloatArray) -> tuple[float, list[Hypothesis]]:
    """Return a scale (kg) and Gaussians over [state, log(mass / scale)].

    Args:
        x, P: mean and covariance of [state, mass], kg. The masses are lognormal. If the standard
            deviation of the mass exceeds its mean, both are replaced by the square root of half
            the mean square, because masses are not negative.
    """
    mean, variance = float(x[-1]), float(P[-1, -1])
    slope = P[:-1, -1] / variance if variance > 0.0 else np.zeros(x.size - 1)
    rest = P[:-1, :-1] - variance * np.outer(slope, slope)
    half = 0.5 * (mean**2 + variance)
    scale = max(mean, float(np.sqrt(half)))
    spread = float(np.log1p(min(variance, half) / scale**2)) if scale > 0.0 else 0.0
    deviation = np.sqrt(spread)
    if deviation <= _NARROW:
        places, width, logs = np.zeros(1), 1.0, np.zeros(1)
    else:
        places = np.linspace(-_RANGE, _RANGE, _COUNT)
        width = _WIDTH * (places[1] - places[0])
        logs = -0.5 * places**2 / (1.0 - width**2)
        logs -= np.log(np.sum(np.exp(logs)))
    parts = []
    for place, log in zip(places, logs, strict=True):
        logarithm, own = place * deviation - 0.5 * spread, width**2 * spread
        mass = scale * np.exp(logarithm + 0.5 * own)
        along = np.append(slope * mass, 1.0)
        covariance = own * np.outer(along, along)
        covariance[:-1, :-1] += rest
        state = x[:-1] + slope * (mass - mean)
        parts.append(Hypothesis(np.append(state, logarithm), covariance, float(log)))
    return scale, parts


def widest_single(mean: float) -> float:
    """Return the standard deviation (kg) of a mass up to which ``split`` returns one Gaussian."""
    return mean * float(np.sqrt(np.expm1(_NARROW**2)))


def reduced(parts: list[Hypothesis]) -> list[Hypothesis]:
    """Drop unlikely Gaussians, merge close ones, and normalise the weights to a sum of one."""
    logs = np.array([part.log_weight for part in parts])
    logs -= np.logaddexp.reduce(logs)
    kept: list[Hypothesis] = []
    for k in sorted(range(len(parts)), key=lambda k: float(parts[k].x[-1])):
        parts[k].log_weight = float(logs[k])
        if logs[k] > np.log(_LEAST):
            kept.append(parts[k])
    for left, right in pairwise(list(kept)):
        nearest = _CLOSE * np.sqrt(min(left.P[-1, -1], right.P[-1, -1]))
        if right.x[-1] - left.x[-1] < nearest:
            mean, covariance = combined([left, right], [left.x, right.x], [left.P, right.P])
            right.x, right.P = mean, covariance
            right.log_weight = float(np.logaddexp(left.log_weight, right.log_weight))
            kept = [part for part in kept if part is not left]
    return kept


def combined(
    parts: list[Hypothesis], means: list[FloatArray], covariances: list[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the mean and covariance of a mixture of Gaussians with the weights of ``parts``."""
    if len(parts) == 1:
        return means[0].copy(), covariances[0].copy()
    weights = np.exp([part.log_weight for part in parts])
    weights /= np.sum(weights)
    mean = weights @ np.array(means)
    apart = np.array(means) - mean
    covariance = np.einsum("k,kij->ij", weights, np.array(covariances))
    return mean, covariance + (apart.T * weights) @ apart


def moments(parts: list[Hypothesis], scale: float, own: float) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance of [state, payload], kg; ``own`` is subtracted from the mass."""
    means, covariances = [], []
    for part in parts:
        x, P = part.x.copy(), part.P.copy()
        x[-1] = scale * np.exp(x[-1] + 0.5 * P[-1, -1])
        relative = np.expm1(P[-1, -1])
        P[:-1, -1] *= x[-1]
        P[-1, :-1] *= x[-1]
        P[-1, -1] = relative * x[-1] ** 2
        x[-1] = max(x[-1] - own, 0.0)
        means.append(x)
        covariances.append(P)
    return combined(parts, means, covariances)


class KalmanFilter(StateEstimator):
    """Base of the Kalman filters: a sum of Gaussians, each propagated and corrected alone.

    A filter defines ``_propagate`` and ``_update``. The payload is a sum of Gaussians over the
    logarithm of the payload mass plus the effective mass of the tip, the last number of each.
    """

    _changing = ("_parts",)

    def __post_init__(self) -> None:
        self._own = tip_mass(self.arm)
        super().__post_init__()

    def _start(self, x: FloatArray, covariance: FloatArray) -> None:
        assert self._step is not None
        self._model = ArmModel(self._step, self._layout, self._noise, self._walk, self._mass)
        self._scale, parts = split(x + self._own * np.eye(x.size)[-1], covariance)  # kg
        self._parts = [part for part in parts if self._moving(part.x) >= self._own] or parts
        self._stay()

    def _stay(self) -> None:
        for part in self._parts:
            part.moved = np.zeros((part.x.size, self.arm.n_joints))

    def _correct(self, seen: PredictedReadings, readings: FloatArray) -> float:
        # The innovation test needs the weights of the hypotheses before the update changes them.
        before = [replace(part) for part in self._parts]
        predicted, expected = [], []
        for part in self._parts:
            values, S = self._update(part, seen, readings)
            predicted.append(values)
            expected.append(S)
            factor = linalg.cho_factor(S)
            missed = readings - values
            part.log_weight -= 0.5 * float(missed @ linalg.cho_solve(factor, missed))
            part.log_weight -= float(np.sum(np.log(np.diag(factor[0]))))
        mean, covariance = combined(before, predicted, expected)
        self._parts = reduced(self._parts)
        self._stay()
        return squared_innovation(readings - mean, covariance)

    def _predict(self) -> None:
        for part in self._parts:
            self._propagate(part)

    @abstractmethod
    def _propagate(self, part: Hypothesis) -> None:
        """Carry a hypothesis to the next sample."""

    @abstractmethod
    def _update(self, part: Hypothesis, seen: PredictedReadings, readings: FloatArray) -> Predicted:
        """Correct a hypothesis; return its predicted readings and their covariance."""

    def _add_drift(self, part: Hypothesis) -> None:
        """Add the random walks over a sample to the covariance."""
        part.P[np.diag_indices_from(part.P)] += self._walk
        if self.payload_drift:
            wandered = self.payload_drift**2 * self.sample_time
            part.P[-1, -1] += np.log1p(wandered / self._moving(part.x) ** 2)

    def _moments(self) -> tuple[FloatArray, FloatArray]:
        return moments(self._parts, self._scale, self._own)

    def _moving(self, x: FloatArray) -> float:
        """Return the mass (kg) whose logarithm is estimated: payload plus effective tip mass."""
        return self._scale * float(np.exp(x[-1]))

    def _mass(self, x: FloatArray) -> tuple[float, float]:
        """Return the mass of the payload, and its derivative by its logarithm, kg."""
        moving = self._moving(x)
        return max(moving - self._own, 0.0), moving


#: Number of linearisations in an update by readings that are not linear in the state.
_ITERATIONS = 3
#: Predicted readings and their covariance.
Predicted = tuple[FloatArray, FloatArray]


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

    def _propagate(self, part: Hypothesis) -> None:
        link = self._model.carry(part.x, self._torque, np.zeros(self.arm.n_joints))
        part.x, part.P, part.moved = link.after, propagated(part.P, link), link.G
        self._add_drift(part)

    def _update(self, part: Hypothesis, seen: PredictedReadings, readings: FloatArray) -> Predicted:
        none = np.zeros(self.arm.n_joints)
        constants = np.eye(part.x.size), np.diag(seen.variance)
        part.x, part.P, *predicted = corrected(
            lambda x: self._model.observe(seen, x, self._torque, none),
            *(readings, part.x, part.P, part.moved, *constants, linearisations(seen)),
        )
        return predicted[0], predicted[1]


def propagated(P: Matrix, link: Link) -> Matrix:
    """Return the covariance (s, s) after a sample, without random walks."""
    return link.F @ P @ link.F.T + link.G @ link.G.T


def _solved(A: Matrix, B: Matrix) -> Matrix:
    return linalg.cho_solve(linalg.cho_factor(A), B)


def linearisations(seen: PredictedReadings) -> int:
    """Return the number of linearisations in an update."""
    return 1 if seen.linear else _ITERATIONS


def corrected(
    observe: Callable[[Matrix], Readings],
    readings: Matrix, before: Matrix, P: Matrix, moved: Matrix, unit: Matrix, noise: Matrix,
    iterations: int, solved: Callable[[Matrix, Matrix], Matrix] = _solved,
) -> tuple[Matrix, Matrix, Matrix, Matrix]:  # fmt: skip
    """Return mean and covariance after readings, and the prediction of these with its covariance.

    ``before``, ``P`` and ``moved`` are those of a `Hypothesis`, ``unit`` (n, n) is the identity,
    ``noise`` (k, k) the covariance of the instruments; ``solved`` solves A X = B for A > 0.
    """
    x = before
    for iteration in range(iterations):
        values, H, felt = observe(x)
        S, R, N = innovation_covariance(P, moved, H, felt, noise)
        K = solved(S, (P @ H.T + N).T).T
        expected = values + H @ (before - x)
        if iteration == 0:
            predicted, deviation = expected, S
        x = before + K @ (readings - expected)
    left = unit - K @ H
    # The Joseph form keeps the covariance symmetric and positive despite rounding.
    both = left @ N @ K.T
    return x, left @ P @ left.T + K @ R @ K.T - both - both.T, predicted, deviation


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

    not_exported: ClassVar[str] = "An unscented filter needs eigenvectors at every sample."

    def _propagate(self, part: Hypothesis) -> None:
        joints = self.arm.n_joints
        points = _sigma_points(part.x, part.P, np.zeros((part.x.size, joints)))
        before, errors = points[:, :-joints], points[:, -joints:]
        after = before.copy()
        states = self._layout.states
        for old, error, new in zip(before, errors, after, strict=True):
            torque = self._layout.acting(old, self._torque) + self._noise * error
            new[states] = self._model.step.advance(old[states], torque, self._model.changes(old))
        part.x, part.P = _mean(after), _covariance(after, after)
        self._add_drift(part)
        part.moved = _covariance(after, errors)

    def _update(self, part: Hypothesis, seen: PredictedReadings, readings: FloatArray) -> Predicted:
        joints = self.arm.n_joints
        # Accelerometers measure the error of the torque that has changed the state.
        points = _sigma_points(part.x, part.P, part.moved)
        states, outputs = points[:, :-joints], np.zeros((len(points), seen.size))
        for k, (x, error) in enumerate(zip(states, points[:, -joints:], strict=True)):
            torque = self._layout.acting(x, self._torque) + self._noise * error
            constants = self._model.step.free.at(self._model.changes(x))
            outputs[k] = seen.values(x[self._layout.states], torque, constants)
            outputs[k] += seen.bias @ x[self._layout.biases]
        predicted = _mean(outputs)
        S = _covariance(outputs, outputs) + np.diag(seen.variance)
        K = _solved(S, _covariance(states, outputs).T).T
        part.x = part.x + K @ (readings - predicted)
        part.P = part.P - K @ S @ K.T
        part.P = 0.5 * (part.P + part.P.T)
        return predicted, S


def _sigma_points(x: FloatArray, P: FloatArray, with_errors: FloatArray) -> FloatArray:
    """Return the sigma points (2 n + 1, n) of a state and the torque errors, the mean first."""
    joints = with_errors.shape[1]
    whole = np.block([[P, with_errors], [with_errors.T, np.eye(joints)]])
    roots = square_root(whole)
    mean = np.concatenate([x, np.zeros(joints)])
    apart = np.sqrt(mean.size) * roots.T
    return np.vstack([mean, mean + apart, mean - apart])


def square_root(covariance: FloatArray) -> FloatArray:
    """Return a matrix whose product with its transpose is a covariance, which may be singular."""
    # Variances differ by many orders of magnitude, and some may be zero.
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(deviation > 0.0, deviation, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray((deviation[:, None] * vectors) * np.sqrt(np.maximum(values, 0.0)))


def _mean(points: FloatArray) -> FloatArray:
    """Return the mean of sigma points; the central one has no weight."""
    # Relative to it, because numbers that are the same in all points must stay exact.
    return np.asarray(points[0] + (points[1:] - points[0]).mean(axis=0))


def _covariance(points: FloatArray, others: FloatArray) -> FloatArray:
    """Return the covariance of two functions of the same sigma points."""
    a, b = points - _mean(points), others - _mean(others)
    return np.asarray(a[1:].T @ b[1:] / (len(points) - 1) + _BETA * np.outer(a[0], b[0]))
