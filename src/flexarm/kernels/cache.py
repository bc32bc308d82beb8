"""Compile kernels with Numba and keep the machine code on disk, never stale.

Numba's own disk cache looks only at the file of the function that is called: after an edit of a
kernel that it calls, it would go on serving the old physics without a word. Therefore the cache
directory is named by a hash of every source that takes part (``kernels/`` and ``integrate/``):
another source, another directory.

Numba reads ``numba.config.CACHE_DIR`` while it decorates a function. We set it for that moment only
and put it back, so that the caches of other packages in the same process stay where they are.
"""

from __future__ import annotations

import atexit
import hashlib
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
from numba.core import event
from numba.core.cpu import CPUTargetOptions
from platformdirs import user_cache_dir

F = TypeVar("F", bound=Callable[..., Any])

#: Packages whose sources decide what the machine code says.
_SOURCE_FOLDERS = ("kernels", "integrate")
#: Floating-point freedoms that change the last digits but never hide a NaN or an infinity.
_FAST = {"contract", "nsz", "arcp"}
_UNUSED_CACHE_SECONDS = 60 * 24 * 3600


def _source_hash() -> str:
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    for folder in _SOURCE_FOLDERS:
        for path in sorted((package / folder).glob("*.py")):
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_directory() -> Path:
    """Directory for this version of the sources; a temporary one where the home is read-only."""
    root = Path(user_cache_dir("flexarm"))
    directory = root / f"kernels-{_source_hash()}"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError:
        return Path(tempfile.gettempdir()) / "flexarm" / directory.name
    _forget_unused(root, keep=directory)
    return directory


def _forget_unused(root: Path, keep: Path) -> None:
    """Remove the machine code of sources that nobody has used for two months."""
    (keep / ".used").touch()
    for old in root.glob("kernels-*"):
        stamp = old / ".used"
        if old != keep and stamp.exists():
            age = time.time() - stamp.stat().st_mtime
            if age > _UNUSED_CACHE_SECONDS:
                shutil.rmtree(old, ignore_errors=True)


CACHE_DIRECTORY = _cache_directory()


def _options() -> dict[str, Any]:
    """Options of every kernel.

    Kernels own no memory: arrays come in, arrays go out. Without Numba's reference counting they
    run three times as fast (an atomic counter at each array access otherwise). The option has no
    documented name, so a Numba that does not know it compiles without.
    """
    options: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": _FAST}
    if hasattr(CPUTargetOptions, "_nrt"):
        options["_nrt"] = False
    return options


def _decorate(function: F, **more: Any) -> F:
    config: Any = numba.config
    theirs, config.CACHE_DIR = config.CACHE_DIR, str(CACHE_DIRECTORY)
    try:
        return cast(F, numba.njit(**_options(), **more)(function))
    finally:
        config.CACHE_DIR = theirs


def compiled(function: F) -> F:
    """Compile a kernel on first use, for each combination of argument types, cached on disk."""
    return _decorate(function)


def merged(function: F) -> F:
    """Compile a pass of a kernel into its callers: passing all the arrays costs as much as it."""
    return _decorate(function, forceinline=True)


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


def undecorated(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the plain Python function behind a kernel, and behind every kernel that it calls.

    The result runs the very same source over any number type that knows ``+ - * /``: symbolic
    scalars in object arrays, for example. Nothing is compiled.
    """
    return _undecorated(function, {})


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


class _CompileNotice(event.Listener):
    """Say once on the terminal that the first run compiles, and how long it took."""

    def __init__(self) -> None:
        self._depth = 0
        self._started = 0.0
        self._announced = False
        self.seconds = 0.0

    def _is_ours(self, occurrence: Any) -> bool:
        function = occurrence.data["dispatcher"].py_func
        return str(function.__module__).startswith("flexarm.")

    def on_start(self, occurrence: Any) -> None:
        if not self._is_ours(occurrence):
            return
        if self._depth == 0:
            self._started = time.perf_counter()
            if not self._announced:
                self._announced = True
                print(
                    "flexarm: compiling for this machine, once; it may take a minute ...",
                    file=sys.stderr,
                    flush=True,
                )
                atexit.register(self._tell_time)
        self._depth += 1

    def _tell_time(self) -> None:
        """Close the account when the process ends: only then is nothing left to compile."""
        print(
            f"flexarm: compiling took {self.seconds:.0f} s; the result is kept for the next start.",
            file=sys.stderr,
        )

    def on_end(self, occurrence: Any) -> None:
        if not self._is_ours(occurrence):
            return
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._started


_notice = _CompileNotice()
event.register("numba:compile", _notice)  # type: ignore[no-untyped-call]


def compile_seconds() -> float:
    """Seconds that this process has spent compiling kernels so far."""
    return _notice.seconds
