"""Eigenvalues of small motion: undamped pairs first, then what damping and spin make of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.assemble import FloatArray

#: Squared frequencies below this part of the shift are rounding about a rigid-body mode.
_ZERO = 1e-10
#: Modal damping below this part of the largest is rounding of the products that make it.
_NONE = 1e-13

ComplexArray = NDArray[Any]


class Damped(NamedTuple):
    """Complex modes, in the order of the undamped ones that they belong to.

    ``eigenvalues`` (k,) 1/s: of each pair the one above the real axis, of two real ones the slower;
    ``ratio`` (k,); ``vectors`` (k, k): columns, in undamped modes.
    """

    eigenvalues: ComplexArray
    ratio: FloatArray
    vectors: ComplexArray


def undamped(M: FloatArray, K: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve K x = lambda M x for all pairs, the low ones accurately.

    The stiffest modes of a fine mesh are 1e10 times stiffer than the lowest, whose digits a direct
    solution would lose. Solving ``M x = mu (K + s M) x`` puts the low modes at the accurate end.
    """
    from scipy.linalg import eigh

    if M.size == 0:
        return np.zeros(0), np.zeros((0, 0))
    shift = _positive_shift(M, K)
    mu, vectors = eigh(M, K + shift * M)
    squared = 1.0 / mu[::-1] - shift
    vectors = vectors[:, ::-1] / np.sqrt(mu[::-1])
    squared[np.abs(squared) < _ZERO * shift] = 0.0
    largest = np.argmax(np.abs(vectors), axis=0)
    signs = np.sign(vectors[largest, np.arange(vectors.shape[1])])
    return squared, vectors * signs


def _positive_shift(M: FloatArray, K: FloatArray) -> float:
    """Find a shift that makes K + shift M positive definite, near the lowest stiffness."""
    from scipy.linalg import cholesky

    diagonal = np.abs(np.diag(K)) / np.diag(M)
    positive = diagonal[diagonal > 0.0]
    shift = float(positive.min()) if positive.size else 1.0
    while True:
        try:
            cholesky(K + shift * M)
        except np.linalg.LinAlgError:
            shift *= 4.0
        else:
            return shift


def damped(squared: FloatArray, coupling: FloatArray, damping: FloatArray) -> Damped:
    """Solve the quadratic eigenvalue problem in undamped modes; theory (S.3), (S.4).

    Args:
        squared: (k,) rad^2/s^2.
        coupling: (k, k) part of the stiffness that the undamped modes leave out.
        damping: (k, k), with gyroscopic terms.
    """
    from scipy.linalg import eig

    count = squared.size
    damping = np.where(np.abs(damping) > _NONE * np.max(np.abs(damping), initial=0.0), damping, 0.0)
    if not np.any(coupling) and not np.any(damping - np.diag(np.diag(damping))):
        half = np.diag(damping) / 2.0
        root = np.sqrt((half * half - squared).astype(complex))
        pairs = np.stack([root - half, -root - half])
        return Damped(pairs[0] + 0.0, _ratio(*pairs), np.eye(count, dtype=complex))
    # States frequency times displacement, and rate: then no entry is a square of a frequency.
    scale = np.sqrt(np.abs(squared))
    scale[scale == 0.0] = np.min(scale[scale > 0.0], initial=1.0)
    zero = np.zeros((count, count))
    stiffness = (np.diag(squared) + coupling) / scale
    values, vectors = eig(np.block([[zero, np.diag(scale)], [-stiffness, -damping]]))
    shapes = vectors[:count] / scale[:, None]
    first, second = _matched(values, shapes)
    turned = shapes[:, first] / np.linalg.norm(shapes[:, first], axis=0)
    largest = turned[np.argmax(np.abs(turned), axis=0), np.arange(count)]
    turned = turned * np.abs(largest) / largest
    return Damped(values[first], _ratio(values[first], values[second]), turned)


def _ratio(first: ComplexArray, second: ComplexArray) -> FloatArray:
    """Damping ratio of pairs with s^2 + 2 ratio frequency s + frequency^2; NaN where unstable."""
    product = (first * second).real
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = -(first + second).real / (2.0 * np.sqrt(product))
    return np.asarray(np.where(product > 0.0, ratio, np.nan))


def _matched(values: ComplexArray, shapes: ComplexArray) -> tuple[NDArray[np.intp], Any]:
    """Find the two eigenvalues of each undamped mode: the pair whose shape is most its own.

    Of the shapes (k, 2k) only the share of each undamped mode counts. Where damping has turned
    pairs into real eigenvalues, each mode that is left takes two of them.
    """
    from scipy.optimize import linear_sum_assignment

    count = len(shapes)
    share = np.abs(shapes) ** 2 / np.maximum(np.sum(np.abs(shapes) ** 2, axis=0), 1e-300)
    above = np.flatnonzero(values.imag > 0.0)
    first, second = np.full(count, -1), np.full(count, -1)
    rows, columns = linear_sum_assignment(share[:, above], maximize=True)
    first[rows] = above[columns]
    below = np.flatnonzero(values.imag < 0.0)  # LAPACK puts each right behind its conjugate
    second[rows] = below[columns]
    left = np.flatnonzero(first < 0)
    real = np.flatnonzero(values.imag == 0.0)
    rows, columns = linear_sum_assignment(np.repeat(share[left][:, real], 2, axis=0), maximize=True)
    pairs = real[columns[np.argsort(rows)]].reshape(-1, 2)
    slower = np.argsort(-values[pairs].real, axis=1)
    pairs = np.take_along_axis(pairs, slower, axis=1)
    first[left], second[left] = pairs.T
    return first, second
