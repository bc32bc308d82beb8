"""The type of a dual number (`duals`) in Numba, and its operations."""

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
    make_attribute_wrapper,
    models,
    overload_attribute,
    register_model,
)

from flexarm.kernels.compilation.duals import DIRECTIONS, Duals
from flexarm.kernels.compilation.numba_internals import declare
from flexarm.kernels.compilation.number_types import (
    ORDINARY,
    BlocksType,
    NumberType,
    address,
    let_kernels_index,
)
from flexarm.kernels.compilation.pack_types import FAST, PACK, VECTOR, equal_lanes

_DOUBLE = ir.DoubleType()


class DualType(NumberType):
    """Type of a dual number."""


DUAL = DualType(name="Dual8")


@register_model(DualType)
class _DualModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("value", types.float64), ("slopes", PACK)])


make_attribute_wrapper(DualType, "value", "real")
make_attribute_wrapper(DualType, "slopes", "slopes")


def parts_of(context: Any, builder: Any, kind: Any, number: Any) -> tuple[Any, Any]:
    """Return value and derivatives; None for the derivatives of an ordinary number."""
    if kind != DUAL:
        return context.cast(builder, number, kind, types.float64), None
    return builder.extract_value(number, 0), builder.extract_value(number, 1)


def joined(context: Any, builder: Any, value: Any, slopes: Any) -> Any:
    # Not in memory, so that ``fused`` finds a product in the value.
    none = ir.Constant(context.get_value_type(DUAL), ir.Undefined)
    first = builder.insert_value(none, value, 0)
    second = ir.Constant(VECTOR, [0.0] * DIRECTIONS) if slopes is None else slopes
    return builder.insert_value(first, second, 1)


