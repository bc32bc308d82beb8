"""Arrays of symbols for code that computes with NumPy, such as controllers."""

from __future__ import annotations

import inspect
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.bridges.symbolic.kernel_calls import symbolic
from flexarm.bridges.symbolic.scalars import Scalar, plain
from flexarm.kernels.layout import ArmConstants, Workspace


class SymbolArray(np.ndarray):
    """Array of objects, `Scalar` objects or numbers, for which all functions of NumPy are exact.

    NumPy evaluates ``minimum``, ``maximum`` and comparisons of objects by their truth values, which
    symbols do not have. Here they result in symbols.
    """

    #: The result of ``dot`` with an array of numbers has this type.
    __array_priority__ = 1.0

    def __array_ufunc__(
        self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any
    ) -> Any:
        bases = [one.view(np.ndarray) if isinstance(one, SymbolArray) else one for one in inputs]
        own = _ELEMENTWISE.get(ufunc.__name__) if method == "__call__" else None
        if own is not None:
            found = np.frompyfunc(own, ufunc.nin, 1)(*bases)
        else:
            found = getattr(ufunc, method)(*bases, **options)
        if out is not None:
            out[0][...] = found
            return out[0]
        return symbol_array(found) if isinstance(found, np.ndarray) else found

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        # ``where`` would use the truth values of the condition.
        if function is np.where and len(args) == 3:
            return symbol_array(np.frompyfunc(_choice, 3, 1)(*map(np.asarray, args)))
        return super().__array_function__(function, types, args, kwargs)


def symbol_array(values: Any) -> SymbolArray:
    """Return values as a `SymbolArray`; a copy, unless they are an array of objects."""
    return np.asarray(values, dtype=object).view(SymbolArray)


class SymbolicKernels(KernelView):
    """Kernels of one arm, evaluated over arrays of symbols."""

    __slots__ = ()

    def __init__(self, constants: ArmConstants) -> None:
        super().__init__(ArmConstants(*(array.astype(object) for array in constants)), object)
        self.work = Workspace(*map(symbol_array, self.work))

    def call(self, kernel: Callable[..., None], *arguments: Any) -> None:
        """Evaluate the source of a kernel."""
        symbolic(kernel)(self.sizes, self.constants, *arguments)


def make_symbolic(owner: Any, packages: tuple[str, ...]) -> None:
    """Convert the kernels and arrays of an object to symbolic ones, in place.

    Kernels are those of its views of an arm, and static methods of its class. Objects of classes in
    ``packages`` that the object refers to are converted, too.
    """
    for name, value in list(vars(owner).items()):
        if isinstance(value, KernelView):
            vars(owner)[name] = SymbolicKernels(value.constants)
        elif isinstance(value, np.ndarray) and value.dtype == np.float64:
            vars(owner)[name] = symbol_array(value)
        elif type(value).__module__.startswith(packages) and hasattr(value, "__dict__"):
            make_symbolic(value, packages)
    for name, kernel in inspect.getmembers(type(owner), _is_kernel):
        vars(owner)[name] = symbolic(kernel)


def _is_kernel(value: object) -> bool:
    module = getattr(getattr(value, "py_func", value), "__module__", None) or ""
    return callable(value) and module.startswith("flexarm.kernels.")


def _of_library(name: str) -> Callable[[Any, Any], Any]:
    """Return a function of two values, from the library of the symbol among them."""

    def function(a: Any, b: Any) -> Any:
        owner = next((one for one in (a, b) if isinstance(one, Scalar)), None)
        if owner is None:
            return _NUMBERS[name](a, b)
        return Scalar(getattr(owner.library, name)(plain(a), plain(b)), owner.library)

    return function


def _choice(condition: Any, yes: Any, no: Any) -> Any:
    if not isinstance(condition, Scalar):
        return yes if condition else no
    library = condition.library
    return Scalar(library.if_else(condition.value, plain(yes), plain(no)), library)


def _sign(value: Any) -> Any:
    if not isinstance(value, Scalar):
        return np.sign(value)
    return Scalar(value.library.sign(value.value), value.library)


#: Functions of numbers that are also methods of `Scalar`.
_METHODS = (
    *(np.sin, np.cos, np.tan, np.arcsin, np.arccos, np.arctan),
    *(np.sinh, np.cosh, np.tanh, np.arctanh, np.exp, np.log, np.sqrt),
)
_NUMBERS: dict[str, Callable[[Any, Any], Any]] = {
    "fmin": min,
    "fmax": max,
    "arctan2": np.arctan2,
    "logic_or": lambda a, b: bool(a) or bool(b),
    "logic_and": lambda a, b: bool(a) and bool(b),
}
least, most = _of_library("fmin"), _of_library("fmax")
#: Functions of entries, for functions of NumPy that would need truth values or methods of numbers.
_ELEMENTWISE: dict[str, Callable[..., Any]] = {
    "minimum": least,
    "maximum": most,
    "clip": lambda value, lower, upper: least(most(value, lower), upper),
    "equal": operator.eq,
    "not_equal": operator.ne,
    "less": operator.lt,
    "less_equal": operator.le,
    "greater": operator.gt,
    "greater_equal": operator.ge,
    "bitwise_or": _of_library("logic_or"),
    "bitwise_and": _of_library("logic_and"),
    "arctan2": _of_library("arctan2"),
    "sign": _sign,
    **{function.__name__: function for function in _METHODS},
}
