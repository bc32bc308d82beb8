"""Probabilities of rare failures of a study, by subset simulation in standard normal variables.

Each level has a threshold that a tenth of its samples exceeds; Markov chains from these give the
samples of the next one (Au and Beck, Probabilistic Engineering Mechanics 16, 2001). The chains take
conditional samples with adaptive correlation (Papaioannou, Betz, Zwirglmaier and Straub,
Probabilistic Engineering Mechanics 41, 2015).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.base.errors import AccuracyWarning, warn_caller
from flexarm.base.late import scipy, xr
from flexarm.cases.studies.execution import DIMS, cluster, execute, executor_of
from flexarm.integrate.base import FloatArray
from flexarm.model.scenarios.study import RareFailures
from flexarm.simulation.run.progress import Meter

Chosen = tuple[str, str, str]  # drive, plant and motion

_NO_PATH = (
    "samples near the failures of {} cannot be distinguished from other samples: no metric with a "
    "limit rises towards them. Give `limits` of metrics, or use more samples."
)


def rare_failures(
    text: str,
    names: dict[str, list[str]],
    rare: RareFailures,
    workers: int,
    progress: bool | None,
) -> xr.Dataset:
    """Return the dataset of `Study.rare_failures` for the study with a text."""
    runs = list(product(names["controller"], names["plant"], names["reference"]))
    with ExitStack() as stack:
        client = stack.enter_context(cluster(None, workers)) if workers > 1 else None
        meter = stack.enter_context(Meter("simulating", progress, lines=True))
        found: list[Probability] = []

        def performances(values: FloatArray, first: int, chosen: Chosen) -> FloatArray:
            parts = np.array_split(values, min(workers, len(values)))
            starts = (first + np.cumsum([0, *map(len, parts)])).tolist()
            tasks = [
                (text, *pair, chosen, dict(rare.limits))
                for pair in zip(parts, starts, strict=False)
            ]
            results = [np.empty(0)] * len(tasks)
            if client is None:
                results = [performances_of(*tasks[0])]
            else:
                execute(client, performances_of, tasks, results.__setitem__)
            share = (first + len(values)) / (rare.samples * MOST_LEVELS)
            meter.update((len(found) + min(share, 1.0)) / len(runs))
            return np.concatenate(results)

        for chosen in runs:
            found.append(_of(performances, text, chosen, rare))
            meter.update(len(found) / len(runs))
    shape = [len(names[dim]) for dim in DIMS[1:]]
    value, variation, count = (np.reshape(column, shape) for column in zip(*found, strict=True))
    spread = np.exp(1.96 * np.sqrt(np.log1p(variation**2)))  # of a logarithmic normal distribution
    high = np.where(
        value > 0.0, np.minimum(value * spread, 1.0), np.where(value == 0.0, LEAST, value)
    )
    meanings = {
        "probability": (value, "probability of a failure"),
        "probability_low": (
            # All runs of the first level may fail: then the estimate has no spread.
            np.where(
                value >= 1.0,
                0.025 ** (1.0 / np.maximum(count, 1)),
                np.where(value > 0.0, value / spread, value),
            ),
            "low limit of its 95 % interval",
        ),
        "probability_high": (high, "high limit of its 95 % interval"),
        "variation": (variation, "coefficient of variation of the estimate"),
        "runs": (count, "simulated runs"),
    }
    table = xr.Dataset(coords={dim: names[dim] for dim in DIMS[1:]})
    for name, (values, meaning) in meanings.items():
        table[name] = (DIMS[1:], values, {"long_name": meaning, "units": "1"})
    return table


def performances_of(
    text: str,
    values: FloatArray,
    first: int,
    chosen: Chosen,
    limits: dict[str, float],
) -> FloatArray:
    """Return `Executor.performances` of the study with a text."""
    return executor_of(text).performances(values, first, chosen, limits)


def _of(
    performances: Callable[[FloatArray, int, Chosen], FloatArray],
    text: str,
    chosen: Chosen,
    rare: RareFailures,
) -> Probability:
    """Return the probability for one drive, plant and motion."""
    samples, first = executor_of(text).samples, 0

    def performance(x: FloatArray) -> FloatArray:
        nonlocal first
        first += len(x)
        return performances(samples.at(scipy.special.ndtr(x)), first - len(x), chosen)

    found = subset_probability(performance, len(samples.paths), rare.samples, rare.seed)
    if np.isnan(found.value):
        warn_caller(_NO_PATH.format(" on ".join(chosen[:2])), AccuracyWarning)
    return found


#: Fraction of the samples of a level that exceeds its threshold, and most levels.
_FRACTION, MOST_LEVELS = 0.1, 8
#: Probability below which the search ends.
LEAST = _FRACTION**MOST_LEVELS
#: Acceptance at which chains forget fastest, and the first deviation of their steps.
_ACCEPTANCE, _DEVIATION = 0.44, 0.6
#: Correlation of the errors of subsequent levels, from repetitions of problems with known answers.
_CORRELATION = 0.5


class Probability(NamedTuple):
    """Probability of a rare event."""

    #: 0 if it is below 1e-8, NaN if the performance has no values between those of ordinary
    #: samples and failure, so that nothing leads to the failures
    value: float
    variation: float  # coefficient of variation
    evaluations: int  # number of evaluations


def subset_probability(
    performance: Callable[[FloatArray], FloatArray], size: int, samples: int, seed: int
) -> Probability:
    """Return the probability that a performance exceeds 1.

    Args:
        performance: function from variables (n, size) to the performances (n,); -inf for variables
            that are not possible, which are left out of the probability.
        samples: for each level.
    """
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(samples, size))
    y = performance(x)
    feasible = y > -np.inf  # chains do not leave them
    if not feasible.any():
        return Probability(np.nan, np.nan, samples)
    x, y = x[feasible], y[feasible]
    value, evaluations, chains, length, scale = 1.0, samples, y.size, 1, _DEVIATION
    deviations: list[float] = []
    for _ in range(MOST_LEVELS):
        threshold = min(1.0, float(np.sort(y)[-max(1, round(_FRACTION * y.size))]))
        inside = y > 1.0 if threshold == 1.0 else y >= threshold
        fraction = float(inside.mean())
        if threshold < 1.0 and fraction == 1.0:
            return Probability(np.nan, np.nan, evaluations)
        value *= fraction
        deviations.append(np.sqrt(_variance(inside.reshape(length, chains), fraction)))
        if threshold == 1.0:
            # A level starts from states of the one before, so that their errors are correlated.
            errors = np.array(deviations)
            variance = errors @ errors + 2.0 * _CORRELATION * (errors[1:] @ errors[:-1])
            return Probability(value, float(np.sqrt(variance)), evaluations)
        starts = rng.permutation(np.flatnonzero(inside))[: round(_FRACTION * samples)]
        chains, length = starts.size, samples // starts.size
        x, y, scale = _chains(performance, x[starts], y[starts], threshold, length, scale, rng)
        evaluations += chains * (length - 1)
    return Probability(0.0, np.nan, evaluations)


def _variance(inside: NDArray[np.bool_], fraction: float) -> float:
    """Return the squared coefficient of variation of a fraction of chains (length, chains)."""
    if fraction == 0.0:
        return 0.0
    length = len(inside)
    deviations = inside - fraction
    covariances = [np.mean(deviations[: length - k] * deviations[k:]) for k in range(length)]
    later = sum(float((1.0 - k / length) * covariances[k]) for k in range(1, length))
    factor = 1.0 + 2.0 * later / max(float(covariances[0]), 1e-300)
    return (1.0 - fraction) / (fraction * inside.size) * max(factor, 1.0)


def _chains(
    performance: Callable[[FloatArray], FloatArray],
    x: FloatArray,
    y: FloatArray,
    threshold: float,
    length: int,
    scale: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, float]:
    """Return the states of all chains, one step of all after the other, and the scale of steps."""
    states, values = [x], [y]
    for k in range(1, length):
        deviation = min(scale, 1.0)
        proposed = np.sqrt(1.0 - deviation**2) * x + deviation * rng.normal(size=x.shape)
        results = performance(proposed)
        accepted = results >= threshold
        x, y = np.where(accepted[:, None], proposed, x), np.where(accepted, results, y)
        states.append(x)
        values.append(y)
        scale *= float(np.exp((accepted.mean() - _ACCEPTANCE) / np.sqrt(k)))
    return np.concatenate(states), np.concatenate(values), scale
