"""Probabilities of rare failures of a study."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from flexarm.base.errors import AccuracyWarning, warn_caller
from flexarm.cases.studies.execution import Executor
from flexarm.cases.studies.subset import LEAST, Probability, subset_probability
from flexarm.cases.studies.table import DIMS
from flexarm.integrate.base import FloatArray
from flexarm.model.scenarios.sampling import RareFailures
from flexarm.simulation.run.progress import Meter

if TYPE_CHECKING:
    import xarray as xr

_NO_PATH = (
    "samples near the failures of {} cannot be distinguished from other samples: no metric with a "
    "limit rises towards them. Give `limits` of metrics, or use more samples."
)


def rare_failures(
    executor: Executor, names: dict[str, list[str]], rare: RareFailures, progress: bool | None
) -> xr.Dataset:
    """Return the dataset of `Study.rare_failures`."""
    import xarray as xr

    runs = list(product(names["controller"], names["plant"], names["reference"]))
    with Meter("simulating", progress, lines=True) as meter:
        found = []
        for chosen in runs:
            found.append(_of(executor, chosen, rare))
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


def _of(executor: Executor, chosen: tuple[str, str, str], rare: RareFailures) -> Probability:
    """Return the probability for one drive, plant and motion."""
    from scipy.special import ndtr

    first = 0

    def performance(x: FloatArray) -> FloatArray:
        nonlocal first
        values = executor.samples.at(ndtr(x))
        first += len(x)
        return executor.performances(values, first - len(x), chosen, dict(rare.limits))

    size = len(executor.samples.paths)
    found = subset_probability(performance, size, rare.samples, rare.seed)
    if np.isnan(found.value):
        warn_caller(_NO_PATH.format(" on ".join(chosen[:2])), AccuracyWarning)
    return found
