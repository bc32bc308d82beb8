"""Arrays of dual numbers, which kernels read and write as arrays of numbers."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
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

from flexarm.kernels.compilation.duals import DIRECTIONS, DUAL, joined, parts_of
from flexarm.kernels.compilation.packs import VECTOR

#: Numbers that a dual number occupies in an array: its value, then its derivatives.
_WIDTH = 1 + DIRECTIONS

#: ``Duals`` in a kernel, where they act as arrays.
DualArray = Any


class Duals:
    """Array of dual numbers; the last axis of ``array`` is the value, then the derivatives."""

    def __init__(self, array: NDArray[np.float64]) -> None:
        if array.shape[-1] != _WIDTH or array.dtype != np.float64 or not array.flags.c_contiguous:
            raise ValueError("duals are contiguous float64 arrays with a value and derivatives")
        self.array = array

    @classmethod
    def zeros(cls, *shape: int) -> Duals:
        """Return zeros without derivatives."""
        return cls(np.zeros((*shape, _WIDTH)))

    @classmethod
    def of(cls, value: NDArray[Any], slopes: NDArray[Any] | None = None) -> Duals:
        """Return dual numbers; ``slopes`` (k, *shape of value): k <= ``DIRECTIONS`` derivatives."""
        duals = cls.zeros(*value.shape)
        duals.array[..., 0] = value
        if slopes is not None:
            duals.array[..., 1 : 1 + len(slopes)] = np.moveaxis(slopes, 0, -1)
        return duals

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape without the axis of value and derivatives."""
        return self.array.shape[:-1]

    @property
    def value(self) -> NDArray[np.float64]:
        """The values."""
        return self.array[..., 0]

    @property
    def slopes(self) -> NDArray[np.float64]:
        """The derivatives (directions, *shape)."""
        return np.moveaxis(self.array[..., 1:], -1, 0)

    def copy(self) -> Duals:
        """Return a copy."""
        return Duals(self.array.copy())


def zeros_like(array: Any, *shape: int) -> Any:
    """Return zeros of the number type of ``array``: an array, or ``Duals``."""
    if isinstance(array, Duals):
        return Duals.zeros(*shape)
    return np.zeros(shape, dtype=array.dtype)


class DualsType(types.Type):
    """Type of ``Duals`` with some axes."""

    def __init__(self, axes: int) -> None:
        self.axes = axes
        self.array = types.Array(types.float64, axes + 1, "C")
        super().__init__(name=f"Duals{axes}")


@typeof_impl.register(Duals)
def _type_of_duals(value: Duals, context: Any) -> DualsType:
    return DualsType(value.array.ndim - 1)


@register_model(DualsType)
class _DualsModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("array", kind.array)])


make_attribute_wrapper(DualsType, "array", "array")


@unbox(DualsType)
def _unbox_duals(kind: Any, value: Any, context: Any) -> Any:
    attribute = context.pyapi.object_getattr_string(value, "array")
    native = context.unbox(kind.array, attribute)
    context.pyapi.decref(attribute)
    duals = cgutils.create_struct_proxy(kind)(context.context, context.builder)
    duals.array = native.value
    return NativeValue(duals._getvalue(), is_error=native.is_error)


def _addresses(context: Any, builder: Any, sig: Any, args: Any) -> tuple[Any, Any]:
    """Return the addresses of value and derivatives of the dual number ``args[0][args[1]]``."""
    kind, index_kind = sig.args[:2]
    kinds: Any = index_kind
    duals = cgutils.create_struct_proxy(kind)(context, builder, value=args[0])
    array = context.make_array(kind.array)(context, builder, duals.array)
    if isinstance(index_kind, types.BaseTuple):
        indices = zip(kinds.types, cgutils.unpack_tuple(builder, args[1]), strict=True)
    else:
        indices = zip([index_kind], [args[1]], strict=True)
    places = [context.cast(builder, one, of, types.intp) for of, one in indices]
    places.append(ir.Constant(ir.IntType(64), 0))
    value = cgutils.get_item_pointer(context, builder, kind.array, array, places)
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


# Numba compares the signatures of these functions with those of the code: no annotations.
@overload(operator.getitem)
def _get_dual(duals, index):
    if not isinstance(duals, DualsType):
        return None
    if (len(index) if isinstance(index, types.BaseTuple) else 1) == duals.axes:
        return lambda duals, index: _load(duals, index)
    return lambda duals, index: _part(duals.array[index])


@overload(operator.setitem)
def _set_dual(duals, index, value):
    if isinstance(duals, DualsType):
        return lambda duals, index, value: _store(duals, index, value)
    return None


@overload_attribute(DualsType, "shape")
def _shape_of_duals(duals):
    return lambda duals: duals.array.shape[:-1]
