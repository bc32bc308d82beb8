"""Germs: varied numbers as variables near 1, with quadratures of their distributions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import FloatArray
from flexarm.model.scenarios.sampling import (
    Distribution,
    ListedValues,
    LogUniformDistribution,
    NormalDistribution,
)

#: Nodes of the quadratures, exact for products of polynomials up to the degree 31.
_NODES = 32


class Germ(NamedTuple):
    """A varied number as a variable near 1, and a quadrature of its distribution.

    Attributes:
        values: (samples,) of the variable.
        nodes, weights: of the quadrature; the weights sum to 1.
    """

    values: FloatArray
    nodes: FloatArray
    weights: FloatArray


def germ_of(item: Distribution, values: FloatArray) -> Germ:
    """Return the germ of a distribution at values that are not relative.

    Polynomials of it converge fast: those of Legendre for numbers, or logarithms, between bounds,
    and of Hermite for a normal distribution.
    """
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


def counted_germ(values: FloatArray, listed: FloatArray) -> Germ:
    """Return the germ of values that are as frequent as in a list."""
    levels, counts = np.unique(listed, return_counts=True)
    centre, scale = listed.mean(), listed.std() or 1.0
    return Germ((values - centre) / scale, (levels - centre) / scale, counts / listed.size)
