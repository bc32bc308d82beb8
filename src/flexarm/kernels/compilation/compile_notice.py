"""Progress messages and timing of the compilation of kernels."""

from __future__ import annotations

import atexit
import sys
import time
from typing import Any

from flexarm.kernels.compilation.code_cache import CodeCache
from flexarm.kernels.compilation.numba_internals import Listener


class CompileNotice(Listener):  # type: ignore[misc]
    """Listener that reports on the terminal which kernel compiles and how long compilation took."""

    def __init__(self, kept: bool) -> None:
        """Create a listener; ``kept``: whether there is a folder to save machine code in."""
        self._kept = kept
        self._depth = 0
        self._started = 0.0
        self._announced = False
        self.silent = False
        self.seconds = 0.0
        self.kernels = 0

    def _is_ours(self, occurrence: Any) -> bool:
        function = occurrence.data["dispatcher"].py_func
        return str(function.__module__).startswith("flexarm.")

    def on_start(self, occurrence: Any) -> None:
        if not self._is_ours(occurrence):
            return
        if self._depth == 0:
            self._started = time.perf_counter()
            if not self.silent and sys.stderr is not None:
                self._announce(occurrence.data["dispatcher"].py_func.__name__)
        self._depth += 1

    def _announce(self, kernel: str) -> None:
        """Print one line once and, on a terminal, a second line with the current kernel."""
        if not self._announced:
            self._announced = True
            print(
                "flexarm: compiling for this machine, once; it may take half a minute ...",
                file=sys.stderr,
                flush=True,
            )
            atexit.register(self._print_time)
        if sys.stderr.isatty():
            line = f"  {kernel} ({self.kernels} compiled in {self.seconds:.0f} s)"
            print(f"\r\x1b[K{line}", end="", file=sys.stderr, flush=True)

    def _print_time(self) -> None:
        """Print the total time when the process ends, because more may compile until then."""
        kept = "the result is kept for the next start."
        if not self._kept:
            kept = "the result is not kept: no folder is writable by this user alone."
        elif CodeCache.failure:
            kept = f"the result is not kept: {CodeCache.failure}."
        if sys.stderr is not None:
            print(f"flexarm: compiling took {self.seconds:.0f} s; {kept}", file=sys.stderr)

    def on_end(self, occurrence: Any) -> None:
        if not self._is_ours(occurrence):
            return
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._started
            self.kernels += 1
            if self._announced and sys.stderr is not None and sys.stderr.isatty():
                print("\r\x1b[K", end="", file=sys.stderr, flush=True)
