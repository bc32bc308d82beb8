"""Statistics of fits: percent, tests of residuals, covariance, what the data do not determine.

Ljung, *System Identification*, 2nd ed., 1999, sections 9 (covariance) and 16.6 (tests); Ljung and
Box, Biometrika 65 (1978) 297; for coloured residuals Morelli and Klein, Journal of Guidance,
Control, and Dynamics 20 (1997) 155, with the lag chosen as in Politis, Journal of Nonparametric
Statistics 15 (2003) 661; for blocks Kunsch, Annals of Statistics 17 (1989) 1217.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.base.errors import AccuracyWarning, warn_caller
from flexarm.integrate.base import FloatArray

#: Lags of the tests of residuals.
LAGS = 20
#: Longest lag of the correlation of residuals, as a fraction of the record.
_LONGEST = 0.1
#: Relative standard deviation above which the data do not determine a parameter.
UNDETERMINED = 0.5
#: Smallest eigenvalue of the normalised information that counts, as a fraction of the largest.
_SINGULAR = 1e-14
#: Components of a combination that are named, as a fraction of its largest one: relative to the
#: parameters, and to their deviations, in which those of a sum are equal.
_NAMED, _EQUAL = 0.02, 0.5
#: Blocks of all records together, and the least information without a block, as a fraction.
_BLOCKS, _LEFT = 8, 0.1
#: Least factor on a variance by the correlation of residuals, which rounding may make negative.
_ROUNDED = 0.1


def fit_percent(measured: FloatArray, simulated: FloatArray) -> float:
    """Return 100 (1 - |y - s| / |y - mean y|): 100 is perfect, 0 as good as the mean."""
    signal = float(np.linalg.norm(measured - measured.mean()))
    error = float(np.linalg.norm(measured - simulated))
    return 100.0 * (1.0 - error / signal) if signal > 0.0 else (100.0 if error == 0.0 else -np.inf)


def warn_of_fits(fits: Mapping[str, float], least: float, words: str, hint: str) -> None:
    """Warn of fits (percent) by name that are smaller than ``least``."""
    poor = [f"{name} ({percent:.2g} %)" for name, percent in fits.items() if percent < least]
    if poor:
        warn_caller(f"{words} {', '.join(poor)}; 100 % is perfect. {hint}", AccuracyWarning)


class Column(NamedTuple):
    """Residuals of one channel of a record, weighted, and their derivatives."""

    residuals: FloatArray  # (samples,), zero where missing
    derivatives: FloatArray  # (samples, parameters) of the residuals, zero where missing
    valid: NDArray[np.bool_]  # (samples,) whether the record has the sample
    record: int = 0  # index of its record
    noise: FloatArray | None = None  # (samples, runs) changes by random noise of the inputs


def pair_sums(values: FloatArray, lags: int) -> FloatArray:
    """Return the sums (lags + 1,) of products of values (samples,) at a distance of each lag."""
    from scipy.signal import correlate

    full = correlate(values, values, method="fft")
    return np.asarray(full[values.size - 1 : values.size + lags])


def correlation_of(
    residuals: FloatArray, valid: NDArray[np.bool_], lags: int
) -> tuple[FloatArray, FloatArray]:
    """Return correlations (lags + 1,) of residuals (samples,), and the pairs of valid samples."""
    # The residuals are zero where missing. Each covariance is the mean over the pairs of its lag; a
    # lag without pairs has the correlation zero.
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
    residuals: FloatArray,
    valid: NDArray[np.bool_],
    signal: FloatArray,
    lags: int = LAGS,
    errors: FloatArray | None = None,
) -> float:
    """Return the probability of correlations as large as those between residuals and an input.

    Residuals that depend on past inputs (0 to ``lags`` samples) give a small value, residuals that
    are correlated over time for another reason do not. NaN without residuals or input. ``errors``
    (samples, k) are independent changes of the residuals by errors of the estimates, of one
    standard deviation each.
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
    # Neighbours of a smooth input are nearly equal.
    vectors = vectors[:, values > 1e-6 * values[-1]]
    crossed = vectors.T @ (past @ residuals)
    expected = scale * vectors.T @ coloured_information([column]) @ vectors
    if errors is not None:
        moved = (
            vectors.T @ past @ np.where(valid[:, None], errors - errors[valid].mean(axis=0), 0.0)
        )
        expected += moved @ moved.T
    statistic = float(crossed @ np.linalg.pinv(expected, hermitian=True) @ crossed)
    return float(chi2.sf(statistic, crossed.size))


