"""The type of a pack of eight float64 (`packs`) in Numba, and its operations."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    models,
    overload_attribute,
    register_model,
)

from flexarm.kernels.compilation.fused import in_all_lanes
from flexarm.kernels.compilation.numba_internals import declare
from flexarm.kernels.compilation.number_types import (
    ORDINARY,
    BlocksType,
    NumberType,
    address,
    let_kernels_index,
    native_array,
)
from flexarm.kernels.compilation.packs import LANES, Packs

VECTOR = ir.VectorType(ir.DoubleType(), LANES)
#: The fast-math options of all kernels.
FAST = ("nsz",)


class PackType(NumberType):
    """Type of a pack: eight float64."""


PACK = PackType(name="Pack8")


@register_model(PackType)
class _PackModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


def equal_lanes(builder: Any, value: Any) -> Any:
    """Return a pack whose lanes are all a number."""
    return in_all_lanes(builder, value, VECTOR)


def _as_pack(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if kind == PACK:
        return value
    return equal_lanes(builder, context.cast(builder, value, kind, types.float64))


@lower_cast(types.Float, PackType)
@lower_cast(types.Integer, PackType)
def _number_to_pack(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    return _as_pack(context, builder, source, value)


# Operations ----------------------------------------------------------------------------------


def _define(function: Any, code: Any, count: int = 2) -> None:
    """Define a function of packs by ``code(builder, x)`` or ``code(builder, x, y)``.

    One of two arguments may be an ordinary number.
    """
    declare(function, count, PACK, ORDINARY, PACK)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pairs = zip(sig.args, args, strict=True)
        return code(builder, *(_as_pack(context, builder, kind, a) for kind, a in pairs))

    number = types.Number
    for kinds in ((PackType, PackType), (PackType, number), (number, PackType)):
        lower_builtin(function, *kinds[:count])(lower)
        if count == 1:
            return


def _instruction(name: str) -> Any:
    return lambda builder, x, y: getattr(builder, name)(x, y, flags=FAST)


for _name, _code in (("add", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv")):
    _define(getattr(operator, _name), _instruction(_code))
    _define(getattr(operator, f"i{_name}"), _instruction(_code))


def _larger(builder: Any, x: Any, y: Any) -> Any:
    """Return y where it is larger than x, otherwise x, also if one of them is not a number."""
    return builder.select(builder.fcmp_ordered(">", y, x), y, x)


def _intrinsic(name: str) -> Any:
    kind = ir.FunctionType(VECTOR, [VECTOR])

    def code(builder: Any, x: Any) -> Any:
        name_of_kind = f"llvm.{name}.v{LANES}f64"
        function = cgutils.get_or_insert_function(builder.module, kind, name_of_kind)
        return builder.call(function, [x])

    return code


_define(max, _larger)
_define(operator.neg, lambda builder, x: builder.fneg(x), count=1)
_define(abs, _intrinsic("fabs"), count=1)
_define(np.sqrt, _intrinsic("sqrt"), count=1)
_define(np.exp, _intrinsic("exp"), count=1)


def _chosen(typing: Any, mask: Any, first: Any, second: Any) -> Any:
    """Return the pack ``first`` in lanes in which ``mask`` is positive, otherwise ``second``."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        positive = builder.fcmp_ordered(">", args[0], ir.Constant(VECTOR, [0.0] * LANES))
        return builder.select(positive, args[1], args[2])

    return PACK(PACK, PACK, PACK), code


chosen: Any = intrinsic(_chosen)


@overload_attribute(PackType, "real")
def _real_part(pack):
    return lambda pack: pack


# Arrays of packs -----------------------------------------------------------------------------


class PacksType(BlocksType):
    """Type of ``Packs`` with some axes besides the lanes."""

    name_of_blocks = "Packs"


def _pack_address(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.bitcast(address(context, builder, sig, args), VECTOR.as_pointer())


def _load_pack(typing: Any, packs: Any, index: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_pack_address(context, builder, sig, args), align=8)

    return PACK(packs, index), code


def _store_pack(typing: Any, packs: Any, index: Any, value: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _pack_address(context, builder, sig, args)
        builder.store(_as_pack(context, builder, sig.args[2], args[2]), pointer, align=8)
        return context.get_dummy_value()

    return types.void(packs, index, value), code


_load: Any = intrinsic(_load_pack)
_store: Any = intrinsic(_store_pack)


def _get_pack(kind: Any, index_kind: Any) -> Any:
    return lambda array, index: _load(array, index)


let_kernels_index(Packs, PacksType, _get_pack, _store)


def _fill_lane(typing: Any, packs: Any, lane: Any, rows: Any, row: Any) -> Any:
    """Copy ``rows[row]`` into a lane of ``packs``; an array of numbers is left as it is."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if isinstance(sig.args[0], PacksType):
            _copy_into_lane(context, builder, sig, args)
        return context.get_dummy_value()

    return types.void(packs, lane, rows, row), code


def _copy_into_lane(context: Any, builder: Any, sig: Any, args: Any) -> None:
    """Write the loop of ``fill_lane``; both arrays are contiguous."""
    kind, _, rows_kind, _ = sig.args
    target = native_array(context, builder, kind, args[0])
    source = context.make_array(rows_kind)(context, builder, args[2])
    lane, row = (context.cast(builder, args[k], sig.args[k], types.intp) for k in (1, 3))
    size = ir.Constant(ir.IntType(64), LANES)
    count = builder.sdiv(target.nitems, size)
    with cgutils.for_range(builder, count) as loop:
        place = builder.add(builder.mul(row, count), loop.index)
        value = builder.load(builder.gep(source.data, [place]))
        place = builder.add(builder.mul(loop.index, size), lane)
        builder.store(value, builder.gep(target.data, [place]))


fill_lane: Any = intrinsic(_fill_lane)


# Eight numbers of an array of numbers, for `integrate.sums` ----------------------------------


def _place(context: Any, builder: Any, kind: Any, array: Any, place: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [place]), VECTOR.as_pointer())


def _load_eight(typing: Any, array: Any, place: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_place(context, builder, sig.args[0], *args), align=8)

    return PACK(array, types.intp), code


def _store_eight(typing: Any, array: Any, place: Any, value: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], _place(context, builder, sig.args[0], *args[:2]), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, PACK), code


#: Eight numbers of a contiguous array from a place on, and a store there.
eight: Any = intrinsic(_load_eight)
put_eight: Any = intrinsic(_store_eight)
