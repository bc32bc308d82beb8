"""What packs and dual numbers share: numbers of several float64, and arrays of them."""

from __future__ import annotations

import operator
from typing import Any, ClassVar

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import (
    NativeValue,
    make_attribute_wrapper,
    models,
    overload,
    register_model,
    typeof_impl,
    unbox,
)

from flexarm.kernels.compilation.library import Blocks
from flexarm.kernels.compilation.numba_internals import Conversion

#: Classes of the types of ordinary numbers, which become numbers of the new types.
ORDINARY = types.Float, types.Integer


class NumberType(types.Type):
    """Type of a number to which ordinary numbers convert."""

    def unify(self, typing: Any, other: Any) -> Any:
        """Return the type of a variable that is an ordinary number or one of this type."""
        return self if isinstance(other, ORDINARY) else None

    def can_convert_from(self, typing: Any, other: Any) -> Any:
        """Return whether a value of another type becomes a number of this type."""
        return Conversion.safe if isinstance(other, ORDINARY) else None


class BlocksType(types.Type):
    """Type of `Blocks` with some axes besides the last."""

    name_of_blocks: ClassVar[str]

    def __init__(self, axes: int) -> None:
        self.axes = axes
        self.array = types.Array(types.float64, axes + 1, "C")
        super().__init__(name=f"{self.name_of_blocks}{axes}")


def let_kernels_index(blocks: type[Blocks], kind: type[BlocksType], load: Any, store: Any) -> None:
    """Let kernels receive arrays of numbers, and read and write ``array[index]``.

    Args:
        load: function of a type of the array and of an index, which returns the implementation of
            ``array[index]``.
        store: intrinsic ``store(array, index, value)``.
    """

    class Model(models.StructModel):
        def __init__(self, manager: Any, model_kind: Any) -> None:
            super().__init__(manager, model_kind, [("array", model_kind.array)])

    typeof_impl.register(blocks)(lambda value, context: kind(value.array.ndim - 1))
    register_model(kind)(Model)
    make_attribute_wrapper(kind, "array", "array")
    unbox(kind)(_unbox)

    # Numba compares the signatures of these functions with those of the code: no annotations.
    @overload(operator.getitem)
    def get(array, index):
        return load(array, index) if isinstance(array, kind) else None

    @overload(operator.setitem)
    def put(array, index, value):
        if isinstance(array, kind):
            return lambda array, index, value: store(array, index, value)
        return None


def _unbox(kind: Any, value: Any, context: Any) -> Any:
    attribute = context.pyapi.object_getattr_string(value, "array")
    native = context.unbox(kind.array, attribute)
    context.pyapi.decref(attribute)
    blocks = cgutils.create_struct_proxy(kind)(context.context, context.builder)
    blocks.array = native.value
    return NativeValue(blocks._getvalue(), is_error=native.is_error)


def native_array(context: Any, builder: Any, kind: BlocksType, value: Any) -> Any:
    """Return the array of float64 behind an array of numbers."""
    blocks = cgutils.create_struct_proxy(kind)(context, builder, value=value)
    return context.make_array(kind.array)(context, builder, blocks.array)


def address(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return the address of the first float64 of the number ``args[0][args[1]]``."""
    kind, index_kind = sig.args[:2]
    kinds: Any = index_kind
    array = native_array(context, builder, kind, args[0])
    if isinstance(index_kind, types.BaseTuple):
        indices = zip(kinds.types, cgutils.unpack_tuple(builder, args[1]), strict=True)
    else:
        indices = zip([index_kind], [args[1]], strict=True)
    places = [context.cast(builder, index, of, types.intp) for of, index in indices]
    places.append(ir.Constant(ir.IntType(64), 0))
    return cgutils.get_item_pointer(context, builder, kind.array, array, places)
