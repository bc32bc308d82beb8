"""Compile kernels with Numba; `code_cache` keeps the machine code on disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
from numba.core import event
from numba.core.cpu import CPUTargetOptions

from flexarm.kernels.code_cache import cache_folder, cache_of
from flexarm.kernels.compile_notice import CompileNotice

F = TypeVar("F", bound=Callable[..., Any])

#: Floating-point freedoms that change the last digits but never hide a NaN or an infinity.
_FAST = {"contract", "nsz", "arcp"}


#: Where the machine code is kept; None if no folder is private to this user.
CACHE_DIRECTORY = cache_folder()


def _options() -> dict[str, Any]:
    """Options of every kernel.

    Kernels own no memory: arrays come in, arrays go out. Without Numba's reference counting they
    run three times as fast (an atomic counter at each array access otherwise). The option has no
    documented name, so a Numba that does not know it compiles without.
    """
    options: dict[str, Any] = {"error_model": "numpy", "fastmath": _FAST}
    options["no_cfunc_wrapper"] = True  # nobody passes a kernel on as a C function
    if hasattr(CPUTargetOptions, "_nrt"):
        options["_nrt"] = False
    return options


def _decorate(function: F, **more: Any) -> F:
    dispatcher: Any = numba.njit(**_options(), **more)(function)
    if hasattr(dispatcher, "enable_caching"):  # not where Numba is told to compile nothing
        dispatcher._cache = cache_of(function, CACHE_DIRECTORY)
    return cast(F, dispatcher)


def compiled(function: F) -> F:
    """Compile a kernel on first use, for each combination of argument types, cached on disk."""
    return _decorate(function)


def inner(function: F) -> F:
    """Compile a kernel that only kernels call, without the code that unpacks Python's arguments.

    That code takes longer to compile than many a kernel. Calling one from Python raises TypeError;
    ``undecorated`` gives the plain function.
    """
    return _closed(_decorate(function, no_cpython_wrapper=True))


def merged(function: F) -> F:
    """Compile a pass of a kernel into its callers: handing over the arrays costs as much as it.

    Only kernels call it, as with ``inner``. It is for hot places; elsewhere a call compiles faster.
    """
    return _closed(_decorate(function, no_cpython_wrapper=True, forceinline=True))


def merged_and_called(function: F) -> F:
    """Compile a kernel into the kernels that call it, and for calls from Python too."""
    return _decorate(function, forceinline=True)


def _closed(kernel: F) -> F:
    """Refuse calls from Python, for which there is no machine code."""
    dispatcher: Any = kernel
    if hasattr(dispatcher, "add_overload"):  # not where Numba is told to compile nothing

        def keep(version: Any) -> None:
            dispatcher.overloads[tuple(version.signature.args)] = version

        def refuse(*arguments: Any, **more: Any) -> None:
            name = dispatcher.py_func.__name__
            raise TypeError(f"{name} is compiled for other kernels alone; see kernels.cache.inner")

        dispatcher.add_overload, dispatcher._compile_for_args = keep, refuse
    return kernel


#: Calls after which finding the types once and for all (2 ms) has paid, at 8 us each.
_OFTEN = 200


class Entry:
    """The way into one kernel for a caller that comes again and again with the same types.

    At each call of a kernel Numba finds the type of every array in every record anew, which costs
    ten times what a small kernel does. Here that ends after some calls with the same first
    argument; as long as it is the same, the caller promises that the others keep their types,
    dimensions and memory layout. Nothing checks the promise.
    """

    __slots__ = ("_calls", "_code", "_first", "kernel")

    def __init__(self, kernel: Callable[..., Any]) -> None:
        self.kernel = kernel
        self._first: Any = self  # no caller's first argument
        self._code: Callable[..., Any] = kernel
        self._calls = 0

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel."""
        if arguments[0] is not self._first:
            self._first, self._code, self._calls = arguments[0], self.kernel, 0
        elif self._calls < _OFTEN:
            self._calls += 1
            if self._calls == _OFTEN:
                self._look(arguments)
        return self._code(*arguments)

    def _look(self, arguments: tuple[Any, ...]) -> None:
        kernel: Any = self.kernel
        if hasattr(kernel, "typeof_pyval"):  # not where Numba is told to compile nothing
            types = tuple(map(kernel.typeof_pyval, arguments))
            kernel.compile(types)
            self._code = kernel.overloads[types].entry_point

    def __reduce__(self) -> tuple[type[Entry], tuple[Callable[..., Any]]]:
        return Entry, (self.kernel,)  # a copy finds its machine code anew


def undecorated(
    function: Callable[..., Any], instead: Mapping[Callable[..., Any], Callable[..., Any]] = {}
) -> Callable[..., Any]:
    """Return the plain Python function behind a kernel, and behind every kernel that it calls.

    The result runs the very same source over any number type that knows ``+ - * /``: symbolic
    scalars in object arrays, for example. Nothing is compiled. ``instead``: functions to call in
    place of kernels.
    """
    known = {id(getattr(kernel, "py_func", kernel)): other for kernel, other in instead.items()}
    return _undecorated(function, known)


def _undecorated(function: Any, done: dict[int, Callable[..., Any]]) -> Callable[..., Any]:
    plain = cast(FunctionType, getattr(function, "py_func", function))
    if id(plain) in done:
        return done[id(plain)]
    scope: dict[str, Any] = dict(plain.__globals__)
    twin = FunctionType(plain.__code__, scope, plain.__name__, plain.__defaults__)
    done[id(plain)] = twin
    for name in plain.__code__.co_names:
        callee = scope.get(name)
        module = getattr(getattr(callee, "py_func", callee), "__module__", None) or ""
        if callable(callee) and module.startswith("flexarm.") and not isinstance(callee, type):
            scope[name] = _undecorated(callee, done)
    return twin


notice = CompileNotice(kept=CACHE_DIRECTORY is not None)
event.register("numba:compile", notice)  # type: ignore[no-untyped-call]


def compile_seconds() -> float:
    """Seconds that this process has spent compiling kernels so far."""
    return notice.seconds
