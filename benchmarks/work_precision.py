"""Error against time: entries of any program on one problem, measured in turns."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from flexarm import SimulationError


class Outcome(NamedTuple):
    """What one run of one entry gave."""

    path: np.ndarray  # (samples, 2) of the tip, m
    seconds: float  # for the integration alone


#: Integrates once. Built afresh by ``Entry.prepare`` for each repeat.
Run = Callable[[], Outcome]


class Entry(NamedTuple):
    """A program and a setting of it."""

    program: str
    setting: str
    truth: str  # what its path is compared with
    prepare: Callable[[], Run]  # build the model


class Point(NamedTuple):
    """One entry, measured."""

    program: str
    setting: str
    truth: str
    error: float  # m, largest distance of the tip over the samples
    seconds: float  # median, of the integration alone
    total: float  # median, with building the model and handing over the result


def timed(integrate: Callable[[], np.ndarray], path: Callable = np.asarray) -> Run:  # type: ignore[type-arg]
    """Time a call; ``path`` makes the tip's path of its answer, and is not timed."""

    def run() -> Outcome:
        started = time.perf_counter()
        answer = integrate()
        seconds = time.perf_counter() - started
        return Outcome(path(answer), seconds)

    return run


def measure(
    entries: Sequence[Entry], truths: dict[str, np.ndarray], repeats: int
) -> tuple[list[Point], list[str]]:
    """Run every entry once, then ``repeats`` times in turns.

    Returns the points, and a sentence for each entry that failed: too long a step, say.
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
    """Return the fastest of the points that are at least so accurate, or None.

    The fastest integration or, with ``whole``, the fastest in total.
    """
    good = [point for point in points if point.truth == truth and point.error <= error]
    return min(good, key=lambda point: point.total if whole else point.seconds, default=None)
