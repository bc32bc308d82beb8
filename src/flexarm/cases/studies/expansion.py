"""Polynomial chaos: expansion of a metric in orthonormal polynomials of the varied numbers.

The terms are chosen one after the other, each the one that reduces the residual most (orthogonal
least squares, Chen, Cowan and Grant 1991). Their number and degree are those with the least error
of cross-validation, in which parts of the samples are predicted from the others: the terms, too,
because the leave-one-out error of terms that were chosen with all samples is ten times too small.
The squares of the coefficients are parts of the variance, so that the indices of Sobol' follow from
their sums (Sudret, Reliability Engineering and System Safety 93, 2008).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.cases.studies.germs import Germ
from flexarm.integrate.base import FloatArray

#: Highest degree; norm of the degrees of a term that the degree bounds: below 1, so that products
#: of many numbers come last; most terms, and most numbers in the matrix of the candidates.
_MOST_DEGREE, _NORM, _MOST_TERMS, _MOST_NUMBERS = 12, 0.75, 150, 3 * 10**5
#: Parts of the samples that are predicted from the others; degrees without a smaller error after
#: which the search ends; error that is small enough.
_PARTS, _PATIENCE, _ENOUGH = 5, 2, 1e-5


class Indices(NamedTuple):
    """Indices of Sobol' of a metric.

    Attributes:
        first, total: (numbers,) fractions of the variance that a number explains alone, and with
            all others.
        first_width, total_width: (numbers,) half the widths of their 95 % intervals.
        unexplained: fraction of the variance that the expansion does not predict, from
            cross-validation.
    """

    first: FloatArray
    total: FloatArray
    first_width: FloatArray
    total_width: FloatArray
    unexplained: float


def indices_of(germs: Sequence[Germ], y: FloatArray, resamples: int, seed: int) -> Indices:
    """Return the indices of a metric (samples,) that is not constant.

    The intervals contain the scatter of the coefficients, and on both sides the unexplained part of
    the variance, which may belong to any number.
    """
    scale = y.std()
    terms, basis, error = _expansion(germs, (y - y.mean()) / scale)
    coefficients = np.linalg.lstsq(basis, (y - y.mean()) / scale, rcond=None)[0]
    within = (terms > 0).T
    alone = within & (within.sum(axis=0) == 1)

    def fractions(c: FloatArray) -> FloatArray:
        squares = c**2 * terms.any(axis=1)
        whole = squares.sum(axis=-1, keepdims=True) + error
        parts: FloatArray = np.stack([squares @ alone.T, squares @ within.T]) / whole
        return parts

    first, total = fractions(coefficients)
    factor = np.linalg.qr(basis, mode="r")
    draws = np.random.default_rng(seed).normal(size=(resamples, len(terms)))
    scatter = np.sqrt(error) * np.linalg.solve(factor, draws.T).T
    widths = 1.96 * fractions(coefficients + scatter).std(axis=1) + error
    return Indices(first, total, widths[0], widths[1], min(error, 1.0))


def _expansion(germs: Sequence[Germ], y: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return the degrees (terms, numbers) of an expansion, its basis (samples, terms), its error.

    The error is that of cross-validation, divided by the variance.
    """
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

    Args:
        learned: (samples,) those from which columns and coefficients follow.

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
