"""Error against time: entries of any program for one problem, measured alternately."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from flexarm import SimulationError


class Outcome(NamedTuple):
    """Result of one run of one entry."""

    path: np.ndarray  # (samples, 2) of the tip, m
    seconds: float  # for the integration alone


#: A function that integrates once. ``Entry.prepare`` creates a new one for each repeat.
Run = Callable[[], Outcome]


class Entry(NamedTuple):
    """A program and one of its settings."""

    program: str
    setting: str
    truth: str  # name of the reference solution
    prepare: Callable[[], Run]  # build the model


class Point(NamedTuple):
    """The measurement of one entry."""

    program: str
    setting: str
    truth: str
    error: float  # m, largest distance of the tip over the samples
    seconds: float  # median, of the integration alone
    total: float  # median, with the creation of the model and the return of the result


def timed(integrate: Callable[[], np.ndarray], path: Callable = np.asarray) -> Run:  # type: ignore[type-arg]
    """Time a call; ``path`` converts its answer to the path of the tip and is not timed."""

    def run() -> Outcome:
        started = time.perf_counter()
        answer = integrate()
        seconds = time.perf_counter() - started
        return Outcome(path(answer), seconds)

    return run


def measure(
    entries: Sequence[Entry], truths: dict[str, np.ndarray], repeats: int
) -> tuple[list[Point], list[str]]:
    """Run every entry once, then all entries ``repeats`` times alternately.

    Returns the points, and a sentence for each entry that failed, for example with a step that is
    too long.
    """
    working, failed = [], []
    errors = {}
    for entry in entries:
        try:
            path = entry.prepare()().path
        except (RuntimeError, SimulationError) as error:
            failed.append(f"{entry.program}, {entry.setting}: {str(error).splitlines()[0]}")
            continue
        working.append(entry)
        distances = np.linalg.norm(path - truths[entry.truth], axis=1)
        errors[id(entry)] = float(np.max(distances))
    times: dict[int, list[tuple[float, float]]] = {id(entry): [] for entry in working}
    for _ in range(repeats):
        for entry in working:
            started = time.perf_counter()
            seconds = entry.prepare()().seconds
            times[id(entry)].append((seconds, time.perf_counter() - started))
    points = [
        Point(
            *entry[:3],
            errors[id(entry)],
            *(statistics.median(column) for column in zip(*times[id(entry)], strict=True)),
        )
        for entry in working
    ]
    return points, failed


def fastest(points: Iterable[Point], truth: str, error: float, whole: bool = False) -> Point | None:
    """Return the fastest of the points with at most the given error, or None.

    It has the fastest integration or, with ``whole``, the smallest total time.
    """
    good = [point for point in points if point.truth == truth and point.error <= error]
    return min(good, key=lambda point: point.total if whole else point.seconds, default=None)
