"""Upper bound of the structured singular value, by scaling: theory page "control-robust"."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexarm.control.analysis.sampled_loop import ComplexArray
from flexarm.control.hardware.measurement import FloatArray

#: Iterations of the balancing. Each reduces the remaining error of typical matrices by a half.
_BALANCES = 40
#: Smallest norm of a block, relative to that of the matrix, so that logarithms are finite.
_TINY = 1e-12


def structured_bound(matrices: ComplexArray, blocks: Sequence[int]) -> FloatArray:
    """Return upper bounds (f,) of the structured singular values of matrices (f, n, n).

    The uncertainty is block-diagonal with full complex blocks. Scalings are balanced by Osborne's
    iteration for all matrices. They are optimised further until the largest bound is optimal, so
    that the maximum is accurate and other bounds may be a few percent too large. For up to three
    blocks the optimal bound is the structured singular value (Packard and Doyle 1993); (C.148).

    Args:
        matrices: (f, n, n). blocks: sizes of the blocks, with the sum n.
    """
    return structured_scales(matrices, blocks)[0]


def structured_scales(
    matrices: ComplexArray, blocks: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Return the bounds of `structured_bound`, and logarithms (f, blocks) of balanced scalings."""
    logs = _balanced(matrices, blocks)
    bounds, plain = (scaled_norms(matrices, blocks, each) for each in (logs, 0.0 * logs))
    logs[plain < bounds] = 0.0  # balancing may increase the norm, which it does not minimise
    bounds = np.minimum(bounds, plain)
    done: set[int] = set()
    while (k := int(np.argmax(bounds))) not in done:
        done.add(k)
        bounds[k] = _refined(matrices[k], blocks, logs[k])
    return bounds, logs


def scaled_norms(matrices: ComplexArray, blocks: Sequence[int], logs: FloatArray) -> FloatArray:
    """Return the largest singular values (f,) of scaled matrices; ``logs`` (f, blocks)."""
    scale = np.exp(np.repeat(logs, blocks, axis=1))
    scaled = scale[:, :, None] * matrices / scale[:, None, :]
    return np.asarray(np.linalg.svd(scaled, compute_uv=False)[:, 0], dtype=np.float64)


def _balanced(matrices: ComplexArray, blocks: Sequence[int]) -> FloatArray:
    """Return logarithms (f, blocks) of scalings that minimise the Frobenius norms."""
    logs = np.zeros((len(matrices), len(blocks)))
    if len(blocks) == 1:
        return logs
    starts = np.cumsum([0, *blocks[:-1]])
    square = np.abs(matrices) ** 2
    square = np.add.reduceat(np.add.reduceat(square, starts, axis=1), starts, axis=2)
    total = square.sum(axis=(1, 2), keepdims=True)
    square = np.maximum(square, _TINY**2 * total + np.finfo(float).tiny)
    # Scalings do not change the diagonal. Subtracting it from the sums would cancel digits.
    square[:, range(len(blocks)), range(len(blocks))] = 0.0
    for _ in range(_BALANCES):
        for i in range(1, len(blocks)):
            scale = np.exp(2.0 * logs)
            row = (square[:, i] / scale).sum(axis=1)
            column = (square[:, :, i] * scale).sum(axis=1)
            logs[:, i] = 0.25 * np.log(column / row)
    return logs


def _refined(matrix: ComplexArray, blocks: Sequence[int], start: FloatArray) -> float:
    """Return the smallest norm over scalings, which is convex in their logarithms."""
    from scipy.optimize import minimize

    if len(blocks) == 1:
        return float(scaled_norms(matrix[None], blocks, np.zeros((1, 1)))[0])

    def norm(free: FloatArray) -> float:
        return float(scaled_norms(matrix[None], blocks, np.append(0.0, free)[None])[0])

    # The norm is not differentiable where singular values are equal, as they often are at the
    # minimum: use a method without derivatives.
    options = {"xatol": 1e-5, "fatol": 1e-9, "maxiter": 400 * len(blocks)}
    found = minimize(norm, start[1:] - start[0], method="Nelder-Mead", options=options)
    return float(found.fun)
