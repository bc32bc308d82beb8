"""Eigenvalues of small motion: undamped modes, and their change by damping and spin."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.assembly.assemble import FloatArray

#: Squared frequencies below this fraction of the shift are rounding errors of rigid-body modes.
_ZERO = 1e-10
#: Modal damping below this fraction of the largest is rounding error.
_NONE = 1e-13

ComplexArray = NDArray[Any]


class Damped(NamedTuple):
    """Complex modes, in the order of the corresponding undamped modes.

    ``eigenvalues`` (k,) 1/s: of a conjugate pair the one with positive imaginary part, of two real
    ones the slower; ``ratio`` (k,); ``vectors`` (k, k): columns, in undamped modes.
    """

    eigenvalues: ComplexArray
    ratio: FloatArray
    vectors: ComplexArray


def undamped(M: FloatArray, K: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve K x = lambda M x for all eigenpairs, accurately for the lowest.

    The stiffest modes of a fine mesh are 1e10 times stiffer than the lowest, which would lose their
    digits in a direct solution. In ``M x = mu (K + s M) x`` the lowest modes have the largest mu.
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
    """Return a shift s with K + s M positive definite, of the size of the lowest stiffness."""
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
        coupling: (k, k) part of the stiffness that is not in the undamped modes.
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
    # With the states frequency times displacement, and rate, no entry is a squared frequency.
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
    """Return the damping ratio of each pair of eigenvalues; NaN if their product is not positive.

    The pairs are the roots of s^2 + 2 ratio frequency s + frequency^2.
    """
    product = (first * second).real
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = -(first + second).real / (2.0 * np.sqrt(product))
    return np.asarray(np.where(product > 0.0, ratio, np.nan))


def _matched(values: ComplexArray, shapes: ComplexArray) -> tuple[NDArray[np.intp], Any]:
    """Return the two eigenvalues of each undamped mode, matched by shape.

    The match uses the magnitude of each undamped mode in the shapes (k, 2k). Modes whose pairs
    have become real eigenvalues by damping are matched to two real ones each.
    """
    from scipy.optimize import linear_sum_assignment

    count = len(shapes)
    share = np.abs(shapes) ** 2 / np.maximum(np.sum(np.abs(shapes) ** 2, axis=0), 1e-300)
    above = np.flatnonzero(values.imag > 0.0)
    first, second = np.full(count, -1), np.full(count, -1)
    rows, columns = linear_sum_assignment(share[:, above], maximize=True)
    first[rows] = above[columns]
    below = np.flatnonzero(values.imag < 0.0)  # in LAPACK's order each follows its conjugate
    second[rows] = below[columns]
    left = np.flatnonzero(first < 0)
    real = np.flatnonzero(values.imag == 0.0)
    rows, columns = linear_sum_assignment(np.repeat(share[left][:, real], 2, axis=0), maximize=True)
    pairs = real[columns[np.argsort(rows)]].reshape(-1, 2)
    slower = np.argsort(-values[pairs].real, axis=1)
    pairs = np.take_along_axis(pairs, slower, axis=1)
    first[left], second[left] = pairs.T
    return first, second
