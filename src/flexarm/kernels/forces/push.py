"""Generalised forces of a force at a point of a body, (R.35), (R.36)."""

from __future__ import annotations

from typing import Any

from flexarm.kernels.columns import FLEX_BIAS, ROOT_BIAS_W, ROOT_BIAS_X, ROOT_BIAS_Y
from flexarm.kernels.compilation.cache import merged
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
    """Subtract (fx, fy), axes of body i, from the biases: station k of ``rows``, ``shortening``.

    ``rows`` contains Phi and ``shortening`` g. For a distributed force, ``weight`` and ``lever``
    are integrals of its density; for a point force they are 1 and the distance from the body's
    root.
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
