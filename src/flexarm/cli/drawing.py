"""Drawing of figures in other processes, so that Matplotlib loads while the simulations run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from flexarm.base.processes import process_pool, usable_cores

if TYPE_CHECKING:
    from flexarm.view.plot.paper.paper_data import Histories

_MOST_PROCESSES = 2  # more would not speed up the figures of the paper
_Task = tuple[Callable[..., None], tuple[object, ...]]


def load_plotting() -> None:
    """Import the modules for drawing."""
    import flexarm.cases.results
    import flexarm.view.plot.paper.paper_figures  # noqa: F401


def draw_figures(names: Sequence[str], case: Histories, folder: Path) -> None:
    """Save figures of the paper as PNG and PDF; also accepts "overview" and "theories"."""
    from flexarm.cases.results import write_figure
    from flexarm.view.plot.paper.paper_figures import FIGURES

    for name in names:
        figure = FIGURES[name](case)
        for suffix in (".png", ".pdf"):
            write_figure(figure, folder / f"{name}{suffix}")


class Drawing:
    """Pool of drawing processes as a context manager; its exit waits for all figures.

    If no processes are available, the figures are drawn in this one.
    """

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._tasks: list[tuple[Future[None] | None, _Task]] = []

    def __enter__(self) -> Drawing:
        processes = min(_MOST_PROCESSES, usable_cores())
        if processes > 1:
            try:
                self._pool = process_pool(processes, load_plotting)
            except (OSError, NotImplementedError, ImportError):  # no semaphores on this system
                self._pool = None
        return self

    def submit(self, function: Callable[..., None], *arguments: object) -> None:
        """Schedule a function call, in another process if possible."""
        future = None
        if self._pool is not None:
            try:
                future = self._pool.submit(function, *arguments)
            except BrokenProcessPool:
                self._pool = None
        self._tasks.append((future, (function, arguments)))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if error is None:
                for future, task in self._tasks:
                    _finish(future, *task)
        finally:
            if self._pool is not None:
                self._pool.shutdown(wait=error is None, cancel_futures=True)


def _finish(
    future: Future[None] | None, function: Callable[..., None], arguments: tuple[object, ...]
) -> None:
    if future is not None:
        try:
            future.result()
        except BrokenProcessPool:
            pass
        else:
            return
    function(*arguments)
