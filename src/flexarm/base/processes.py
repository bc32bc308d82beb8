"""Processes and threads: how many, and pools of processes."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from flexarm.base.arguments import check_count

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

T = TypeVar("T")
#: Remaining duration of calls (s) for which processes, which start in a few seconds, are worth it.
WORTH = 6.0


def check_workers(name: str, value: object) -> int:
    """Return a number of threads or processes; None for one for each usable core.

    Raises:
        InputError: if the value is not a whole number from 1 to 1024.
    """
    return usable_cores() if value is None else check_count(name, value, most=1024)


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):  # absent on Windows and macOS
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


#: Limits of the threads of algebra in use: one, and the number of contexts that share it.
_limits: list[Any] = []
_users = 0
_lock = threading.Lock()


@contextmanager
def single_threaded_algebra() -> Iterator[None]:
    """Let matrix products and factors of NumPy and SciPy use one thread in this process.

    The matrices of controllers are small: several threads take up to 40 times as long where other
    programs keep the cores busy, and the last bits of results would depend on their number.
    Contexts of several threads may overlap: the last one that ends restores the number.
    """
    global _users
    pools = _thread_pools()
    with _lock:
        _users += 1
        if _users == 1 and pools is not None:
            _limits.append(pools.limit(limits=1, user_api="blas"))
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0 and _limits:
                _limits.pop().restore_original_limits()


@cache
def _thread_pools() -> Any:
    """Return the pools of threads of this process; None without the library, as in a browser."""
    try:
        from threadpoolctl import ThreadpoolController
    except ImportError:
        return None
    return ThreadpoolController()


def in_processes(
    function: Callable[..., T], arguments: Sequence[tuple[Any, ...]], workers: int
) -> Iterator[T]:
    """Yield the results of calls in their order; if they take long, of several processes.

    The first calls are made in this process, and all of them if no processes are available. Each
    process receives the function with its data once.
    """
    started, count = 0.0, len(arguments)
    for done, given in enumerate(arguments):
        yield function(*given)
        if done == 0:  # this call may have loaded or compiled code
            started = time.perf_counter()
            continue
        left = (time.perf_counter() - started) / done * (count - done - 1)
        if workers > 1 and left > WORTH:
            yield from _by_pool(function, arguments[done + 1 :], workers)
            return


def _by_pool(
    function: Callable[..., T], arguments: Sequence[tuple[Any, ...]], workers: int
) -> Iterator[T]:
    from concurrent.futures.process import BrokenProcessPool

    done = 0
    try:
        with process_pool(min(workers, len(arguments)), _keep, function) as pool:
            for result in pool.map(_call, arguments):
                yield result
                done += 1
    except (BrokenProcessPool, OSError, NotImplementedError, ImportError):
        for given in arguments[done:]:
            yield function(*given)


_kept: list[Callable[..., Any]] = []


def _keep(function: Callable[..., Any]) -> None:
    _kept[:] = [function]


def _call(arguments: tuple[Any, ...]) -> Any:
    return _kept[0](*arguments)


def process_pool(
    processes: int, start: Callable[..., object], *arguments: object
) -> ProcessPoolExecutor:
    """Return a pool of processes, each of which first calls ``start(*arguments)``.

    Ctrl-C ends them without a traceback. A system without processes or semaphores raises one of
    OSError, NotImplementedError and ImportError.
    """
    # Imported here, because most programs start no processes.
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # Use spawn, because forked copies of a process with compiled threads may hang.
    pool = ProcessPoolExecutor(processes, get_context("spawn"), _started, (start, arguments))
    with _ctrl_c_ignored():  # while they start; the first task starts them all
        pool.submit(int)
    return pool


def _started(start: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    start(*arguments)


@contextmanager
def _ctrl_c_ignored() -> Iterator[None]:
    """Make processes started in this context ignore Ctrl-C."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set signal handlers
        return
    theirs = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, theirs)