@lower_cast(types.Float, DualType)
@lower_cast(types.Integer, DualType)
def _number_to_dual(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    return joined(context, builder, *parts_of(context, builder, source, value))


# Operations ----------------------------------------------------------------------------------


def _define(function: Any, count: int, code: Any, result: Any = DUAL) -> None:
    """Define a function of dual numbers, and of dual numbers and ordinary ones.

    ``code(builder, *parts)`` receives value and derivatives of each argument and returns those of
    the result, or only a value if ``result`` is not ``DUAL``.
    """

    declare(function, count, DUAL, ORDINARY, result)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pairs = zip(sig.args, args, strict=True)
        number = code(builder, *(parts_of(context, builder, kind, a) for kind, a in pairs))
        return joined(context, builder, *number) if result == DUAL else number

    kinds: list[tuple[Any, ...]] = [(DualType,)]
    if count == 2:
        kinds = [(DualType, DualType), (DualType, types.Number), (types.Number, DualType)]
    for classes in kinds:
        lower_builtin(function, *classes)(lower)


def _scaled(builder: Any, slopes: Any, factor: Any) -> Any:
    """Return derivatives times a number; None for no derivatives."""
    if slopes is None:
        return None
    return builder.fmul(slopes, equal_lanes(builder, factor), flags=FAST)


def _sum(builder: Any, first: Any, second: Any) -> Any:
    if first is None or second is None:
        return second if first is None else first
    return builder.fadd(first, second, flags=FAST)


def _difference(builder: Any, first: Any, second: Any) -> Any:
    if second is None:
        return first
    if first is None:
        return builder.fneg(second)
    return builder.fsub(first, second, flags=FAST)


def _added(builder: Any, x: Any, y: Any) -> Any:
    return builder.fadd(x[0], y[0], flags=FAST), _sum(builder, x[1], y[1])


def _subtracted(builder: Any, x: Any, y: Any) -> Any:
    return builder.fsub(x[0], y[0], flags=FAST), _difference(builder, x[1], y[1])


def _multiplied(builder: Any, x: Any, y: Any) -> Any:
    by_first, by_second = _scaled(builder, x[1], y[0]), _scaled(builder, y[1], x[0])
    return builder.fmul(x[0], y[0], flags=FAST), _sum(builder, by_first, by_second)


def _divided(builder: Any, x: Any, y: Any) -> Any:
    quotient = builder.fdiv(x[0], y[0], flags=FAST)
    inverse = builder.fdiv(ir.Constant(_DOUBLE, 1.0), y[0], flags=FAST)
    rest = _difference(builder, x[1], _scaled(builder, y[1], quotient))
    return quotient, _scaled(builder, rest, inverse)


for _name, _code in (
    ("add", _added),
    ("sub", _subtracted),
    ("mul", _multiplied),
    ("truediv", _divided),
):
    _define(getattr(operator, _name), 2, _code)
    _define(getattr(operator, f"i{_name}"), 2, _code)


def _selected(builder: Any, condition: Any, x: Any, y: Any) -> Any:
    """Return x where the condition holds, otherwise y."""
    zero = ir.Constant(VECTOR, [0.0] * DIRECTIONS)
    slopes = [zero if part[1] is None else part[1] for part in (x, y)]
    return builder.select(condition, x[0], y[0]), builder.select(condition, *slopes)


def _larger(builder: Any, x: Any, y: Any) -> Any:
    return _selected(builder, builder.fcmp_ordered(">", y[0], x[0]), y, x)


def _smaller(builder: Any, x: Any, y: Any) -> Any:
    return _selected(builder, builder.fcmp_ordered("<", y[0], x[0]), y, x)


def _negative(builder: Any, x: Any) -> Any:
    return builder.fneg(x[0]), builder.fneg(x[1])


def _absolute(builder: Any, x: Any) -> Any:
    below = builder.fcmp_ordered("<", x[0], ir.Constant(_DOUBLE, 0.0))
    return _selected(builder, below, _negative(builder, x), x)


def _comparison(sign: str) -> Any:
    kind = "fcmp_unordered" if sign == "!=" else "fcmp_ordered"
    return lambda builder, x, y: getattr(builder, kind)(sign, x[0], y[0])


_define(max, 2, _larger)
_define(min, 2, _smaller)
_define(operator.neg, 1, _negative)
_define(abs, 1, _absolute)
for _name, _sign in (
    ("lt", "<"),
    ("le", "<="),
    ("gt", ">"),
    ("ge", ">="),
    ("eq", "=="),
    ("ne", "!="),
):
    _define(getattr(operator, _name), 2, _comparison(_sign), types.boolean)


def _of_library(builder: Any, name: str, x: Any) -> Any:
    """Return a function of the C library of a float64."""
    kind = ir.FunctionType(_DOUBLE, [_DOUBLE])
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.f64")
    return builder.call(function, [x])


def _root(builder: Any, x: Any) -> Any:
    root = _of_library(builder, "sqrt", x[0])
    slope = builder.fdiv(ir.Constant(_DOUBLE, 0.5), root, flags=FAST)
    return root, _scaled(builder, x[1], slope)


def _exponential(builder: Any, x: Any) -> Any:
    value = _of_library(builder, "exp", x[0])
    return value, _scaled(builder, x[1], value)


def _logarithm(builder: Any, x: Any) -> Any:
    slope = builder.fdiv(ir.Constant(_DOUBLE, 1.0), x[0], flags=FAST)
    return _of_library(builder, "log", x[0]), _scaled(builder, x[1], slope)


_define(np.sqrt, 1, _root)
_define(np.exp, 1, _exponential)
_define(np.log, 1, _logarithm)


def _chained(typing: Any, value: Any, slope: Any, x: Any) -> Any:
    """Return f(x) from its ``value`` and its derivative ``slope`` at the value of x."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        slopes = parts_of(context, builder, DUAL, args[2])[1]
        return joined(context, builder, args[0], _scaled(builder, slopes, args[1]))

    return DUAL(types.float64, types.float64, DUAL), code


chained: Any = intrinsic(_chained)


# Arrays of dual numbers ----------------------------------------------------------------------


class DualsType(BlocksType):
    """Type of ``Duals`` with some axes."""

    name_of_blocks = "Duals"


def _addresses(context: Any, builder: Any, sig: Any, args: Any) -> tuple[Any, Any]:
    """Return the addresses of value and derivatives of the dual number ``args[0][args[1]]``."""
    value = address(context, builder, sig, args)
    slopes = builder.gep(value, [ir.Constant(ir.IntType(64), 1)], inbounds=True)
    return value, builder.bitcast(slopes, VECTOR.as_pointer())


def _load_dual(typing: Any, duals: Any, index: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value, slopes = _addresses(context, builder, sig, args)
        return joined(context, builder, builder.load(value), builder.load(slopes, align=8))

    return DUAL(duals, index), code


_load: Any = intrinsic(_load_dual)


def _store_dual(typing: Any, duals: Any, index: Any, number: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        places = _addresses(context, builder, sig, args)
        whole = context.cast(builder, args[2], sig.args[2], DUAL)
        value, slopes = parts_of(context, builder, DUAL, whole)
        builder.store(value, places[0])
        builder.store(slopes, places[1], align=8)
        return context.get_dummy_value()

    return types.void(duals, index, number), code


_store: Any = intrinsic(_store_dual)


def _part_of(typing: Any, array: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        duals = cgutils.create_struct_proxy(sig.return_type)(context, builder)
        duals.array = args[0]
        return duals._getvalue()

    return DualsType(array.ndim - 1)(array), code


_part: Any = intrinsic(_part_of)


def _get_dual(kind: Any, index_kind: Any) -> Any:
    if (len(index_kind) if isinstance(index_kind, types.BaseTuple) else 1) == kind.axes:
        return lambda array, index: _load(array, index)
    return lambda array, index: _part(array.array[index])


let_kernels_index(Duals, DualsType, _get_dual, _store)


@overload_attribute(DualsType, "shape")
def _shape_of_duals(duals):
    return lambda duals: duals.array.shape[:-1]
