"""Compile kernels with Numba; `code_cache` keeps the machine code on disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
import numpy as np

from flexarm.kernels.compilation.code_cache import cache_folder, cache_of, code_library
from flexarm.kernels.compilation.compile_notice import CompileNotice
from flexarm.kernels.compilation.numba_internals import CAN_OMIT_REFERENCES, register_listener

F = TypeVar("F", bound=Callable[..., Any])

#: The fast-math option that changes the sign of zeros alone. Options that change digits, such as
#: "arcp" and "contract", do so at other places in packs than in single numbers; see ``fused``.
_FAST = {"nsz"}


#: Folder of the compiled code; None if no folder is private to this user.
CACHE_DIRECTORY = cache_folder()


def _options() -> dict[str, Any]:
    """Return the compiler options of every kernel.

    Kernels own no memory, because their results are arguments. Without Numba's reference counting
    they run three times as fast (otherwise each array access updates an atomic counter). The option
    is undocumented, so it is omitted for versions of Numba without it.
    """
    options: dict[str, Any] = {"error_model": "numpy", "fastmath": _FAST}
    if code_library:
        options["pipeline_class"] = code_library.KernelCompiler
    options["no_cfunc_wrapper"] = True  # no kernel is passed on as a C function
    if CAN_OMIT_REFERENCES:
        options["_nrt"] = False
    return options


def _decorate(function: F, apart: bool = False, **more: Any) -> F:
    dispatcher: Any = numba.njit(**{**_options(), **more})(function)
    if hasattr(dispatcher, "enable_caching"):  # absent if compilation is disabled
        cache = cache_of(function, CACHE_DIRECTORY, apart)
        if cache is not None:
            dispatcher._cache = cache
        # Pickled by its name: a copy in another process would be compiled without the cache.
        dispatcher.__reduce_ex__ = lambda protocol: function.__qualname__
    return cast(F, dispatcher)


def compiled(function: F) -> F:
    """Compile a kernel at its first call for each combination of argument types; cache on disk.

    Python and kernels can call it. Its machine code exists once: kernels refer to it.
    """
    return _decorate(function, apart=True)


def unlocked(function: F) -> F:
    """Compile a kernel like ``compiled``, whose calls let other threads of Python continue.

    Use it for kernels that run for a long time; for the others it costs more than it saves.
    """
    return _decorate(function, apart=True, nogil=True)


def apart(function: F) -> F:
    """Compile a kernel that only kernels call, without the code that unpacks Python's arguments.

    That code often takes longer to compile than the kernel. A call from Python raises TypeError;
    ``undecorated`` returns the plain function. As with ``compiled``, kernels refer to it.
    """
    return _closed(_decorate(function, apart=True, no_cpython_wrapper=True))


def inner(function: F) -> F:
    """Compile a small kernel that only kernels call; the compiler may merge it into its callers."""
    return _closed(_decorate(function, no_cpython_wrapper=True))


def merged(function: F) -> F:
    """Compile a kernel into its callers, because passing the arrays costs as much as the kernel.

    Only kernels can call it, as with ``apart``. Use it in hot loops; elsewhere, an ordinary call
    compiles faster.
    """
    options: dict[str, Any] = {"forceinline": True}
    if code_library:
        options["pipeline_class"] = code_library.MergedCompiler
    return _closed(_decorate(function, no_cpython_wrapper=True, **options))


def _closed(kernel: F) -> F:
    """Make calls from Python raise TypeError, because there is no machine code for them."""
    dispatcher: Any = kernel
    if hasattr(dispatcher, "add_overload"):  # absent if compilation is disabled

        def keep(version: Any) -> None:
            dispatcher.overloads[tuple(version.signature.args)] = version

        def refuse(*arguments: Any, **more: Any) -> None:
            name = dispatcher.py_func.__name__
            raise TypeError(
                f"{name} is compiled for other kernels alone; see kernels.compilation.cache.apart"
            )

        dispatcher.add_overload, dispatcher._compile_for_args = keep, refuse
    return kernel


#: Number of calls, at 8 us each, after which determining the types once (2 ms) pays off. A lookup
#: of known kinds (20 us) pays off at the second call.
_OFTEN = 200
#: Machine code by kernel and kinds of arguments, which repeated runs look up in 20 us.
_known: dict[tuple[Any, ...], Callable[..., Any]] = {}
#: Mask of the flags of an array that are part of its type: ownership of the memory is not.
_TYPED = ~0x4


def _kind(value: Any) -> Any:
    """Return what determines the type of an argument; functions are no arguments of kernels."""
    if isinstance(value, np.ndarray):
        return type(value), value.dtype, value.ndim, value.flags.num & _TYPED
    return (type(value), *map(_kind, value)) if isinstance(value, tuple) else type(value)


class Entry:
    """Cached entry point of a kernel, for repeated calls with the same argument types.

    At each call of a kernel, Numba determines the type of every array in every record, which costs
    ten times as much as a small kernel. An entry point skips this after some calls with the same
    first argument; if the kinds of its arguments are known, after two. While the first argument is
    the same object, the caller must keep the types, dimensions and memory layout of the others.
    This is not checked.

    Args:
        often: number of calls after which the types are determined once; with dual numbers 1,
            because each call then takes 1 ms.
    """

    __slots__ = ("_calls", "_code", "_first", "_often", "kernel")

    def __init__(self, kernel: Callable[..., Any], often: int = _OFTEN) -> None:
        self.kernel, self._often = kernel, often
        self._first: Any = self  # differs from every caller's first argument
        self._code: Callable[..., Any] = kernel
        self._calls = 0

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel."""
        if arguments[0] is not self._first:
            self._first, self._code, self._calls = arguments[0], self.kernel, 0
        elif self._calls < self._often:
            self._calls += 1
            if self._calls == 1 or self._calls == self._often:
                self._look(arguments)
        return self._code(*arguments)

    def _look(self, arguments: tuple[Any, ...]) -> None:
        """Use known machine code; after many calls, determine the types to find it."""
        kernel: Any = self.kernel
        if not hasattr(kernel, "typeof_pyval"):  # absent if compilation is disabled
            return
        key = kernel, _kind(arguments)
        if key not in _known and self._calls >= self._often:
            types = tuple(map(kernel.typeof_pyval, arguments))
            kernel.compile(types)
            _known[key] = kernel.overloads[types].entry_point
        if key in _known:
            self._code, self._calls = _known[key], self._often

    def __reduce__(self) -> tuple[type[Entry], tuple[Callable[..., Any], int]]:
        return Entry, (self.kernel, self._often)  # a copy determines its machine code again


