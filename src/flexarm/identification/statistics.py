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
#: Smallest eigenvalue of the normalised information that counts, as a fraction of the largest.
_SINGULAR = 1e-14
#: Components of such a combination that are named, as a fraction of its largest one.
_NAMED = 0.02


def fit_percent(measured: FloatArray, simulated: FloatArray) -> float:
    """Return 100 (1 - |y - s| / |y - mean y|): 100 is perfect, 0 as good as the mean."""
    signal = float(np.linalg.norm(measured - measured.mean()))
    error = float(np.linalg.norm(measured - simulated))
    return 100.0 * (1.0 - error / signal) if signal > 0.0 else (100.0 if error == 0.0 else -np.inf)


class Column(NamedTuple):
    """Residuals of one channel of a record, weighted, and their derivatives."""

    residuals: FloatArray  # (samples,), zero where missing
    derivatives: FloatArray  # (samples, parameters) of the residuals, zero where missing
    valid: NDArray[np.bool_]  # (samples,) whether the record has the sample


def pair_sums(values: FloatArray, lags: int) -> FloatArray:
    """Return the sums (lags + 1,) of products of values (samples,) at a distance of each lag."""
    from scipy.signal import correlate

    full = correlate(values, values, method="fft")
    return np.asarray(full[values.size - 1 : values.size + lags])


def correlation_of(
    residuals: FloatArray, valid: NDArray[np.bool_], lags: int
) -> tuple[FloatArray, FloatArray]:
    """Return correlations (lags + 1,) of residuals (samples,), and the pairs of valid samples.

    The residuals are zero where missing. Each covariance is the mean over the pairs of its lag; a
    lag without pairs has the correlation zero.
    """
    pairs = np.rint(pair_sums(valid.astype(np.float64), lags))
    covariance = pair_sums(residuals, lags) / np.maximum(pairs, 1.0)
    if covariance[0] <= 0.0:
        return np.eye(1, lags + 1)[0], pairs
    return np.where(pairs > 0.0, covariance / covariance[0], 0.0), pairs


