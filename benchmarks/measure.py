"""Timing of candidates: warm-up, alternating calls, medians."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping


def in_turns(
    candidates: Mapping[str, Callable[[], object]], repeats: int, calls: int = 1
) -> dict[str, float]:
    """Time several candidates alternately; return the median seconds per call of each.

    Many short turns are better than a few long ones: a turn that fits into one time slice of the
    scheduler is disturbed either completely, which the median ignores, or not at all.
    """
    for call in candidates.values():
        call()
    times: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(repeats):
        for name, call in candidates.items():
            started = time.perf_counter()
            for _ in range(calls):
                call()
            times[name].append((time.perf_counter() - started) / calls)
    return {name: statistics.median(values) for name, values in times.items()}