def cross_correlation(
    residuals: FloatArray, valid: NDArray[np.bool_], signal: FloatArray, lags: int = LAGS
) -> tuple[FloatArray, float]:
    """Return correlations (lags + 1,) of residuals with a signal, and their standard deviation."""
    # The deviation is that without a relation, with the correlation over time of both. At lag k the
    # signal is that of k samples before.
    residuals, signal = centred(residuals, valid), signal - signal.mean()
    size = float(np.linalg.norm(residuals) * np.linalg.norm(signal))
    if size == 0.0:
        return np.zeros(lags + 1), 1.0 / np.sqrt(valid.sum())
    count = residuals.size
    crossed = np.array([residuals[k:] @ signal[: count - k] for k in range(lags + 1)]) / size
    every = np.ones(count, dtype=bool)
    longest = max(1, count // 4)
    correlation, _ = correlation_of(residuals, valid, longest)
    driven, _ = correlation_of(signal, every, longest)
    power = 1.0 + 2.0 * float(correlation[1:] @ driven[1:])
    return crossed, float(np.sqrt(max(power, 1.0) / valid.sum()))


def information(columns: Sequence[Column]) -> FloatArray:
    """Return the sum of products of derivatives, (parameters, parameters)."""
    total = sum(column.derivatives.T @ column.derivatives for column in columns)
    return np.asarray(total)


def coloured_information(columns: Sequence[Column]) -> FloatArray:
    """Return the covariance of the fit's gradient; ``information`` if the residuals are white."""
    from scipy.signal import fftconvolve

    total = np.zeros((columns[0].derivatives.shape[1],) * 2)
    for residuals, derivatives, valid, *_ in columns:
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

    The standard deviations are the larger ones of those from the derivatives, with the correlation
    of residuals over time, and of those from blocks of the records. The variances by noise of the
    inputs are added, because estimates that follow it leave no residuals.
    """
    # A parameter without information has an infinite variance, and a combination of others without
    # information a very large one.
    curvature = information(columns) + np.diag(priors)
    determined = np.diag(curvature) > 0.0
    covariance = np.diag(np.where(determined, 0.0, np.inf))
    block = np.ix_(determined, determined)
    if determined.any():
        coloured = (coloured_information(columns) + np.diag(priors) - curvature)[block]
        root = inverse_root(curvature[block])
        # The product with the roots does not lose the variance of combinations whose curvature is
        # zero, and rounding does not make it negative.
        values, vectors = np.linalg.eigh(np.eye(len(root)) + root.T @ coloured @ root)
        root_of_total = root @ vectors * np.sqrt(np.maximum(values, _ROUNDED))
        total = root_of_total @ root_of_total.T
        smooth = np.sqrt(np.diag(total))
        larger = np.maximum(_block_deviations(columns, determined, root) / smooth, 1.0)
        moved = root @ (root.T @ noise_scores(columns)[determined])
        covariance[block] = total * np.outer(larger, larger) + moved @ moved.T / moved.shape[1]
    return covariance


def noise_scores(columns: Sequence[Column]) -> FloatArray:
    """Return the gradients (parameters, runs) of the fit by noise of the inputs; zero without."""
    parts = [c.derivatives.T @ c.noise for c in columns if c.noise is not None]
    return np.asarray(sum(parts)) if parts else np.zeros((columns[0].derivatives.shape[1], 1))


def inverse_root(curvature: FloatArray) -> FloatArray:
    """Return R of the inverse R R^T of a matrix with a positive diagonal that may be singular."""
    size = np.sqrt(np.diag(curvature))
    values, vectors = np.linalg.eigh(curvature / np.outer(size, size))
    root = vectors / np.sqrt(np.maximum(values, _SINGULAR * values[-1])) / size[:, None]
    return np.asarray(root)


def _block_deviations(
    columns: Sequence[Column], determined: NDArray[np.bool_], root: FloatArray
) -> FloatArray:
    """Return the standard deviations (determined,) that the estimates without single blocks have.

    Each estimate without a block of samples is one Gauss-Newton step away; ``root`` is a root of
    the inverse of the information. Block jackknife: Kunsch, 1989.
    """
    records = sorted({column.record for column in columns})
    parts = []
    for record in records:
        channels = [column for column in columns if column.record == record]
        edges = np.linspace(0, channels[0].residuals.size, -(-_BLOCKS // len(records)) + 1).astype(
            int
        )
        parts += [(channels, slice(*pair)) for pair in pairwise(edges)]
    slopes = [[c.derivatives[s][:, determined] @ root for c in channels] for channels, s in parts]
    scores = np.array(
        [
            sum(d.T @ c.residuals[s] for d, c in zip(each, channels, strict=True))
            for each, (channels, s) in zip(slopes, parts, strict=True)
        ]
    )
    steps = []
    for each, score in zip(slopes, scores - scores.mean(axis=0), strict=True):
        values, vectors = np.linalg.eigh(np.eye(len(root)) - sum(d.T @ d for d in each))
        steps.append(vectors @ (vectors.T @ score / np.maximum(values, _LEFT)))
    moved = (np.array(steps) - np.mean(steps, axis=0)) @ root.T
    return np.asarray(np.sqrt((len(parts) - 1) / len(parts) * np.sum(moved**2, axis=0)))


def own_information(
    columns: Sequence[Column],
    priors: FloatArray,
    scale: FloatArray,
    physical: NDArray[np.bool_],
) -> FloatArray:
    """Return the information about the physical parameters, relative to their scales.

    ``priors`` (parameters,) are inverse variances, ``scale`` (parameters,) counts as one. The other
    numbers, of initial states, are eliminated: the inverse is the covariance of the physical ones
    without their priors.
    """
    scaled = information(columns) * np.outer(scale, scale)
    others = ~physical
    whole = scaled[np.ix_(physical, physical)]
    if not others.any():
        return whole
    inner = scaled[np.ix_(others, others)] + np.diag(priors[others] * scale[others] ** 2)
    mixed = scaled[np.ix_(others, physical)]
    return np.asarray(whole - mixed.T @ np.linalg.pinv(inner, hermitian=True) @ mixed)


def undetermined(covariance: FloatArray, scale: FloatArray) -> list[tuple[list[int], float]]:
    """Return the combinations of parameters that the data do not determine.

    They consist of the parameters whose standard deviation exceeds half their ``scale``
    (parameters,), and of no other ones. ``covariance`` (parameters, parameters) has no priors. A
    combination has the places of its parameters, the most important one first, and its standard
    deviation relative to the scales.
    """
    covariance = covariance / np.outer(scale, scale)
    deviations = np.sqrt(np.diag(covariance))
    named = [([int(k)], np.inf) for k in np.flatnonzero(~np.isfinite(deviations))]
    places = np.flatnonzero(np.isfinite(deviations) & (deviations > UNDETERMINED))
    block = covariance[np.ix_(places, places)]
    values, vectors = np.linalg.eigh(block)
    weak = vectors[:, values > UNDETERMINED**2]
    combinations = list(_sparse(weak.T))
    # A single parameter may be uncertain although no eigenvector is.
    combinations += [unit for unit in np.eye(places.size) if not np.any(unit @ weak)]
    for vector in combinations:
        # Of a sum, one parameter may be so small that the other ones do not change relatively.
        size, alike = np.abs(vector), np.abs(vector) / deviations[places]
        large = (size > _NAMED * size.max()) | (alike > _EQUAL * alike.max())
        involved = [int(places[k]) for k in np.argsort(-size) if large[k]]
        spread = float(np.sqrt(vector @ block @ vector) / np.linalg.norm(vector))
        named.append((involved, spread if len(involved) > 1 else float(deviations[involved[0]])))
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
