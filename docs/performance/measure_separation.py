"""The separation against the full model: the table of the page "Accuracy".

The arm of Table I, two elements on link 1 and one on link 2, goes along the paper's line under the
rigid torques of its motion. Errors are the largest of the link tips' deflection, over the largest
deflection, against a full model with small tolerances: the default ones allow errors of the bending
of a stiff arm. Times are those of a whole call, the shortest of all repeats; cases take turns.

    python docs/performance/measure_separation.py
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import NamedTuple

import xarray as xr

import flexarm as fa


class Case(NamedTuple):
    """One line of the table."""

    name: str
    duration: float  # s
    rigidity: float = 105.0  # N m^2
    elements: tuple[int, int] = (2, 1)


CASES = (
    Case("Table I, half speed", 4.0),
    Case("Table I", 2.0),
    Case("Table I, twice the speed", 1.0),
    Case("ten times stiffer", 1.0, 1050.0),
    Case("hundred times stiffer", 1.0, 10500.0),
    Case("Table I, 8 elements a link", 2.0, 105.0, (8, 8)),
)


class Row(NamedTuple):
    """What is measured of a case."""

    case: Case
    deflection: float  # m, the largest of the full model
    errors: tuple[float, float]  # of both methods, parts of that
    ratios: tuple[float, float]  # their time over that of the full model


def runs(case: Case) -> list[Callable[[], xr.Dataset]]:
    """The full model, by default and closely, the separation, and the quasi-static estimate."""
    links = [
        fa.Link(
            length=length,
            flexural_rigidity=case.rigidity,
            mass_per_length=0.61732,
            elements=elements,
        )
        for length, elements in zip((1.4142, 1.0), case.elements, strict=True)
    ]
    arm = fa.Arm(links=links)
    line = fa.line_motion(arm, start=(2.0, 1.0), end=(1.0, 2.0), duration=case.duration)
    run = {"torque": fa.rigid_torque(arm, line), "progress": False}
    return [
        lambda: fa.simulate(arm, case.duration, **run),
        lambda: fa.simulate(arm, case.duration, rtol=1e-9, **run),
        lambda: fa.simulate_separated(arm, line),
        lambda: fa.simulate_separated(arm, line, method="quasi_static"),
    ]


def measure(case: Case, repeats: int) -> Row:
    calls = runs(case)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        _, full, *others = (call() for call in calls)  # compiles, if need be
        rounds = [_timed([calls[0], *calls[2:]]) for _ in range(repeats)]
        seconds = [min(times) for times in zip(*rounds, strict=True)]
    largest = float(abs(full.link_tip_deflection).max())
    errors = [float(abs(other - full).link_tip_deflection.max()) / largest for other in others]
    ratios = [own / seconds[0] for own in seconds[1:]]
    return Row(case, largest, (errors[0], errors[1]), (ratios[0], ratios[1]))


def _timed(calls: list[Callable[[], xr.Dataset]]) -> list[float]:
    found = []
    for call in calls:
        started = time.perf_counter()
        call()
        found.append(time.perf_counter() - started)
    return found


def table(rows: list[Row]) -> str:
    head = ("arm", "duration s", "deflection mm", "separated", "quasi-static")
    times = ("separated takes, of the full time", "quasi-static")
    lines = [
        f"| {' | '.join((*head, *times))} |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        first, second = (f"{100.0 * error:.2g} %" for error in row.errors)
        lines.append(
            f"| {row.case.name} | {row.case.duration:g} | {1e3 * row.deflection:.2g} | {first} | "
            f"{second} | {row.ratios[0]:.2g} | {row.ratios[1]:.2g} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    print(table([measure(case, repeats=15) for case in CASES]))
