"""Sums of stages, eight numbers at once.

The compiler does not vectorize kernels: the sums of an implicit method would take as long as its
dynamics. Each number is rounded as in sums of packs, so lanes and single runs stay equal.
"""

from __future__ import annotations

from typing import Any

from numba import extending, types

from flexarm.kernels.compilation.cache import inner
from flexarm.kernels.compilation.packs import COMPILED, LANES, PACK, VECTOR
from flexarm.kernels.layout import Array, Sizes


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


def _address(context: Any, builder: Any, kind: Any, array: Any, place: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [place]), VECTOR.as_pointer())


def _load(typing: Any, array: Any, place: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_address(context, builder, sig.args[0], *args), align=8)

    return PACK(array, types.intp), code


def _store(typing: Any, array: Any, place: Any, value: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], _address(context, builder, sig.args[0], *args[:2]), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, PACK), code


#: Eight numbers of a contiguous array from a place on, and a store there.
_eight: Any = extending.intrinsic(_load)
_put_eight: Any = extending.intrinsic(_store)


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


@extending.overload(combine, jit_options={"forceinline": True})
def _compiled_combine(
    sizes: Any, state: Any, stages: Any, weights: Any, row: Any, count: Any, h: Any, out: Any
) -> Any:
    real = types.float64[:, :, ::1], types.float64[:, :, :, ::1]  # contiguous
    return _combine_arrays if COMPILED and (out, stages) == real and state == out else combine
