"""Kalman filter along a linear time-varying model, for several noise intensities at once.

Innovations and their likelihood: Ljung, *System Identification*, 2nd ed., 1999, section 7.4;
Kristensen, Madsen and Jorgensen, Automatica 40 (2004) 225.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.integrate.base import FloatArray

#: Range of estimated intensities, as factors on their scales, and their relative step for slopes.
_LEAST, _MOST, _STEP = 1e-5, 1e3, 1e-4
#: Largest change of the logarithms in a search, and most searches.
_BOX, _BOXES = 1.5, 12
#: Most iterations of the search for intensities, and the cost of those that have no filter.
_ITERATIONS, _IMPOSSIBLE = 60, 1e30


class LinearModel(NamedTuple):
    """Model of a record about a trajectory.

    State after a sample: ``F[k] x + G[k] w + b[k]``, with torque errors w (joints,) of standard
    deviation 1. Readings: ``H x``.
    """

    F: FloatArray  # (samples - 1, n, n)
    G: FloatArray  # (samples - 1, n, joints)
    b: FloatArray  # (samples - 1, n)
    H: FloatArray  # (channels, n)
    start: FloatArray  # (n,)
    P: FloatArray  # (n, n) covariance of the start


class Gains(NamedTuple):
    """Gains of a filter along a record."""

    K: FloatArray  # (samples, n, channels)
    whitening: FloatArray  # (samples, channels, channels): deviations of innovations become one
    cost: float  # sum of the logarithms of the deviations


class Update(NamedTuple):
    """Correction by the readings of one sample, for m intensities."""

    K: FloatArray  # (m, n, channels)
    factor: FloatArray  # (m, channels, channels), of Cholesky, of the innovations' covariance
    P: FloatArray  # (m, n, n) after the correction


def corrected(P: FloatArray, H: FloatArray, noise: FloatArray, valid: NDArray[np.bool_]) -> Update:
    """Return the correction of covariances (m, n, n) by readings with deviations ``noise``.

    Args:
        H: (channels, n)
        noise: (m, channels)
        valid: (channels,) whether a reading exists; the others have no effect.
    """
    noise = np.where(valid, noise, 1.0)
    # Readings in their own deviations, because rows of angles and strains differ by many digits.
    rows = H * valid[:, None] / noise[:, :, None]
    seen = rows @ P
    S = np.eye(len(H)) + seen @ np.swapaxes(rows, 1, 2)
    K = np.swapaxes(np.linalg.solve(S, seen), 1, 2)
    left = np.eye(P.shape[1]) - K @ rows
    # The Joseph form keeps the covariance symmetric and positive despite rounding.
    after = left @ P @ np.swapaxes(left, 1, 2) + K @ np.swapaxes(K, 1, 2)
    return Update(K / noise[:, None, :], noise[:, :, None] * np.linalg.cholesky(S), after)


def likelihoods(
    model: LinearModel,
    measured: FloatArray,
    valid: NDArray[np.bool_],
    torque_noise: FloatArray,
    noise: FloatArray,
) -> FloatArray:
    """Return minus the logarithms (m,) of the likelihoods, without constants.

    Args:
        measured, valid: (samples, channels)
        torque_noise: (m, joints), N m
        noise: (m, channels)
    """
    m, (samples, _) = len(noise), measured.shape
    x, P = np.tile(model.start, (m, 1)), np.tile(model.P, (m, 1, 1))
    total = np.zeros(m)
    for k in range(samples):
        found = corrected(P, model.H, noise, valid[k])
        missed = np.where(valid[k], measured[k] - x @ model.H.T, 0.0)
        white = np.linalg.solve(found.factor, missed[..., None])[..., 0]
        total += 0.5 * np.sum(white**2, axis=1)
        total += np.sum(np.log(np.diagonal(found.factor, axis1=1, axis2=2)), axis=1)
        if k == samples - 1:
            break
        x = x + (found.K @ missed[..., None])[..., 0]
        x = x @ model.F[k].T + model.b[k]
        moved = model.G[k] * torque_noise[:, None, :]
        P = model.F[k] @ found.P @ model.F[k].T + moved @ np.swapaxes(moved, 1, 2)
    return total


def gains_of(
    model: LinearModel, valid: NDArray[np.bool_], torque_noise: FloatArray, noise: FloatArray
) -> Gains:
    """Return the gains along a record for one pair of intensities (joints,) and (channels,)."""
    samples, channels = valid.shape
    K = np.zeros((samples, model.start.size, channels))
    whitening = np.zeros((samples, channels, channels))
    P, cost = model.P[None], 0.0
    for k in range(samples):
        found = corrected(P, model.H, noise[None], valid[k])
        K[k], whitening[k] = found.K[0], np.linalg.inv(found.factor[0])
        cost += float(np.sum(np.log(np.diagonal(found.factor[0]))))
        if k < samples - 1:
            moved = model.G[k] * torque_noise
            P = model.F[k] @ found.P @ model.F[k].T + moved @ moved.T
    return Gains(K, whitening, cost)


def most_likely(
    cost: Callable[[FloatArray], FloatArray], start: FloatArray, scale: FloatArray
) -> FloatArray:
    """Return the positive intensities (p,) with the least cost.

    Args:
        cost: of intensities (m, p): (m,).
        start: (p,)
        scale: (p,) typical values.
    """
    from scipy.optimize import minimize

    count = start.size
    steps = _STEP * np.concatenate([np.zeros((1, count)), np.eye(count), -np.eye(count)])

    def value(logs: FloatArray) -> tuple[float, FloatArray]:
        try:
            found = cost(np.exp(logs + steps) * scale)
        except np.linalg.LinAlgError:  # readings without noise, predicted in one direction only
            return _IMPOSSIBLE, np.zeros(count)
        return float(found[0]), (found[1 : count + 1] - found[count + 1 :]) / (2.0 * _STEP)

    logs = np.clip(np.log(start / scale), np.log(_LEAST), np.log(_MOST))
    for _ in range(_BOXES):
        # The cost is convex near its minimum only, where large steps go astray.
        low = np.maximum(logs - _BOX, np.log(_LEAST))
        high = np.minimum(logs + _BOX, np.log(_MOST))
        bounds = list(zip(low.tolist(), high.tolist(), strict=True))
        options = {"maxiter": _ITERATIONS, "ftol": 1e-9}
        found = minimize(value, logs, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        moved, logs = np.abs(found.x - logs), found.x
        if np.all(moved < 0.99 * _BOX):
            break
    return np.asarray(np.exp(logs) * scale)
