"""Statistics of a study: quantiles, rates of failures, and what the varied numbers explain.

Indices of sensitivity follow from polynomial chaos, the expansion of a metric in orthonormal
polynomials of the varied numbers. The terms are chosen one after the other, each the one that
reduces the residual most (orthogonal least squares, Chen, Cowan and Grant 1991). Their number and
degree are those with the least error of cross-validation, in which parts of the samples are
predicted from the others: the terms, too, because the leave-one-out error of terms that were chosen
with all samples is ten times too small. The squares of the coefficients are parts of the variance,
so that the indices of Sobol' follow from their sums (Sudret, Reliability Engineering and System
Safety 93, 2008).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.base.arguments import (
    check_choice,
    check_dataset,
    check_mapping,
)
from flexarm.base.errors import (
    AccuracyWarning,
    FlexarmError,
    InputError,
    Problem,
    check_array,
    public_call,
    shown,
    warn_caller,
)
from flexarm.base.late import scipy, xr
from flexarm.cases.studies.execution import DIMS
from flexarm.cases.studies.samples import Germ, Samples, counted_germ
from flexarm.integrate.base import FloatArray
from flexarm.model import StudySpec
from flexarm.model.file_format.files import record_of_bytes
from flexarm.model.quantities import Count, CountOrZero, Probability
from flexarm.simulation.calls.metrics import METRICS

#: Samples below which indices are not computed: cross-validation would have too few of them.
_LEAST_SAMPLES = 20
#: Unexplained part of the variance, and part of the runs without a value, that give a warning.
_MOST_UNEXPLAINED, _MOST_WITHOUT = 0.1, 0.05


@public_call
def study_statistics(
    table: xr.Dataset,
    quantiles: ArrayLike = (0.05, 0.5, 0.95),
    *,
    limits: Mapping[str, float] | None = None,
    nominal: xr.Dataset | None = None,
    confidence: Probability = 0.95,
) -> xr.Dataset:
    """Return quantiles of the metrics of a study and the rate of its failures.

    Args:
        table: as returned by `Study.run` or `read_study`.
        quantiles: probabilities between 0 and 1.
        limits: largest acceptable values of metrics by name. A run that exceeds one, whose metric
            is NaN, or which failed, counts as a failure; by default only runs that failed.
        nominal: metrics without variation, as returned by `Study.nominal`.
        confidence: probability that the interval of the failure rate contains the true one.

    Returns:
        Dataset over controller, plant and reference with each metric over ``quantile``, from the
        runs that did not fail; ``samples``, their number; ``failure_rate`` and its limits
        ``failure_rate_low`` and ``failure_rate_high``, the exact interval of Clopper and Pearson;
        ``infeasible``, the number of runs whose numbers are not possible, such as a negative mass.
        They are neither failures nor in the number of runs of the rate.
        With ``nominal`` also ``NAME_ratio`` for each metric: its quantiles divided by its nominal
        value, NaN if that is zero or its run failed.

    Raises:
        InputError: if the table is not one of a study, a probability or a limit is not possible,
            a metric with a limit is NaN for all runs that did not fail, or ``nominal`` has other
            controllers, plants or references.

    Quantiles of the metrics leave out runs that failed, so look at the rate of failures first. The
    interval assumes independent samples: it is exact for ``random`` and on the safe side for Latin
    hypercubes and Sobol sequences; a grid has no probability.
    """
    table = _checked(table)
    probabilities = check_array("quantiles", quantiles, (-1,))
    if not probabilities.size or not np.all((probabilities >= 0.0) & (probabilities <= 1.0)):
        raise InputError(Problem("quantiles", "be numbers from 0 to 1", shown(quantiles)))
    failed = table["failure"].transpose(*DIMS).values != ""
    possible = _possible(table)
    for name, limit in _limits(table, limits).items():
        failed |= possible & ~(table[name].transpose(*DIMS).values <= limit)
    statistics = xr.Dataset(coords={dim: table[dim] for dim in DIMS[1:]})
    statistics = statistics.assign_coords(quantile=probabilities)
    for metric in METRICS:
        if metric.name not in table:
            continue
        of_metric = _quantiles(table[metric.name].transpose(*DIMS).values, probabilities)
        labels = {"units": metric.unit, "long_name": metric.meaning}
        statistics[metric.name] = (("quantile", *DIMS[1:]), of_metric, labels)
    if nominal is not None:
        statistics = statistics.assign(_ratios(statistics, nominal))
    rates = _rates(failed.sum(axis=0), possible.sum(axis=0), confidence)
    complete = possible & (table["failure"].transpose(*DIMS).values == "")
    fraction = "fraction of the possible runs that failed or exceed a limit"
    rows = {
        "samples": (complete.sum(axis=0), "runs that did not fail"),
        "infeasible": ((~possible).sum(axis=0), "runs whose numbers are not possible"),
        "failure_rate": (rates[..., 0], fraction),
        "failure_rate_low": (rates[..., 1], "low limit of the confidence interval"),
        "failure_rate_high": (rates[..., 2], "high limit of the confidence interval"),
    }
    for name, (values, meaning) in rows.items():
        statistics[name] = (DIMS[1:], values, {"long_name": meaning})
    return statistics


def _rates(
    failed: NDArray[np.int64], runs: NDArray[np.int64], confidence: float
) -> NDArray[np.float64]:
    """Return rates of failures and the limits of their intervals (..., 3); NaN without runs."""
    found = np.full((*runs.shape, 3), np.nan)
    for index in zip(*np.nonzero(runs), strict=True):
        test = scipy.stats.binomtest(int(failed[index]), int(runs[index]))
        found[index] = test.statistic, *test.proportion_ci(confidence)
    return found


@public_call
def sensitivity_indices(
    table: xr.Dataset,
    metric: str = "tip_error_rms",
    *,
    resamples: Count = 100,
    seed: CountOrZero = 0,
) -> xr.Dataset:
    """Return how much of the variation of a metric each varied number explains.

    Args:
        table: as returned by `Study.run` or `read_study`, with at least 20 runs that did not fail.
        metric: its name.
        resamples: random coefficients for the confidence intervals.
        seed: of these.

    Returns:
        Dataset over controller, plant, reference and parameter: ``first_order``, the fraction of
        the variance that the number explains alone, and ``total``, with all others (indices of
        Sobol'); ``first_order_confidence`` and ``total_confidence``, half the widths of their 95 %
        intervals. Without the dimension ``parameter``: ``unexplained``, the fraction of the
        variance that the expansion does not predict. NaN where too few runs remain or the metric
        is constant.

    Raises:
        InputError: if the table is not one of a study, no numbers vary, or there is no such metric.

    Warns:
        AccuracyWarning: if more than 10 % of the variance remain unexplained, or more than 5 % of
            the possible runs have no value: the indices are those of the others.

    The metric is expanded in polynomials that are orthonormal for the distributions of the study;
    for a table without the study, for the values in it. The choice of the terms is cross-validated,
    and the intervals contain the unexplained part (Sudret, Reliability Engineering and System
    Safety 93, 2008). Noise of instruments, different in each sample, is not explained either.
    """
    table = _checked(table)
    check_choice("metric", metric, [m.name for m in METRICS if m.name in table])
    paths = [
        str(k) for k, item in table.coords.items() if item.dims == ("sample",) and k != "sample"
    ]
    if not paths:
        raise InputError(Problem("table", "has no varied numbers"))
    values, possible = table[metric].transpose(*DIMS).values, _possible(table)
    indices = xr.Dataset(coords={**{dim: table[dim] for dim in DIMS[1:]}, "parameter": paths})
    names = "first_order", "total", "first_order_confidence", "total_confidence"
    for name in names:
        shape = (*values.shape[1:], len(paths))
        indices[name] = ((*DIMS[1:], "parameter"), np.full(shape, np.nan))
    indices["unexplained"] = (DIMS[1:], np.full(values.shape[1:], np.nan))
    for index in np.ndindex(values.shape[1:]):
        metrics = values[(slice(None), *index)]
        finite = np.isfinite(metrics)
        least = max(_LEAST_SAMPLES, 2 * len(paths))
        if finite.sum() < least or np.ptp(metrics[finite]) == 0.0:
            continue
        sobol = indices_of(_germs(table, paths, finite), metrics[finite], resamples, seed)
        for name, array in zip(names, sobol[:4], strict=True):
            indices[name].values[index] = array
        indices["unexplained"].values[index] = sobol.unexplained
        runs = int(possible[(slice(None), *index)].sum())
        _warn_of_poor(metric, sobol.unexplained, int(finite.sum()), runs)
    return indices


def _germs(table: xr.Dataset, paths: Sequence[str], chosen: NDArray[np.bool_]) -> list[Germ]:
    """Return the germs of the varied numbers in some samples."""
    # Their distributions are those of the study in the table; without it, those of the samples.
    numbers = {path: table[path].values[chosen] for path in paths}
    try:
        study = record_of_bytes(str(table.attrs.get("study", "")).encode(), "the study")
        samples = Samples(study) if isinstance(study, StudySpec) else None
    except FlexarmError:
        samples = None
    if samples is None or set(paths) != set(samples.paths):
        return [counted_germ(values, values) for values in numbers.values()]
    return [samples.germ(path, values) for path, values in numbers.items()]


def _warn_of_poor(metric: str, unexplained: float, finite: int, runs: int) -> None:
    """Warn of indices that rest on a poor expansion or on a part of the runs."""
    if unexplained > _MOST_UNEXPLAINED:
        text = f"polynomials of the varied numbers leave {100.0 * unexplained:.0f} % of the "
        advice = "Use more samples; jumps and noise of the metric remain unexplained."
        warn_caller(f"{text}variance of {metric} unexplained. {advice}", AccuracyWarning)
    if finite < (1.0 - _MOST_WITHOUT) * runs:
        text = f"{runs - finite} of {runs} runs have no {metric}: the indices ignore them."
        warn_caller(text, AccuracyWarning)


def _ratios(found: xr.Dataset, nominal: object) -> dict[str, xr.DataArray]:
    """Return the quantiles of metrics divided by their nominal values."""
    known = check_dataset("nominal", nominal, DIMS[1:], "a table of Study.nominal")
    if DIMS[0] in known.dims:
        raise InputError(Problem("nominal", "be a table of Study.nominal", "one with samples"))
    for dim in DIMS[1:]:
        own, other = found[dim].values.tolist(), known[dim].values.tolist()
        if sorted(own) != sorted(other):
            rule = f"have the same names of {dim} as the table"
            raise InputError(Problem("nominal", rule, shown(other)))
    ratios = {}
    for metric in METRICS:
        if metric.name in found and metric.name in known:
            values = known[metric.name].where(known[metric.name] > 0.0)
            ratio = (found[metric.name] / values).transpose("quantile", *DIMS[1:])
            meaning = f"{metric.name}, divided by its nominal value"
            ratios[f"{metric.name}_ratio"] = ratio.assign_attrs(units="1", long_name=meaning)
    return ratios


def _quantiles(
    values: NDArray[np.float64], probabilities: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return quantiles along the first axis without the values that are NaN."""
    found = np.full((probabilities.size, *values.shape[1:]), np.nan)
    for index in np.ndindex(values.shape[1:]):
        one = values[(slice(None), *index)]
        right = one[np.isfinite(one)]
        if right.size:
            found[(slice(None), *index)] = np.quantile(right, probabilities)
    return found


def _possible(table: xr.Dataset) -> NDArray[np.bool_]:
    """Return which runs (samples, controllers, plants, references) have possible numbers."""
    if "infeasible" not in table:
        return np.ones([table.sizes[dim] for dim in DIMS], dtype=np.bool_)
    return np.asarray(table["infeasible"].transpose(*DIMS).values == "")


def _checked(table: object) -> xr.Dataset:
    return check_dataset("table", table, (*DIMS, "failure"), "a table of a study")


def _limits(table: xr.Dataset, limits: object) -> dict[str, float]:
    if limits is None:
        return {}
    given = dict(check_mapping("limits", limits, "metrics and numbers"))
    known: Sequence[str] = [metric.name for metric in METRICS if metric.name in table]
    found = {
        check_choice("limits", name, known): float(check_array(f"limits[{name!r}]", value, ()))
        for name, value in given.items()
    }
    complete = (table["failure"].transpose(*DIMS) == "") & _possible(table)
    problems = [
        Problem("limits", f"cannot contain {name}, which is NaN for all runs")
        for name in found
        if complete.any() and not table[name].where(complete).notnull().any()
    ]
    if problems:
        raise InputError(*problems)
    return found


#: Highest degree; norm of the degrees of a term that the degree bounds: below 1, so that products
#: of many numbers come last; most terms, and most numbers in the matrix of the candidates.
_MOST_DEGREE, _NORM, _MOST_TERMS, _MOST_NUMBERS = 12, 0.75, 150, 3 * 10**5
#: Parts of the samples that are predicted from the others; degrees without a smaller error after
#: which the search ends; error that is small enough.
_PARTS, _PATIENCE, _ENOUGH = 5, 2, 1e-5


class Indices(NamedTuple):
    """Indices of Sobol' of a metric."""

    #: (numbers,) fractions of the variance that a number explains alone, and with all others
    first: FloatArray
    total: FloatArray  # likewise
    first_width: FloatArray  # (numbers,) half the widths of their 95 % intervals
    total_width: FloatArray  # likewise
    #: fraction of the variance that the expansion does not predict, from cross-validation
    unexplained: float


def indices_of(germs: Sequence[Germ], y: FloatArray, resamples: int, seed: int) -> Indices:
    """Return the indices of a metric (samples,) that is not constant."""
    # The intervals contain the scatter of the coefficients, and on both sides the unexplained part
    # of the variance, which may belong to any number.
    scale = y.std()
    terms, basis, error = _expansion(germs, (y - y.mean()) / scale)
    coefficients = np.linalg.lstsq(basis, (y - y.mean()) / scale, rcond=None)[0]
    within = (terms > 0).T
    alone = within & (within.sum(axis=0) == 1)

    def fractions(c: FloatArray) -> FloatArray:
        squares = c**2 * terms.any(axis=1)
        whole = squares.sum(axis=-1, keepdims=True) + error
        return np.asarray(np.stack([squares @ alone.T, squares @ within.T]) / whole)

    first, total = fractions(coefficients)
    factor = np.linalg.qr(basis, mode="r")
    draws = np.random.default_rng(seed).normal(size=(resamples, len(terms)))
    scatter = np.sqrt(error) * np.linalg.solve(factor, draws.T).T
    widths = 1.96 * fractions(coefficients + scatter).std(axis=1) + error
    return Indices(first, total, widths[0], widths[1], min(error, 1.0))


def _expansion(germs: Sequence[Germ], y: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return degrees (terms, numbers) of an expansion, its basis (samples, terms), its error."""
    # The error is that of cross-validation, divided by the variance.
    most = min(y.size, max(_MOST_NUMBERS // y.size, 2 * len(germs) + 1))
    degrees = [min(_MOST_DEGREE, germ.nodes.size - 1) for germ in germs]
    powers = [_polynomials(germ, degree) for germ, degree in zip(germs, degrees, strict=True)]
    parts = np.random.default_rng(0).permutation(y.size) % _PARTS
    best = np.zeros((1, len(germs)), dtype=int), np.ones((y.size, 1)), np.inf
    since = 0
    for degree in range(1, max(degrees) + 1):
        terms = np.array(list(_terms(degrees, degree, most)))
        if (degree > 1 and len(terms) > most) or since >= _PATIENCE or best[2] < _ENOUGH:
            break
        basis = np.ones((y.size, len(terms)))
        for j, columns in enumerate(powers):
            basis *= columns[:, terms[:, j]]
        errors = [_chosen(basis, y, parts != part)[1] for part in range(_PARTS)]
        length = min(map(len, errors))
        error = np.sum([one[:length] for one in errors], axis=0) / y.size
        count = int(np.argmin(error))
        since += 1
        if error[count] < best[2]:
            chosen = _chosen(basis, y, np.ones(y.size, dtype=bool))[0][: count + 1]
            best, since = (terms[chosen], basis[:, chosen], float(error[count])), 0
    return best


def _terms(degrees: Sequence[int], degree: int, most: int) -> Iterator[tuple[int, ...]]:
    """Yield the degrees of all terms up to a degree, and at most one more than ``most``."""
    count = 0

    def extended(head: tuple[int, ...], left: float) -> Iterator[tuple[int, ...]]:
        nonlocal count
        if len(head) == len(degrees):
            count += 1
            yield head
            return
        for power in range(degrees[len(head)] + 1):
            rest = left - power**_NORM
            if rest < -1e-9 or count > most:
                return
            yield from extended((*head, power), rest)

    yield from extended((), degree**_NORM)


def _chosen(
    basis: FloatArray, y: FloatArray, learned: NDArray[np.bool_]
) -> tuple[list[int], list[float]]:
    """Return the columns of a basis in their order of importance; the first one is constant.

    Returns:
        The columns, and for each number of them the sum of squared errors of the other samples.
    """
    left, residual = basis.copy(), y.copy()
    norms = np.einsum("ij,ij->j", left[learned], left[learned])
    floor = 1e-6 * norms  # a column that others represent almost has no digits left
    chosen: list[int] = []
    errors: list[float] = []
    for count in range(min(basis.shape[1], int(learned.sum()) // 2, _MOST_TERMS)):
        gains = (residual * learned) @ left
        gains = np.where(norms > floor, gains, 0.0) ** 2 / np.maximum(norms, floor)
        column = int(np.argmax(gains)) if count else 0
        if norms[column] <= floor[column]:
            break
        unit = left[:, column] / np.sqrt(norms[column])
        residual -= unit * (unit[learned] @ residual[learned])
        products = (unit * learned) @ left
        left -= np.outer(unit, products)
        norms -= products**2
        norms[column] = 0.0
        chosen.append(column)
        errors.append(float(np.sum(residual[~learned] ** 2)))
        if np.mean(residual[learned] ** 2) < 1e-3 * _ENOUGH:
            break
    return chosen, errors


def _polynomials(germ: Germ, degree: int) -> FloatArray:
    """Return the orthonormal polynomials (samples, degree + 1) of a variable (Stieltjes)."""
    x = np.concatenate([germ.nodes, germ.values])
    weights = np.concatenate([germ.weights, np.zeros(germ.values.size)])
    columns = [np.zeros(x.size), np.ones(x.size)]
    size = 0.0
    for _ in range(degree):
        centre = weights @ (x * columns[-1] ** 2)
        following = (x - centre) * columns[-1] - size * columns[-2]
        size = float(np.sqrt(weights @ following**2))
        columns.append(following / size)
    return np.stack(columns[1:], axis=1)[germ.nodes.size :]
