"""A force at a point of a body: what it takes from the biases of root and modes, (R.35), (R.36)."""

from __future__ import annotations

from typing import Any

from flexarm.kernels.cache import merged
from flexarm.kernels.layout import Array, Sizes


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
    root_bias: Array,
    flex_bias: Array,
) -> None:
    """Apply (fx, fy), axes of body i, at place k of ``rows`` (Phi) and ``shortening`` (g).

    A spread force has the integrals of its density as ``weight`` and ``lever``; at a point they are
    one and the distance from the body's root.
    """
    v = 0.0
    for j in range(len(sizes.modes)):
        v += rows[k, j] * state[0, i, 1 + j]
        flex_bias[i, j] -= rows[k, j] * fy
    x = lever
    for j in range(len(sizes.geometric)):
        drawn = 0.0
        for p in range(len(sizes.geometric)):
            drawn += shortening[k, j, p] * state[0, i, 1 + p]
        x -= 0.5 * state[0, i, 1 + j] * drawn
        flex_bias[i, j] += drawn * fx
    root_bias[i, 0] -= weight * fx
    root_bias[i, 1] -= weight * fy
    root_bias[i, 2] -= x * fy - v * fx
