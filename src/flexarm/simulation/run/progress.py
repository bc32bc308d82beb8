"""Progress bar of runs that take longer than a second."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

from flexarm.base.arguments import check_flag

#: Time (s) after which the bar appears.
PATIENCE = 1.0
#: The same for the first line of a stream that is not a terminal, and the fraction between lines.
PATIENCE_FOR_LINES, PART = 10.0, 0.05

#: Function that receives the completed fraction of a task, 0 to 1.
Report = Callable[[float], None]


def unreported(_: float) -> None:
    """Do not report the completed fraction."""


def stage(report: Report, first: float, last: float) -> Report:
    """Return the report of a stage of a task, from a fraction of the task to another one."""
    return lambda fraction: report(first + (last - first) * fraction)


class Meter:
    """Progress bar of a run, on the error stream.

    Args:
        label: description of the running task.
        shown: True shows the bar even if the stream is not a terminal, None only on a terminal,
            False never.
        lines: whether None writes lines to a stream that is not a terminal.
    """

    def __init__(self, label: str, shown: bool | None = None, lines: bool = False) -> None:
        if shown is not None:
            check_flag("progress", shown)
        self._label = label
        self._forced = shown is True
        self._requested = sys.stderr.isatty() if shown is None else shown
        self._lines = lines and shown is None and not self._requested
        self._written = 0.0  # fraction of the last line
        self._start = time.perf_counter()
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> Meter:
        return self

    def update(self, fraction: float) -> None:
        """Report the completed fraction, 0 to 1."""
        if self._lines:
            self._write(fraction)
        if not self._requested:
            return
        if self._bar is None:
            if time.perf_counter() - self._start < PATIENCE:
                return
            self._open()
        self._bar.update(self._task, completed=fraction)

    def _write(self, fraction: float) -> None:
        """Write a line if the task takes long and a larger part of it is complete."""
        passed = time.perf_counter() - self._start
        if passed > PATIENCE_FOR_LINES and fraction - self._written >= PART:
            self._written = fraction
            left = passed * (1.0 - fraction) / fraction
            text = f"{self._label}: {100.0 * fraction:.0f} %, {left:.0f} s left"
            print(text, file=sys.stderr, flush=True)

    def _open(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
        from rich.progress import TimeRemainingColumn as TimeColumn

        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeColumn(),
            console=Console(stderr=True, force_terminal=self._forced or None),
            transient=True,
        )
        self._task = self._bar.add_task(self._label, total=1.0)
        self._bar.start()

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.stop()
