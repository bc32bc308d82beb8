"""Samples of a study by their number, the same for any division into chunks."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexarm.base.errors import InputError, Problem, raise_any, shown, without_warnings
from flexarm.base.late import scipy
from flexarm.cases.scenario.file_errors import Where
from flexarm.integrate.base import FloatArray
from flexarm.model import StudySpec
from flexarm.model.paths import number_at
from flexarm.model.scenarios.study import (
    Distribution,
    ListedValues,
    LogUniformDistribution,
    NormalDistribution,
    SamplePlan,
)

#: Fractions nearest to 0 and 1, whose quantiles are finite for every distribution.
_LEAST, _MOST = 2.0**-54, 1.0 - 2.0**-53
#: Points of a Sobol sequence with SciPy's default resolution.
_SOBOL_BITS = 30


class Samples:
    """Values of the varied numbers of a study.

    Attributes:
        paths: of the varied numbers. count: number of samples.
    """

    def __init__(self, study: StudySpec, place: Where = lambda _: "study") -> None:
        self._plan = study.samples or SamplePlan(count=1)
        self._varied = tuple(study.vary.items())
        self.paths = tuple(study.vary)
        values, problems = [], []
        for path, item in study.vary.items():
            whole = (study, path, "study") if in_study(path) else (study.arm, path)
            try:
                values.append(number_at("vary", *whole))
                if item.relative and values[-1] == 0.0:
                    rule = "not be relative to a number that is 0"
                    hint = "All samples would be equal. Give the values without `relative: true`."
                    raise InputError(Problem("vary", rule, shown(path), hint))
            except InputError as error:
                where = place(("vary", path))
                problems += [replace(problem, where=where) for problem in error.problems]
        raise_any(problems)
        self._nominal = values
        self._levels = [_levels(item) for _, item in self._varied]
        grid = self._plan.method == "grid"
        self.count = math.prod(map(len, self._levels)) if grid else self._plan.count or 1

    def values(self, start: int, stop: int) -> FloatArray:
        """Return the values (stop - start, paths) of samples."""
        values = self._grid(start, stop) if self._plan.method == "grid" else None
        if values is None:
            return self.at(self._points(start, stop))
        return self._scaled(values)

    def at(self, points: FloatArray) -> FloatArray:
        """Return the values (n, paths) at points of the unit cube, of probabilities."""
        values = np.empty_like(points)
        for j, (_, item) in enumerate(self._varied):
            values[:, j] = _quantile(item, points[:, j])
        return self._scaled(values)

    def _scaled(self, values: FloatArray) -> FloatArray:
        """Return values of which relative ones are multiplied by the numbers in the file."""
        for j, (_, item) in enumerate(self._varied):
            if item.relative:
                values[:, j] *= self._nominal[j]
        return values

    def germ(self, path: str, values: FloatArray) -> Germ:
        """Return the germ of a varied number at values (samples,) of it."""
        j = self.paths.index(path)
        item = self._varied[j][1]
        # Polynomials of the germ converge fast: those of Legendre for numbers, or logarithms,
        # between bounds, and of Hermite for a normal distribution.
        values = values / self._nominal[j] if item.relative else values
        if isinstance(item, ListedValues):
            return counted_germ(values, np.array(item.values))
        if isinstance(item, NormalDistribution):
            nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
            return Germ((values - item.mean) / item.deviation, nodes, weights / weights.sum())
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        low, high = item.low, item.high
        if isinstance(item, LogUniformDistribution):
            low, high, values = np.log(low), np.log(high), np.log(values)
        return Germ((2.0 * values - low - high) / (high - low), nodes, weights / 2.0)

    def noise_seed(self, k: int) -> int | None:
        """Return the seed of the noise of sample k; None for that of the hardware."""
        if self._plan.noise == "same":
            return None
        sequence = np.random.SeedSequence((self._plan.seed, k))
        return int(sequence.generate_state(1, np.uint64)[0]) >> 1  # Hardware takes 63 bits

    def _grid(self, start: int, stop: int) -> FloatArray:
        shape = [len(values) for values in self._levels]
        index = np.unravel_index(np.arange(start, stop), shape)
        return np.stack([values[k] for values, k in zip(self._levels, index, strict=True)], axis=1)

    def _points(self, start: int, stop: int) -> FloatArray:
        """Return points (stop - start, paths) of the unit cube."""
        size, seed = len(self.paths), self._plan.seed
        if not size:
            return np.zeros((stop - start, 0))
        if self._plan.method == "random":
            bits = np.random.PCG64(seed).advance(start * size)  # one draw for each number
            return np.random.Generator(bits).random((stop - start, size))
        if self._plan.method == "latin_hypercube":
            return self._hypercube[start:stop]
        resolution = _SOBOL_BITS if self.count <= 2**_SOBOL_BITS else 2 * _SOBOL_BITS
        sequence = scipy.stats.qmc.Sobol(size, seed=seed, bits=resolution)
        if start:
            sequence.fast_forward(start)
        with without_warnings(UserWarning):  # of numbers of samples that are no power of two
            points: FloatArray = sequence.random(stop - start)
        return points

    @cached_property
    def _hypercube(self) -> FloatArray:
        points: FloatArray = scipy.stats.qmc.LatinHypercube(
            len(self.paths), seed=self._plan.seed
        ).random(self.count)
        return points


def in_study(path: str) -> bool:
    """Return whether a path starts at a key of the study; otherwise it starts in the arm."""
    return path.partition(".")[0].partition("[")[0] in StudySpec.model_fields


def _levels(item: Distribution) -> FloatArray:
    """Return the values of a distribution in a grid."""
    if isinstance(item, ListedValues):
        return np.array(item.values)
    if isinstance(item, NormalDistribution):
        return np.zeros(0)
    scale = np.geomspace if isinstance(item, LogUniformDistribution) else np.linspace
    return np.asarray(scale(item.low, item.high, item.levels))


def _quantile(item: Distribution, fraction: FloatArray) -> FloatArray:
    """Return the values of a distribution below which fractions of its probability lie."""
    values: FloatArray
    if isinstance(item, ListedValues):
        chosen = np.minimum((fraction * len(item.values)).astype(int), len(item.values) - 1)
        values = np.array(item.values)[chosen]
    elif isinstance(item, NormalDistribution):
        values = item.mean + item.deviation * scipy.special.ndtri(np.clip(fraction, _LEAST, _MOST))
    elif isinstance(item, LogUniformDistribution):
        values = item.low * (item.high / item.low) ** fraction
    else:
        values = item.low + (item.high - item.low) * fraction
    return values


#: Nodes of the quadratures, exact for products of polynomials up to the degree 31.
_NODES = 32


class Germ(NamedTuple):
    """A varied number as a variable near 1, and a quadrature of its distribution."""

    values: FloatArray  # (samples,) of the variable
    nodes: FloatArray  # of the quadrature; the weights sum to 1
    weights: FloatArray  # likewise


def counted_germ(values: FloatArray, listed: FloatArray) -> Germ:
    """Return the germ of values that are as frequent as in a list."""
    levels, counts = np.unique(listed, return_counts=True)
    centre, scale = listed.mean(), listed.std() or 1.0
    return Germ((values - centre) / scale, (levels - centre) / scale, counts / listed.size)
