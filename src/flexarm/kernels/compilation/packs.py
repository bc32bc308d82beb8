"""Packs of eight float64 as a number type of the kernels, for eight runs at once.

A kernel that is called with ``Packs`` arrays instead of arrays of numbers computes all lanes
together: one operation is one vector instruction, or a few on processors with narrow vectors. No
operation combines lanes, so that a lane does not depend on the others.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils, config
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import (
    NativeValue,
    intrinsic,
    make_attribute_wrapper,
    models,
    overload,
    overload_attribute,
    register_model,
    typeof_impl,
    unbox,
)
from numpy.typing import NDArray

#: Number of lanes of a pack.
LANES = 8
#: Whether kernels are compiled; plain Python has no packs.
COMPILED = not getattr(config, "DISABLE_JIT", False)
VECTOR = ir.VectorType(ir.DoubleType(), LANES)
#: The fast-math options of all kernels.
FAST = ("nsz",)
_NUMBERS = types.Float, types.Integer


class PackType(types.Type):
    """Type of a pack: eight float64."""

    def __init__(self) -> None:
        super().__init__(name="Pack8")

    def unify(self, typing: Any, other: Any) -> Any:
        """Return the type of a variable that is a number or a pack."""
        return self if isinstance(other, _NUMBERS) else None

    def can_convert_from(self, typing: Any, other: Any) -> Any:
        """Return whether a value of another type becomes a pack of equal lanes."""
        return Conversion.safe if isinstance(other, _NUMBERS) else None


PACK = PackType()


@register_model(PackType)
class _PackModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


def equal_lanes(builder: Any, value: Any) -> Any:
    """Return a pack whose lanes are all a number."""
    undefined = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, undefined, mask)


def _as_pack(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if kind == PACK:
        return value
    return equal_lanes(builder, context.cast(builder, value, kind, types.float64))


@lower_cast(types.Float, PackType)
@lower_cast(types.Integer, PackType)
def _number_to_pack(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    return _as_pack(context, builder, source, value)


# Operations ----------------------------------------------------------------------------------


def _declare(function: Any, count: int) -> None:
    """Let the compiler know a function of ``count`` packs, or of packs and numbers."""

    class Rule(AbstractTemplate):
        key = function

        def generic(self, args: Any, keywords: Any) -> Any:
            fits = len(args) == count and PACK in args and not keywords
            if fits and all(a == PACK or isinstance(a, _NUMBERS) for a in args):
                return signature(PACK, *args)
            return None

    # The decorator form reads ``function.__module__``, which ufuncs have since NumPy 2.1 only.
    infer_global(function, types.Function(Rule))


def _define(function: Any, code: Any) -> None:
    """Define a function of two packs, or of one and a number, by ``code(builder, x, y)``."""
    _declare(function, 2)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pair = zip(sig.args, args, strict=True)
        return code(builder, *(_as_pack(context, builder, kind, a) for kind, a in pair))

    for kinds in ((PackType, PackType), (PackType, types.Number), (types.Number, PackType)):
        lower_builtin(function, *kinds)(lower)


def _define_one(function: Any, code: Any) -> None:
    """Define a function of one pack by ``code(builder, x)``."""
    _declare(function, 1)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return code(builder, args[0])

    lower_builtin(function, PackType)(lower)


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
_define_one(operator.neg, lambda builder, x: builder.fneg(x))
_define_one(abs, _intrinsic("fabs"))
_define_one(np.sqrt, _intrinsic("sqrt"))
_define_one(np.exp, _intrinsic("exp"))


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


#: ``Packs`` in a kernel, where they act as arrays.
PackArray = Any


class Packs:
    """Array whose last axis is the lanes; ``packs[i, j]`` is a pack in a kernel."""

    def __init__(self, array: NDArray[np.float64]) -> None:
        if array.shape[-1] != LANES or array.dtype != np.float64 or not array.flags.c_contiguous:
            raise ValueError("packs are contiguous float64 arrays with eight lanes")
        self.array = array

    @classmethod
    def zeros(cls, *shape: int) -> Packs:
        """Return packs of zeros."""
        return cls(np.zeros((*shape, LANES)))

    @classmethod
    def of(cls, array: NDArray[np.float64]) -> Packs:
        """Return packs whose lanes all have the numbers of an array."""
        return cls(np.repeat(array[..., None], LANES, axis=-1))


class PacksType(types.Type):
    """Type of ``Packs`` with some axes besides the lanes."""

    def __init__(self, axes: int) -> None:
        self.axes = axes
        self.array = types.Array(types.float64, axes + 1, "C")
        super().__init__(name=f"Packs{axes}")


@typeof_impl.register(Packs)
def _type_of_packs(value: Packs, context: Any) -> PacksType:
    return PacksType(value.array.ndim - 1)


@register_model(PacksType)
class _PacksModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("array", kind.array)])


make_attribute_wrapper(PacksType, "array", "array")


@unbox(PacksType)
def _unbox_packs(kind: Any, value: Any, context: Any) -> Any:
    attribute = context.pyapi.object_getattr_string(value, "array")
    native = context.unbox(kind.array, attribute)
    context.pyapi.decref(attribute)
    packs = cgutils.create_struct_proxy(kind)(context.context, context.builder)
    packs.array = native.value
    return NativeValue(packs._getvalue(), is_error=native.is_error)


def _address(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return the address of the pack ``args[0][args[1]]``."""
    kind, index_kind = sig.args[:2]
    kinds: Any = index_kind
    packs = cgutils.create_struct_proxy(kind)(context, builder, value=args[0])
    array = context.make_array(kind.array)(context, builder, packs.array)
    if isinstance(index_kind, types.BaseTuple):
        indices = zip(kinds.types, cgutils.unpack_tuple(builder, args[1]), strict=True)
    else:
        indices = zip([index_kind], [args[1]], strict=True)
    places = [context.cast(builder, one, of, types.intp) for of, one in indices]
    places.append(ir.Constant(ir.IntType(64), 0))
    pointer = cgutils.get_item_pointer(context, builder, kind.array, array, places)
    return builder.bitcast(pointer, VECTOR.as_pointer())


def _load_pack(typing: Any, packs: Any, index: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_address(context, builder, sig, args), align=8)

    return PACK(packs, index), code


_load: Any = intrinsic(_load_pack)


def _store_pack(typing: Any, packs: Any, index: Any, value: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _address(context, builder, sig, args)
        builder.store(_as_pack(context, builder, sig.args[2], args[2]), pointer, align=8)
        return context.get_dummy_value()

    return types.void(packs, index, value), code


_store: Any = intrinsic(_store_pack)


# Numba compares the signatures of these functions with those of the code: no annotations.
@overload(operator.getitem)
def _get_pack(packs, index):
    if isinstance(packs, PacksType):
        return lambda packs, index: _load(packs, index)
    return None


@overload(operator.setitem)
def _set_pack(packs, index, value):
    if isinstance(packs, PacksType):
        return lambda packs, index, value: _store(packs, index, value)
    return None


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
    packs = cgutils.create_struct_proxy(kind)(context, builder, value=args[0])
    target = context.make_array(kind.array)(context, builder, packs.array)
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