def undecorated(
    function: Callable[..., Any], instead: Mapping[Callable[..., Any], Callable[..., Any]] = {}
) -> Callable[..., Any]:
    """Return the plain Python function of a kernel, and of every kernel that it calls.

    The result runs the same source over any number type that supports ``+ - * /``, for example
    symbolic scalars in object arrays. Nothing is compiled. ``instead`` maps kernels to functions
    that replace them.
    """
    replaced = {id(getattr(kernel, "py_func", kernel)): other for kernel, other in instead.items()}
    return _undecorated(function, replaced)


def _undecorated(function: Any, done: dict[int, Callable[..., Any]]) -> Callable[..., Any]:
    plain = cast(FunctionType, getattr(function, "py_func", function))
    if id(plain) in done:
        return done[id(plain)]
    scope: dict[str, Any] = dict(plain.__globals__)
    copy = FunctionType(plain.__code__, scope, plain.__name__, plain.__defaults__)
    done[id(plain)] = copy
    for name in plain.__code__.co_names:
        callee = scope.get(name)
        module = getattr(getattr(callee, "py_func", callee), "__module__", None) or ""
        if callable(callee) and module.startswith("flexarm.") and not isinstance(callee, type):
            scope[name] = _undecorated(callee, done)
    return copy


notice = CompileNotice(kept=CACHE_DIRECTORY is not None)
register_listener(notice)


def compile_seconds() -> float:
    """Return the time in seconds that this process has spent compiling kernels."""
    return notice.seconds
