"""Arrays of symbols for code that computes with NumPy and has conditions, such as controllers."""

from __future__ import annotations

import builtins
import inspect
import operator
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, ClassVar, NamedTuple

import casadi
import numpy as np

from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.bridges.symbolic.kernel_calls import (
    FUNCTIONS,
    Scalar,
    SymbolError,
    choose,
    plain,
    symbolic,
)
from flexarm.kernels.layout import ArmConstants, Workspace


class SymbolArray(np.ndarray):
    """Array of objects, `Scalar` objects or numbers, for which all functions of NumPy are exact.

    NumPy evaluates ``minimum``, ``maximum`` and comparisons of objects by their truth values, which
    symbols do not have. Here they result in symbols.
    """

    #: The result of ``dot`` with an array of numbers has this type.
    __array_priority__ = 1.0
    symbolic: ClassVar[bool] = True

    def __array_ufunc__(
        self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any
    ) -> Any:
        bases = [one.view(np.ndarray) if isinstance(one, SymbolArray) else one for one in inputs]
        own = _ELEMENTWISE.get(ufunc.__name__) if method == "__call__" else None
        if own is not None:
            result = np.frompyfunc(own, ufunc.nin, 1)(*bases)
        else:
            result = getattr(ufunc, method)(*bases, **options)
        if out is not None:
            out[0][...] = result
            return out[0]
        return symbol_array(result) if isinstance(result, np.ndarray) else result

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

    Kernels are those of its views of an arm, and static methods of its class. Tuples of arrays, and
    objects of classes in ``packages`` that the object refers to, are converted, too. References to
    one array remain references to one array.
    """
    _convert(owner, packages, {})


def _convert(owner: Any, packages: tuple[str, ...], done: dict[int, Any]) -> None:
    """Convert the attributes of an object; ``done`` are values and their conversions, by id."""

    def converted(value: Any) -> Any:
        if id(value) in done:
            return done[id(value)][1]
        new = value
        if isinstance(value, KernelView):
            new = SymbolicKernels(value.constants)
        elif isinstance(value, np.ndarray) and value.dtype == np.float64:
            new = symbol_array(value)
        elif isinstance(value, tuple):
            parts = list(map(converted, value))
            new = type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        done[id(value)] = value, new
        if type(value).__module__.startswith(packages) and hasattr(value, "__dict__"):
            _convert(value, packages, done)
        return new

    vars(owner).update({name: converted(value) for name, value in list(vars(owner).items())})
    for name, kernel in inspect.getmembers(type(owner), callable):
        module = getattr(getattr(kernel, "py_func", kernel), "__module__", None) or ""
        if module.startswith("flexarm.kernels."):
            vars(owner)[name] = symbolic(kernel)


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
    **{name: getattr(np, name) for name in FUNCTIONS},
}


#: Largest number of paths through the conditions of a function.
MOST_PATHS = 256
#: Largest number of different conditions on one path, and of all its conditions.
_MOST_DIFFERENT, _MOST_CONDITIONS = 100, 10_000
#: Depth to which two conditions are compared; they often refer to the same symbols.
_DEPTH = 2


@dataclass(eq=False)
class _Decisions:
    """Truth values of the conditions of one evaluation: given ones first, then true."""

    given: Sequence[bool]
    conditions: list[Any] = field(default_factory=list)
    taken: list[bool] = field(default_factory=list)
    count: int = 0

    def decide(self, condition: Any) -> bool:
        """Return the truth value of a condition; equal conditions have the same one.

        Of a condition and its negation, such as ``x > 0`` and ``x <= 0``, one is true. SymbolError
        if there are too many: a loop until a symbol is small has no end.
        """
        self.count += 1
        if len(self.taken) == _MOST_DIFFERENT or self.count > _MOST_CONDITIONS:
            raise SymbolError(
                "has too many conditions on one path, such as a loop until a value is small; "
                "repeat it a fixed number of times instead"
            )
        negated = _negated(condition)
        for known, value in zip(self.conditions, self.taken, strict=True):
            if casadi.is_equal(known, condition, _DEPTH):
                return value
            if casadi.is_equal(known, negated, _DEPTH):
                return not value
        k = len(self.taken)
        self.conditions.append(condition)
        self.taken.append(self.given[k] if k < len(self.given) else True)
        return self.taken[k]


def _negated(condition: Any) -> Any:
    """Return the opposite of a comparison; another condition is returned unchanged."""
    if condition.op() == casadi.OP_LT:
        return condition.dep(1) <= condition.dep(0)
    if condition.op() == casadi.OP_LE:
        return condition.dep(1) < condition.dep(0)
    return condition


class _Path(NamedTuple):
    """Decisions and results of one evaluation."""

    conditions: list[Any]
    taken: list[bool]
    results: list[Any]


def branched(evaluate: Callable[[], Mapping[str, Any]]) -> dict[str, Any]:
    """Evaluate a function along all paths through its conditions, and merge the results.

    Each evaluation follows one path. A result that is NaN on one side of a condition has no effect
    on the other. The built-in functions ``min`` and ``max`` of symbols are not conditions. The
    function returns CasADi columns by name, uses the same symbols in each call, and has no other
    effect. SymbolError if there are more than `MOST_PATHS` paths, sizes of results differ between
    paths, or two evaluations have different conditions after the same decisions.
    """
    evaluations: list[tuple[_Decisions, Mapping[str, Any]]] = []
    given: Sequence[bool] | None = ()
    while given is not None:
        if len(evaluations) == MOST_PATHS:
            raise SymbolError(f"has more than {MOST_PATHS} paths through its conditions")
        decisions = _Decisions(given)
        with _ONE_AT_A_TIME, _deciding(decisions.decide):
            evaluations.append((decisions, evaluate()))
        given = _next(decisions.taken)
    return dict(evaluations[0][1]) if len(evaluations) == 1 else _merged(evaluations)


def _next(taken: Sequence[bool]) -> list[bool] | None:
    """Return the first decisions of the next path, depth first; None after the last path."""
    last = next((k for k in reversed(range(len(taken))) if taken[k]), None)
    return None if last is None else [*taken[:last], False]


def _merged(executions: Sequence[tuple[_Decisions, Mapping[str, Any]]]) -> dict[str, Any]:
    sizes = {name: column.numel() for name, column in executions[0][1].items()}
    if any({name: one.numel() for name, one in every.items()} != sizes for _, every in executions):
        raise SymbolError("keeps numbers of other sizes, or None, on one side of a condition")
    # All paths contain the same expressions. Share them, so that the code computes each once.
    columns = casadi.cse([casadi.vertcat(*one.conditions, *e.values()) for one, e in executions])
    paths = []
    for (one, _), column in zip(executions, columns, strict=True):
        entries, count = casadi.vertsplit(column), len(one.taken)
        paths.append(_Path(entries[:count], one.taken, entries[count:]))
    whole, merged = iter(_joined(paths, 0)), {}
    for name, size in sizes.items():
        merged[name] = casadi.vertcat(*(next(whole) for _ in range(size)))
    return merged


def _joined(paths: Sequence[_Path], depth: int) -> list[Any]:
    """Return the results of paths with the same first ``depth`` decisions."""
    first = paths[0]
    if depth == len(first.taken) and len(paths) == 1:
        return first.results
    conditions = [casadi.vertcat(*one.conditions[depth : depth + 1]) for one in paths]
    condition = conditions[0]
    same = all(one.shape == (1, 1) and casadi.is_equal(one, condition) for one in conditions)
    if not same or len({one.taken[depth] for one in paths}) < 2:
        raise SymbolError("has other conditions when it is evaluated again")
    yes, no = (
        _joined([one for one in paths if one.taken[depth] is side], depth + 1)
        for side in (True, False)
    )
    return [
        a if casadi.is_equal(a, b) else casadi.if_else(condition, a, b)
        for a, b in zip(yes, no, strict=True)
    ]


def _of_symbols(plain: Callable[..., Any], pair: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    """Return ``min`` or ``max`` with the function ``pair`` for two symbols."""

    def function(*arguments: Any, **options: Any) -> Any:
        values = list(arguments[0]) if len(arguments) == 1 else arguments
        if options or not any(isinstance(one, Scalar) for one in values):
            return plain(values, **options)
        return reduce(pair, values)

    return function


#: Evaluations replace built-in functions, which all threads share.
_ONE_AT_A_TIME = threading.RLock()
_MIN, _MAX = builtins.min, builtins.max
_LEAST, _MOST = _of_symbols(_MIN, least), _of_symbols(_MAX, most)


@contextmanager
def _deciding(decide: Callable[[Any], bool]) -> Iterator[None]:
    """Let a function decide conditions.

    Python's ``min`` and ``max`` compare their arguments, so that each would be a condition. Their
    replacements return the same for everything but symbols, also in other threads.
    """
    token = choose.set(decide)
    builtins.min, builtins.max = _LEAST, _MOST
    try:
        yield
    finally:
        builtins.min, builtins.max = _MIN, _MAX
        choose.reset(token)
