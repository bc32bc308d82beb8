"""Statistics of a fit: fit in percent, tests of residuals, covariance, directions without effect.

Ljung, *System Identification*, 2nd ed., 1999, sections 9 (covariance) and 16.6 (tests); Ljung and
Box, Biometrika 65 (1978) 297; for coloured residuals Morelli and Klein, Journal of Guidance,
Control, and Dynamics 20 (1997) 155, with the lag chosen as in Politis, Journal of Nonparametric
Statistics 15 (2003) 661.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.integrate.base import FloatArray

#: Lags of the tests of residuals.
LAGS = 20
#: Longest lag of the correlation of residuals, as a fraction of the record.
_LONGEST = 0.1
#: Relative standard deviation of a combination of parameters above which the data do not determine
#: it, and the smallest singular value, as a fraction of the largest, that is not rounding.
UNDETERMINED, _ROUNDING = 0.5, 1e-6
#: Components of such a combination that are named, as a fraction of its largest one.
_NAMED = 0.02


def fit_percent(measured: FloatArray, simulated: FloatArray) -> float:
    """Return 100 (1 - |y - s| / |y - mean y|): 100 is perfect, 0 as good as the mean."""
    spread = float(np.linalg.norm(measured - measured.mean()))
    error = float(np.linalg.norm(measured - simulated))
    return 100.0 * (1.0 - error / spread) if spread > 0.0 else (100.0 if error == 0.0 else -np.inf)


def correlation_of(residuals: FloatArray, lags: int) -> FloatArray:
    """Return the covariances (lags + 1,) of residuals (samples,) with zeros where missing."""
    from scipy.signal import correlate

    full = correlate(residuals, residuals, method="fft")
    middle = residuals.size - 1
    return np.asarray(full[middle : middle + lags + 1]) / residuals.size


def whiteness(residuals: FloatArray, lags: int = LAGS) -> float:
    """Return the probability of correlations as large as those of residuals, if they were white.

    The test of Ljung and Box; below 0.01 the residuals contain something that the model lacks.
    """
    from scipy.stats import chi2

    count = residuals.size
    lags = min(lags, max(1, count // 4))
    covariance = correlation_of(residuals - residuals.mean(), lags)
    if covariance[0] == 0.0:
        return 1.0
    rho = covariance[1:] / covariance[0]
    statistic = count * (count + 2) * float(np.sum(rho**2 / (count - np.arange(1, lags + 1))))
    return float(chi2.sf(statistic, lags))


def independence(residuals: FloatArray, signal: FloatArray, lags: int = LAGS) -> float:
    """Return the probability of correlations as large as those between residuals and an input.

    Residuals that depend on past inputs (0 to ``lags`` samples) give a small value.
    """
    from scipy.stats import chi2

    residuals, signal = residuals - residuals.mean(), signal - signal.mean()
    scale = float(np.mean(residuals**2))
    if scale == 0.0 or not np.any(signal):
        return 1.0
    lags = min(lags, max(1, signal.size // 4))
    past = np.stack([np.concatenate([np.zeros(k), signal[: signal.size - k]]) for k in range(lags)])
    values, vectors = np.linalg.eigh(past @ past.T / signal.size)
    kept = values > 1e-6 * values[-1]  # neighbours of a smooth input are nearly equal
    crossed = vectors[:, kept].T @ (past @ residuals) / signal.size
    statistic = signal.size * float(np.sum(crossed**2 / values[kept])) / scale
    return float(chi2.sf(statistic, int(kept.sum())))


class Column(NamedTuple):
    """Residuals of one channel of a record, weighted, and their derivatives.

    Attributes:
        residuals: (samples,), zero where missing.
        derivatives: (samples, parameters) of the residuals, zero where missing.
    """

    residuals: FloatArray
    derivatives: FloatArray


def information(columns: Sequence[Column]) -> FloatArray:
    """Return the sum of products of derivatives, (parameters, parameters)."""
    total = sum(column.derivatives.T @ column.derivatives for column in columns)
    return np.asarray(total)


def coloured_information(columns: Sequence[Column]) -> FloatArray:
    """Return the covariance of the gradient of the fit with residuals that are not white.

    For white residuals it equals ``information``.
    """
    from scipy.signal import fftconvolve

    total = np.zeros((columns[0].derivatives.shape[1],) * 2)
    for residuals, derivatives in columns:
        lag = significant_lag(residuals)
        covariance = correlation_of(residuals, lag)
        window = 1.0 - np.arange(lag + 1) / (lag + 1.0)
        covariance = covariance * window / covariance[0] if covariance[0] > 0.0 else np.eye(1)[0]
        kernel = np.concatenate([covariance[:0:-1], covariance])[:, None]
        smooth = fftconvolve(derivatives, kernel, mode="same", axes=0) if lag else derivatives
        total += derivatives.T @ smooth
    return 0.5 * (total + total.T)


def significant_lag(residuals: FloatArray) -> int:
    """Return twice the lag after which residuals are not correlated significantly; 0 if white."""
    count = residuals.size
    longest = max(1, int(_LONGEST * count))
    covariance = correlation_of(residuals - residuals.mean(), longest)
    if covariance[0] == 0.0:
        return 0
    limit = 2.0 * np.sqrt(np.log10(count) / count)
    following = max(5, int(np.sqrt(np.log10(count))))
    large = np.abs(covariance[1:]) > limit * covariance[0]
    run = 0
    for lag, one in enumerate(large, start=1):
        run = 0 if one else run + 1
        if run == following:
            return 2 * (lag - following)
    return longest


def covariance_of(columns: Sequence[Column], priors: FloatArray) -> FloatArray:
    """Return the covariance of the estimates.

    Args:
        priors: (parameters,) information of priors: one over their variances, or zero.

    A direction without information has a very large variance instead of an infinite one.
    """
    curvature = information(columns) + np.diag(priors)
    middle = coloured_information(columns) + np.diag(priors)
    scale = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    inverse = np.linalg.pinv(curvature / np.outer(scale, scale), rcond=1e-14, hermitian=True)
    inverse = inverse / np.outer(scale, scale)
    return np.asarray(inverse @ middle @ inverse)


def undetermined(
    columns: Sequence[Column],
    priors: FloatArray,
    scale: FloatArray,
    physical: NDArray[np.bool_],
) -> list[tuple[list[int], float]]:
    """Return the combinations of parameters that the data do not determine.

    Args:
        priors: as for ``covariance_of``; those of the physical parameters are not used.
        scale: (parameters,) changes that count as 100 %.
        physical: (parameters,) whether a number is a parameter, not part of an initial state.

    Returns:
        The places of the parameters of each combination, the most important one first, and the
        relative standard deviation of the combination, at least 0.5.
    """
    scaled = information(columns) * np.outer(scale, scale)
    others = ~physical
    own = scaled[np.ix_(physical, physical)]
    if others.any():
        inner = scaled[np.ix_(others, others)] + np.diag(priors[others] * scale[others] ** 2)
        mixed = scaled[np.ix_(others, physical)]
        own = own - mixed.T @ np.linalg.pinv(inner, hermitian=True) @ mixed
    values, vectors = np.linalg.eigh(own)
    values = np.sqrt(np.maximum(values, 0.0))
    weak = (values * UNDETERMINED < 1.0) | (values <= _ROUNDING * values[-1])
    places = np.flatnonzero(physical)
    found = []
    for vector in _sparse(vectors[:, weak].T):
        order = np.argsort(-np.abs(vector))
        named = [int(places[k]) for k in order if abs(vector[k]) > _NAMED * np.abs(vector).max()]
        share = np.sqrt(max(vector @ own @ vector, 0.0)) / np.linalg.norm(vector)
        found.append((named, float(1.0 / share) if share > 0.0 else np.inf))
    return found


def _sparse(vectors: FloatArray) -> FloatArray:
    """Return other vectors (k, n) that span the same space, with as many zeros as possible.

    Gauss and Jordan's elimination with the largest pivots: separate causes become separate vectors.
    """
    vectors = vectors.copy()
    for row in range(len(vectors)):
        rest = np.abs(vectors[row:])
        pivot, column = np.unravel_index(int(np.argmax(rest)), rest.shape)
        swapped = [row + int(pivot), row]
        vectors[swapped[::-1]] = vectors[swapped]
        vectors[row] /= vectors[row, column]
        others = np.arange(len(vectors)) != row
        vectors[others] -= np.outer(vectors[others, column], vectors[row])
    return vectors
