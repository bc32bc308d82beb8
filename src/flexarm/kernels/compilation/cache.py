"""Kernels: functions with machine code, of the library of kernels or compiled by Numba.

`library` has the code that was built in advance, for all sizes of arms. Numba is imported only for
code that is not there: other types of arguments, sizes at compile time, kernels of users, and
edited sources.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from types import FunctionType
from typing import Any, TypeVar, cast

from flexarm.base.errors import InputError, Problem
from flexarm.kernels.compilation import library

F = TypeVar("F", bound=Callable[..., Any])

#: Whether kernels are plain Python functions.
INTERPRETED = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
#: Functions that tell Numba about types and functions of kernels.
_declarations: list[Callable[[], object]] = []


def before_compiling(declare: F) -> F:
    """Call ``declare`` before Numba compiles the first kernel; never if it does not compile."""
    _declarations.append(declare)
    return declare


def has_number_types() -> bool:
    """Return whether kernels compute with packs and dual numbers; plain Python does not."""
    if INTERPRETED:
        return False
    if library.loaded() is not None:
        return True
    return can_compile() and bool(
        import_module("flexarm.kernels.compilation.numba_internals").HAS_NUMBER_TYPES
    )


def declare_all() -> None:
    """Tell Numba about all types and functions of the kernels that are imported so far."""
    while _declarations:
        _declarations.pop(0)()


def can_compile() -> bool:
    """Return whether Numba is there for code that the library does not have."""
    return library.CHOICE != "library" and find_spec("numba") is not None


def _compiler(kernel: str) -> Any:
    """Return the module that compiles with Numba.

    Raises:
        InputError: if Numba is not installed, or not wanted.
    """
    if not can_compile():
        rule = f"has no machine code for these arguments; {library.reason()}"
        hint = "With pip install 'flexarm[jit]' it is compiled."
        if library.CHOICE == "library":
            hint = "FLEXARM_KERNELS=library forbids to compile it."
        raise InputError(Problem(f"the kernel {kernel}", rule, hint=hint))
    return import_module("flexarm.kernels.compilation.jit")


class Kernel:
    """A function with machine code for each combination of types of its arguments.

    Attributes:
        py_func: the plain function. options: those of Numba's compiler. apart: whether other
        kernels refer to its code instead of containing it. merged: whether it has no code of its
        own. inside: whether only kernels can call it.
    """

    __module__: str
    __name__: str
    __qualname__: str

    def __init__(
        self,
        function: Callable[..., Any],
        apart: bool = False,
        merged: bool = False,
        inside: bool = False,
        **options: Any,
    ) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self.options = function, options
        self.apart, self.merged, self.inside = apart, merged, inside
        self._codes: dict[library.Kinds, Callable[..., Any]] = {}

    @functools.cached_property
    def dispatcher(self) -> Any:
        """The same kernel as a function of Numba."""
        return _compiler(self.__name__).dispatcher(self)

    def __call__(self, *arguments: Any) -> Any:
        """Call the machine code for these arguments."""
        kinds: list[Any] = []
        words: list[Any] = []
        library.flatten(arguments, kinds, words)
        code = self.code(tuple(kinds), arguments)
        return code(words) if isinstance(code, library.Code) else code(*arguments)

    def code(self, kinds: library.Kinds, arguments: tuple[Any, ...]) -> Callable[..., Any]:
        """Return the code for kinds of arguments: of the library, called with their words, or of
        Numba, called with arguments.

        Raises:
            TypeError: if only kernels can call this one.
            InputError: if the library does not have the code, and Numba is not installed.
        """
        try:
            return self._codes[kinds]
        except KeyError:
            pass
        if self.inside:
            name = f"{self.__name__} is compiled for other kernels alone"
            raise TypeError(f"{name}; see kernels.compilation.cache.apart")
        kernels = library.loaded()
        name = f"{self.__module__}.{self.__qualname__}"
        code = kernels.code(name, kinds) if kernels else None
        self._codes[kinds] = code or _compiler(name).code(self, kinds, arguments)
        return self._codes[kinds]

    @property
    def _numba_type_(self) -> Any:
        """Type of the kernel for functions of Numba that call it."""
        return _compiler(self.__name__).type_of(self)

    def __reduce__(self) -> str:
        return self.__qualname__  # pickled by its name


class KernelIntrinsic:
    """A function of kernels that a module for Numba defines; imported when Numba compiles."""

    def __init__(self, module: str, name: str) -> None:
        self._module, self._name = module, name

    @property
    def _numba_type_(self) -> Any:
        """Type of the function for kernels that call it."""
        module = import_module(f"flexarm.kernels.compilation.{self._module}")
        return _compiler(self._name).type_of(getattr(module, self._name))


def _decorate(function: F, **options: Any) -> F:
    return function if INTERPRETED else cast(F, Kernel(function, **options))


def compiled(function: F) -> F:
    """Give a kernel machine code for each combination of types of arguments.

    Python and kernels can call it. Its machine code exists once: kernels refer to it.
    """
    return _decorate(function, apart=True)


def unlocked(function: F) -> F:
    """Make a kernel like ``compiled``, whose calls let other threads of Python continue.

    Use it for kernels that run for a long time; for the others it costs more than it saves.
    """
    return _decorate(function, apart=True, nogil=True)


def apart(function: F) -> F:
    """Make a kernel that only kernels call, without the code that unpacks Python's arguments.

    That code often takes longer to compile than the kernel. A call from Python raises TypeError;
    ``undecorated`` returns the plain function. As with ``compiled``, kernels refer to it.
    """
    return _decorate(function, apart=True, inside=True)


def inner(function: F) -> F:
    """Make a small kernel that only kernels call; the compiler may merge it into its callers."""
    return _decorate(function, inside=True)


def merged(function: F) -> F:
    """Compile a kernel into its callers, because passing the arrays costs as much as the kernel.

    Only kernels can call it, as with ``apart``. Use it in hot loops; elsewhere, an ordinary call
    compiles faster.
    """
    return _decorate(function, inside=True, merged=True, forceinline=True)


class Entry:
    """Entry point of a kernel for repeated calls with arguments that are mostly the same objects.

    Only arguments that are other objects than in the last call are prepared again, which for all
    arrays of an arm would take as long as some kernels. An entry point keeps its last arguments and
    serves one thread.
    """

    __slots__ = ("_block", "_code", "_kinds", "_last", "_places", "_words", "kernel")

    def __init__(self, kernel: Callable[..., Any]) -> None:
        self.kernel = kernel
        self._last: tuple[Any, ...] = ()
        self._code: Callable[..., Any] = kernel  # a plain function
        self._kinds: list[library.Kinds] = []  # of each argument
        self._places: list[int] = []  # first word of each argument
        self._words: list[Any] = []
        self._block = b""

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel."""
        last = self._last
        if len(arguments) != len(last):
            self._prepare(arguments)
        else:
            changed = [k for k, value in enumerate(arguments) if value is not last[k]]
            if changed:
                self._last = ()  # until all is ready again: an error or Ctrl-C may come between
                if all(self._is_replaced(k, arguments[k]) for k in changed):
                    self._set(arguments)
                else:
                    self._prepare(arguments)
        if isinstance(self._code, library.Code):
            return self._code.run(self._block)
        return self._code(*arguments)

    def _is_replaced(self, k: int, value: Any) -> bool:
        """Put another value into the words; return whether it has the same kinds."""
        kinds: list[Any] = []
        words: list[Any] = []
        library.flatten((value,), kinds, words)
        if self._kinds[k] != tuple(kinds):
            return False
        place = self._places[k]
        self._words[place : place + len(words)] = words
        return True

    def _prepare(self, arguments: tuple[Any, ...]) -> None:
        """Determine all words, and look up the code."""
        self._last = ()
        if not isinstance(self.kernel, Kernel):
            return
        self._kinds, self._places, self._words = [], [], []
        for value in arguments:
            kinds: list[Any] = []
            self._places.append(len(self._words))
            library.flatten((value,), kinds, self._words)
            self._kinds.append(tuple(kinds))
        together = tuple(kind for kinds in self._kinds for kind in kinds)
        self._code = self.kernel.code(together, arguments)
        self._set(arguments)

    def _set(self, arguments: tuple[Any, ...]) -> None:
        if isinstance(self._code, library.Code):
            self._block = self._code.block(self._words)
        self._last = arguments

    def __deepcopy__(self, memo: dict[int, Any]) -> Entry:
        return Entry(self.kernel)  # a copy determines its words again

    def __reduce__(self) -> tuple[type[Entry], tuple[Callable[..., Any]]]:
        return Entry, (self.kernel,)


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


def compile_seconds() -> float:
    """Return the time in seconds that this process has spent compiling kernels."""
    compiler: Any = sys.modules.get("flexarm.kernels.compilation.jit")
    return compiler.notice.seconds if compiler else 0.0
