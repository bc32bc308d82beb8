"""A flexible four-bar under gravity: error and time of flexarm and of Exudyn.

`python -m benchmarks.closed_loop` prints a table; without Exudyn it has the rows of flexarm alone.
All times are those of the integration on one core, the best of some runs that alternate.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from importlib.util import find_spec

import numpy as np
from peers.closed_chain import FOUR_BAR, mechanism, prepare

import flexarm as fa

CASE = replace(FOUR_BAR, rate=100)
#: Settings of flexarm: segments and modes of a link, and relative tolerance.
SETTINGS = ((1, 2, 1e-3), (1, 3, 1e-3), (1, 3, 1e-4), (1, 3, 3e-5), (2, 3, 1e-4), (2, 3, 1e-5))
EXUDYN = ((4, 1e-3), (4, 5e-4), (4, 2.5e-4), (8, 2.5e-4))
#: Runs of each setting.
ROUNDS = 6
#: Ratio of times at equal error.
GOAL = 50.0
#: Settings of the reference.
FINEST = (4, 3, 1e-7)


def prepared(segments: int, modes: int, rtol: float) -> Callable[[], np.ndarray]:
    """Return a function that integrates the mechanism and gives the path of the rocker's tip."""
    arm, start = mechanism(CASE, segments, modes)

    def run() -> np.ndarray:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
            result = fa.simulate(
                arm,
                CASE.duration,
                initial=start.q,
                initial_rate=start.qd,
                rate=CASE.rate,
                rtol=rtol,
                integrator="kennedy_carpenter_5",
            )
        return np.asarray(result.tip.values)

    return run


def rows() -> Iterator[tuple[str, float, float]]:
    """Yield name, largest error (m) and time (s)."""
    finest = prepared(*FINEST)()
    entries: list[tuple[str, Callable[[], Callable[[], np.ndarray]]]] = [
        (f"flexarm, segments a link {k}, modes {m}, rtol {rtol:g}", partial(prepared, k, m, rtol))
        for k, m, rtol in SETTINGS
    ]
    if find_spec("exudyn") is None:
        print("SKIPPED: Exudyn is not installed: rows of flexarm alone.")
    else:
        entries += [
            (f"Exudyn, {k} elements, step {step:g} s", partial(prepare, CASE, k, step))
            for k, step in EXUDYN
        ]
    best = dict.fromkeys((name for name, _ in entries), np.inf)
    paths = {name: make()() for name, make in entries}  # machine code
    for _ in range(ROUNDS):
        for name, make in entries:
            run = make()
            started = time.perf_counter()
            run()
            best[name] = min(best[name], time.perf_counter() - started)
    for name, path in paths.items():
        yield name, float(np.max(np.linalg.norm(path - finest, axis=1))), best[name]


def table(measured: Sequence[tuple[str, float, float]]) -> str:
    """Return a table with the ratio to the fastest setting of flexarm with at most the error."""
    lines = ["| program | largest error (m) | time (ms) | ratio |", "| --- | --- | --- | --- |"]
    for name, error, seconds in measured:
        rivals = [t for other, e, t in measured if other.startswith("flexarm") and e <= error]
        ratio = "" if name.startswith("flexarm") or not rivals else f"{seconds / min(rivals):.3g}"
        lines.append(f"| {name} | {error:.1e} | {1e3 * seconds:.3g} | {ratio} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    print(table(list(rows())))


if __name__ == "__main__":
    main()
