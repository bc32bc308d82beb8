"""Probabilities of rare failures of a study."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from flexarm.base.errors import AccuracyWarning, warn_caller
from flexarm.cases.studies.execution import executor_of
from flexarm.cases.studies.subset import LEAST, MOST_LEVELS, Probability, subset_probability
from flexarm.cases.studies.table import DIMS
from flexarm.cases.studies.workers import cluster, execute
from flexarm.integrate.base import FloatArray
from flexarm.model.scenarios.sampling import RareFailures
from flexarm.simulation.run.progress import Meter

if TYPE_CHECKING:
    import xarray as xr

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
    import xarray as xr

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
    from scipy.special import ndtr

    samples, first = executor_of(text).samples, 0

    def performance(x: FloatArray) -> FloatArray:
        nonlocal first
        first += len(x)
        return performances(samples.at(ndtr(x)), first - len(x), chosen)

    found = subset_probability(performance, len(samples.paths), rare.samples, rare.seed)
    if np.isnan(found.value):
        warn_caller(_NO_PATH.format(" on ".join(chosen[:2])), AccuracyWarning)
    return found
