"""A force at a point of a body: what it takes from the biases of root and modes, (R.35), (R.36)."""

from __future__ import annotations

from typing import Any

from flexarm.kernels.cache import merged
from flexarm.kernels.columns import FLEX_BIAS, ROOT_BIAS_W, ROOT_BIAS_X, ROOT_BIAS_Y
from flexarm.kernels.layout import Array, Sizes, Workspace


@merged
def push_at(
    sizes: Sizes,
    rows: Array,
    shortening: Array,
    k: int,
    i: int,
    weight: Any,
    lever: Any,
    fx: Any,
    fy: Any,
    state: Array,
    work: Workspace,
) -> None:
    """Apply (fx, fy), axes of body i, at place k of ``rows`` (Phi) and ``shortening`` (g).

    A spread force has the integrals of its density as ``weight`` and ``lever``; at a point they are
    one and the distance from the body's root.
    """
    v = 0.0
    for j in range(len(sizes.modes)):
        v += rows[k, j] * state[0, i, 1 + j]
        work.mode[i, j, FLEX_BIAS] -= rows[k, j] * fy
    x = lever
    for j in range(len(sizes.geometric)):
        drawn = 0.0
        for p in range(len(sizes.geometric)):
            drawn += shortening[k, j, p] * state[0, i, 1 + p]
        x -= 0.5 * state[0, i, 1 + j] * drawn
        work.mode[i, j, FLEX_BIAS] += drawn * fx
    work.body[i, ROOT_BIAS_X] -= weight * fx
    work.body[i, ROOT_BIAS_Y] -= weight * fy
    work.body[i, ROOT_BIAS_W] -= x * fy - v * fx
