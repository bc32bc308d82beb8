"""Sums of stages, eight numbers at once.

The compiler does not vectorize kernels: the sums of an implicit method would take as long as its
dynamics. Each number is rounded as in sums of packs, so lanes and single runs stay equal.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.compilation.cache import KernelIntrinsic, before_compiling, inner
from flexarm.kernels.compilation.packs import LANES
from flexarm.kernels.layout import Array, Sizes

#: Eight numbers of a contiguous array from a place on, and a store there.
_eight: Any = KernelIntrinsic("pack_types", "eight")
_put_eight: Any = KernelIntrinsic("pack_types", "put_eight")


@inner
def _one_by_one(
    sizes: Sizes, state: Array, stages: Array, weights: Array, row: int, count: int, h: Any,
    out: Array,
) -> None:  # fmt: skip
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                total = 0.0
                for k in range(count):
                    total += weights[row, k] * stages[k, level, i, j]
                out[level, i, j] = state[level, i, j] + h * total


# Numba requires equal signatures of these functions.
def combine(
    sizes: Any, state: Any, stages: Any, weights: Any, row: Any, count: Any, h: Any, out: Any
) -> Any:
    """Compute out = state + h * sum over ``count`` stages of weights[row], in kernels.

    ``out`` must not overlap the other arrays.
    """
    _one_by_one(sizes, state, stages, weights, row, count, h, out)


def _combine_arrays(
    sizes: Any, state: Any, stages: Any, weights: Any, row: Any, count: Any, h: Any, out: Any
) -> Any:
    size = 2 * len(sizes.bodies) * (1 + len(sizes.modes))
    if size < LANES:
        _one_by_one(sizes, state, stages, weights, row, count, h, out)
        return
    for first in range(0, size, LANES):
        place = min(first, size - LANES)  # the last eight overlap those before
        total = 0.0
        for k in range(count):
            total += weights[row, k] * _eight(stages, k * size + place)
        _put_eight(out, place, _eight(state, place) + h * total)


@before_compiling
def _declare_sums() -> None:
    """Let contiguous arrays of numbers be summed eight numbers at once, in compiled code."""
    from numba import extending, types

    from flexarm.kernels.compilation.numba_internals import HAS_NUMBER_TYPES

    real = types.float64[:, :, ::1], types.float64[:, :, :, ::1]  # contiguous

    @extending.overload(combine, jit_options={"forceinline": True})
    def compiled_combine(
        sizes: Any, state: Any, stages: Any, weights: Any, row: Any, count: Any, h: Any, out: Any
    ) -> Any:
        fits = HAS_NUMBER_TYPES and (out, stages) == real and state == out
        return _combine_arrays if fits else combine
