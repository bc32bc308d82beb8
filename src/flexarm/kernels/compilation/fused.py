"""Fused products and sums, chosen by the source of a kernel and not by the optimizer.

With the fast-math option ``contract`` LLVM chooses which of the two products of ``a b + c d`` it
fuses with the sum. The choice depends on the code around it and differs between numbers and packs,
whose results then differ in the last bit.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils

_sum, _difference = ir.IRBuilder.fadd, ir.IRBuilder.fsub


def _product(value: Any) -> Any:
    """Return the factors of the product that a value is, or None.

    Also if it is a part of a number of several parts, or the number in all lanes of a pack.
    """
    if isinstance(value, ir.instructions.ShuffleVector):
        first = value.operands[0]
        filled = isinstance(first, ir.instructions.InsertElement)
        return _product(first.operands[1]) if filled else None
    while isinstance(value, ir.instructions.ExtractValue):
        place, whole = list(value.indices), value.operands[0]
        while isinstance(whole, ir.instructions.InsertValue) and list(whole.indices) != place:
            whole = whole.operands[0]
        if not isinstance(whole, ir.instructions.InsertValue):
            return None
        value = whole.operands[1]
    is_product = isinstance(value, ir.Instruction) and value.opname == "fmul"
    return value.operands if is_product else None


def in_all_lanes(builder: Any, value: Any, kind: Any) -> Any:
    """Return the vector whose lanes all contain one number."""
    undefined = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(first, undefined, mask)


def _fused(builder: Any, factors: Any, rest: Any, negative: bool = False) -> Any:
    """Return the product plus ``rest``, or ``rest`` minus it if ``negative``, with one rounding.

    On processors without an instruction for it there are two roundings.
    """
    kind = rest.type
    x, y = (v if v.type == kind else in_all_lanes(builder, v, kind) for v in factors)
    if negative:
        x = builder.fneg(x)
    lanes = f"v{kind.count}" if isinstance(kind, ir.VectorType) else ""
    number = kind.element if lanes else kind
    name = f"llvm.fmuladd.{lanes}{number.intrinsic_name}"
    call = ir.FunctionType(kind, [kind] * 3)
    insert: Any = cgutils.get_or_insert_function
    function = insert(builder.module, call, name)
    return builder.call(function, [x, y, rest])


def _add(builder: Any, x: Any, y: Any, name: str = "", flags: Any = ()) -> Any:
    if (product := _product(x)) is not None:
        return _fused(builder, product, y)
    if (product := _product(y)) is not None:
        return _fused(builder, product, x)
    return _sum(builder, x, y, name, flags)


def _subtract(builder: Any, x: Any, y: Any, name: str = "", flags: Any = ()) -> Any:
    if (product := _product(x)) is not None:
        return _fused(builder, product, builder.fneg(y))
    if (product := _product(y)) is not None:
        return _fused(builder, product, x, negative=True)
    return _difference(builder, x, y, name, flags)


def fuse(active: bool) -> None:
    """Fuse the first product of each sum that is lowered from now on, or no more."""
    builder: Any = ir.IRBuilder
    builder.fadd, builder.fsub = (_add, _subtract) if active else (_sum, _difference)
