"""Compiled steps with sizes known to the compiler, and whole calls, compared with the peers.

The settings come from a scan over steps and tolerances of every integrator on several bases. They
are those within a factor of two of the fastest at one of the levels.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from benchmarks import programs
from benchmarks.arms import table_one
from benchmarks.table_one import CASE, EXACT, PAPER, peer_entries, second_order, truths
from benchmarks.work_precision import Entry, Outcome, Point, Run, fastest, measure
from flexarm.integrate import INTEGRATORS, Integrator

PROGRAM = "flexarm, steps alone"


class Level(NamedTuple):
    """An error that peers reach at low cost, and the goals for the ratio of times."""

    truth: str
    error: float  # m
    goal: float  # of the steps
    whole_goal: float | None = None  # of whole calls


LEVELS = (
    Level(EXACT, 1.2e-4, 40.0),
    Level(EXACT, 3.1e-5, 100.0, 30.0),
    Level(EXACT, 3.1e-6, 50.0),
    Level(PAPER, 3.1e-6, 40.0),
)
_BASES = {
    "2+1 elements": (table_one, PAPER),
    "3 modes": (partial(second_order, elements=16, modes=3), EXACT),
    "4 modes": (partial(second_order, elements=16, modes=4), EXACT),
    # With one segment per link, the second-order theory has an error of 1e-5 m for any modes.
    "2 segments of 5 modes": (partial(second_order, elements=20, modes=5, segments=2), EXACT),
    "3 segments of 4 modes": (partial(second_order, elements=12, modes=4, segments=3), EXACT),
}
#: Steps (divisors of the sample interval of 10 ms) and tolerances.
SCAN: dict[str, dict[str, tuple[float, ...]]] = {
    "2+1 elements": {
        "cowell_4": (1e-2 / 20, 1e-2 / 21),
        "rk4": (1e-2 / 15, 1e-2 / 16),
        "dormand_prince_8": (3e-3, 1e-3),
    },
    "3 modes": {
        "cowell_4": (1e-2 / 11,),
        "kennedy_carpenter_5": (5e-4, 3e-4),
    },
    "4 modes": {
        "cowell_4": (1e-2 / 20,),
        "kennedy_carpenter_5": (1e-3, 3e-4),
    },
    "2 segments of 5 modes": {"kennedy_carpenter_5": (2e-5, 1e-5, 5e-6)},
    "3 segments of 4 modes": {"kennedy_carpenter_5": (5e-6, 3e-6)},
}


def entries(
    scan: Mapping[str, Mapping[str, tuple[float, ...]]] = SCAN,
    duration: float = CASE.duration,
    specialized: bool = True,
) -> Iterator[Entry]:
    """Yield the scanned settings. Each integrator compiles once per basis, for about a minute."""
    case = replace(CASE, duration=duration)
    for basis, methods in scan.items():
        build, truth = _BASES[basis]
        for name, settings in methods.items():
            word = "rtol" if INTEGRATORS[name].adaptive else "step"
            for value in settings:
                how = {word: value, "specialized": specialized}

                def prepare(name=name, how=how, build=build) -> Run:  # type: ignore[no-untyped-def]
                    arm = build()
                    return lambda: _steps_alone(case, arm, name, **how)

                label = programs.tolerances(value)
                if word == "step":
                    label = f"step {1e3 * value:.3g} ms"
                yield Entry(PROGRAM, f"{name}, {basis}, {label}", truth, prepare)


def _steps_alone(case: programs.Case, arm: programs.fa.Arm, name: str, **how: Any) -> Outcome:
    """Run flexarm; the time is that of its compiled steps, without the preparation."""
    step = {"step": how.pop("step")} if "step" in how else {}
    method = INTEGRATORS[name](**step)
    spent = stopwatch(method)
    return Outcome(programs.simulate(case, arm, integrator=method, **how).path, sum(spent))


def stopwatch(method: Integrator) -> list[float]:
    """Record the seconds of each call of ``advance`` of an integrator; return the list."""
    advance, spent = method.advance, []

    def timed(*given: Any) -> Any:
        started = time.perf_counter()
        status = advance(*given)
        spent.append(time.perf_counter() - started)
        return status

    object.__setattr__(method, "advance", timed)  # the dataclasses are frozen
    return spent


def beside_peers(
    points: list[Point],
    repeats: int = 9,
    duration: float = CASE.duration,
    specialized: bool = True,
) -> tuple[list[Point], list[str]]:
    """Measure the scan alternately with the peers that are the fastest at a level in ``points``."""
    others = [point for point in points if point.program != "flexarm"]
    best = [
        fastest(others, level.truth, level.error, whole)
        for level in LEVELS
        for whole in (False, True)
    ]
    chosen = {(point.program, point.setting) for point in best if point is not None}
    peers = [entry for entry in peer_entries(duration) if entry[:2] in chosen]
    own = entries(duration=duration, specialized=specialized)
    return measure([*own, *peers], truths(duration), repeats)
