"""Distribution of states and of an unknown mass, as a sum of Gaussians over its logarithm.

If rates and bending are as uncertain as they are large, their product with an unknown mass is far
from linear, and the mass estimate of a single Gaussian follows its linearisation errors. In each
Gaussian of the sum the mass is certain enough for linear theory, and the readings update the
weights of the Gaussians.

References:
    D. L. Alspach and H. W. Sorenson, IEEE Trans. Automatic Control 17 (1972) 439-448.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

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
    """Gaussian over [state, log(mass / scale)]: mean (n + 1,), covariance and log weight."""

    x: FloatArray
    P: FloatArray
    log_weight: float


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