def centred(values: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Return values minus the mean of the valid ones, zero where not valid."""
    return np.where(valid, values - values[valid].mean(), 0.0)


def whiteness(residuals: FloatArray, valid: NDArray[np.bool_], lags: int = LAGS) -> float:
    """Return the probability of correlations as large as those of residuals, if they were white.

    The test of Ljung and Box; below 0.01 the residuals contain something that the model lacks. NaN
    without residuals. ``valid`` (samples,) states whether the record has the sample.
    """
    from scipy.stats import chi2

    count = int(valid.sum())
    if not np.any(residuals):
        return np.nan
    lags = min(lags, max(1, count // 4))
    rho, pairs = correlation_of(centred(residuals, valid), valid, lags)
    statistic = (count + 2) / count * float(np.sum(pairs[1:] * rho[1:] ** 2))
    return float(chi2.sf(statistic, np.count_nonzero(pairs[1:])))


def independence(
    residuals: FloatArray, valid: NDArray[np.bool_], signal: FloatArray, lags: int = LAGS
) -> float:
    """Return the probability of correlations as large as those between residuals and an input.

    Residuals that depend on past inputs (0 to ``lags`` samples) give a small value, residuals that
    are correlated over time for another reason do not. NaN without residuals or input.
    """
    from scipy.stats import chi2

    residuals, signal = centred(residuals, valid), signal - signal.mean()
    scale = float(np.sum(residuals**2)) / int(valid.sum())
    if scale == 0.0 or not np.any(signal):
        return np.nan
    lags = min(lags, max(1, signal.size // 4))
    past = np.stack([np.concatenate([np.zeros(k), signal[: signal.size - k]]) for k in range(lags)])
    column = Column(residuals, (past * valid).T, valid)
    values, vectors = np.linalg.eigh(information([column]))
    vectors = vectors[
        :, values > 1e-6 * values[-1]
    ]  # neighbours of a smooth input are nearly equal
    crossed = vectors.T @ (past @ residuals)
    expected = scale * vectors.T @ coloured_information([column]) @ vectors
    statistic = float(crossed @ np.linalg.pinv(expected, hermitian=True) @ crossed)
    return float(chi2.sf(statistic, crossed.size))


def cross_correlation(
    residuals: FloatArray, valid: NDArray[np.bool_], signal: FloatArray, lags: int = LAGS
) -> tuple[FloatArray, float]:
    """Return correlations (lags + 1,) of residuals with a signal, and their standard deviation.

    The deviation is that without a relation, with the correlation over time of both. At lag k the
    signal is that of k samples before.
    """
    residuals, signal = centred(residuals, valid), signal - signal.mean()
    size = float(np.linalg.norm(residuals) * np.linalg.norm(signal))
    if size == 0.0:
        return np.zeros(lags + 1), 1.0 / np.sqrt(valid.sum())
    count = residuals.size
    crossed = np.array([residuals[k:] @ signal[: count - k] for k in range(lags + 1)]) / size
    every = np.ones(count, dtype=bool)
    longest = max(1, count // 4)
    own, _ = correlation_of(residuals, valid, longest)
    driven, _ = correlation_of(signal, every, longest)
    power = 1.0 + 2.0 * float(own[1:] @ driven[1:])
    return crossed, float(np.sqrt(max(power, 1.0) / valid.sum()))


def information(columns: Sequence[Column]) -> FloatArray:
    """Return the sum of products of derivatives, (parameters, parameters)."""
    total = sum(column.derivatives.T @ column.derivatives for column in columns)
    return np.asarray(total)


def coloured_information(columns: Sequence[Column]) -> FloatArray:
    """Return the covariance of the fit's gradient; ``information`` if the residuals are white."""
    from scipy.signal import fftconvolve

    total = np.zeros((columns[0].derivatives.shape[1],) * 2)
    for residuals, derivatives, valid in columns:
        lag = significant_lag(residuals, valid)
        rho, _ = correlation_of(residuals, valid, lag)
        rho = rho * (1.0 - np.arange(lag + 1) / (lag + 1.0))
        kernel = np.concatenate([rho[:0:-1], rho])[:, None]
        smooth = fftconvolve(derivatives, kernel, mode="same", axes=0) if lag else derivatives
        total += derivatives.T @ smooth
    return 0.5 * (total + total.T)


def significant_lag(residuals: FloatArray, valid: NDArray[np.bool_]) -> int:
    """Return twice the lag after which residuals are not correlated significantly; 0 if white."""
    count = int(valid.sum())
    longest = max(1, int(_LONGEST * count))
    rho, _ = correlation_of(centred(residuals, valid), valid, longest)
    limit = 2.0 * np.sqrt(np.log10(count) / count)
    following = max(5, int(np.sqrt(np.log10(count))))
    large = np.abs(rho[1:]) > limit
    run = 0
    for lag, one in enumerate(large, start=1):
        run = 0 if one else run + 1
        if run == following:
            return 2 * (lag - following)
    return longest


def covariance_of(columns: Sequence[Column], priors: FloatArray) -> FloatArray:
    """Return the covariance of the estimates; ``priors`` (parameters,) are inverse variances.

    A parameter without information has an infinite variance, and a combination of others without
    information a very large one.
    """
    curvature = information(columns) + np.diag(priors)
    known = np.diag(curvature) > 0.0
    covariance = np.diag(np.where(known, 0.0, np.inf))
    part = np.ix_(known, known)
    if known.any():
        coloured = (coloured_information(columns) + np.diag(priors) - curvature)[part]
        scale = np.outer(*(2 * [np.sqrt(np.diag(curvature)[known])]))
        values, vectors = np.linalg.eigh(curvature[part] / scale)
        inverse = (vectors / np.maximum(values, _SINGULAR * values[-1])) @ vectors.T / scale
        # The sum equals the usual product for residuals that are not white, but it does not lose
        # the variance of combinations whose curvature is zero.
        total = inverse + inverse @ coloured @ inverse
        # Derivatives that are only rounding may give a negative variance.
        lost = np.diag(total) <= 0.0
        total[lost], total[:, lost] = inverse[lost], inverse[:, lost]
        covariance[part] = total
    return covariance


def own_information(
    columns: Sequence[Column],
    priors: FloatArray,
    scale: FloatArray,
    physical: NDArray[np.bool_],
) -> FloatArray:
    """Return the information about the physical parameters, relative to their scales.

    The arguments are those of ``undetermined``. The other numbers, of initial states, are
    eliminated: the inverse is the covariance of the physical ones without their priors.
    """
    scaled = information(columns) * np.outer(scale, scale)
    others = ~physical
    own = scaled[np.ix_(physical, physical)]
    if not others.any():
        return own
    inner = scaled[np.ix_(others, others)] + np.diag(priors[others] * scale[others] ** 2)
    mixed = scaled[np.ix_(others, physical)]
    return np.asarray(own - mixed.T @ np.linalg.pinv(inner, hermitian=True) @ mixed)


def undetermined(
    columns: Sequence[Column],
    priors: FloatArray,
    scale: FloatArray,
    physical: NDArray[np.bool_],
) -> list[tuple[list[int], float]]:
    """Return the combinations of parameters that the data do not determine.

    The criterion is the relative standard deviation of ``covariance_of``, without the priors of
    the physical parameters; ``scale`` (parameters,) counts as 100 %, and initial states are not
    ``physical``. A combination has the places of its parameters, the most important one first, and
    its relative standard deviation, at least 0.5.
    """
    places = np.flatnonzero(physical)
    covariance = covariance_of(columns, np.where(physical, 0.0, priors))[np.ix_(places, places)]
    covariance = covariance / np.outer(scale[places], scale[places])
    lost = ~np.isfinite(np.diag(covariance))
    covariance[lost] = covariance[:, lost] = 0.0

    def deviations(vectors: FloatArray) -> FloatArray:
        """Return the standard deviations (k,) of combinations, the columns (n, k) of an array."""
        squares = np.sum(vectors * (covariance @ vectors), axis=0)
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)))

    own = own_information(columns, priors, scale, physical)
    values, vectors = np.linalg.eigh(own)
    values = np.sqrt(np.maximum(values, 0.0))
    weak = (deviations(vectors) > UNDETERMINED) | (values <= _ROUNDING * values[-1])
    combinations = list(_sparse(vectors[:, weak].T))
    # A single parameter may be uncertain although no eigenvector is.
    alone = np.eye(places.size)[deviations(np.eye(places.size)) > UNDETERMINED]
    combinations += [unit for unit in alone if not np.any(unit @ vectors[:, weak])]
    named = []
    for vector in combinations:
        order = np.argsort(-np.abs(vector))
        most = _NAMED * np.abs(vector).max()
        involved = [int(k) for k in order if abs(vector[k]) > most]
        deviation = float(deviations(vector[:, None])[0] / np.linalg.norm(vector))
        hidden = lost[involved].any() or deviation == 0.0
        named.append(([int(places[k]) for k in involved], np.inf if hidden else deviation))
    return named


def _sparse(vectors: FloatArray) -> FloatArray:
    """Return vectors (k, n) of the same space with many zeros, by Gauss and Jordan."""
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
