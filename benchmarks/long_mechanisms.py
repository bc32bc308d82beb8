"""A free four-bar over many steps: gaps of its closure and drift of its energy, by method.

`python -m benchmarks.long_mechanisms 100000` prints the table of docs/performance/accuracy.md.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

import flexarm as fa
from flexarm.integrate import INTEGRATORS

#: Samples of a run, and seconds of the run that predicts how long the steps last.
SAMPLES, FIRST = 200, 2.0
#: Step of methods with fixed steps, s: a third of the longest stable one.
STEP = 1e-4


@dataclass(frozen=True)
class Drift:
    """Largest values of a run."""

    name: str
    steps: int
    duration: float  # s
    gap: float  # of the reach
    energy: float  # of the energy at the start, at the end
    trend: float  # largest deviation of the energy, of that at the start


def four_bar(flexible: bool = True) -> fa.Arm:
    """Return a crank-rocker of slender bars without damping and gravity."""
    bar = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2, "flexible": flexible}
    links = [fa.Link(length=length, **bar) for length in (0.3, 0.9, 0.7)]
    links[2] = links[2].replace(parent=0)
    joints = [fa.Joint(), fa.Joint(), fa.Joint(offset=(1.0, 0.0))]
    return fa.Arm(links=links, joints=joints, closures=[fa.Closure(link=2, to_link=3)])


def drift(arm: fa.Arm, method: str, steps: int) -> Drift:
    """Run a four-bar whose crank starts with 6 rad/s for about a number of steps."""
    start = fa.assembled(arm, arm.rest([0.7, -0.4, 1.4]), arm.rest([6.0, 0.0, 0.0]), held=[1])
    fixed = {} if INTEGRATORS[method].adaptive else {"step": STEP}

    def run(duration: float):  # type: ignore[no-untyped-def]
        options = {"initial": start.q, "initial_rate": start.qd, "progress": False, **fixed}
        rate = SAMPLES / duration
        return fa.simulate(arm, duration, integrator=method, rate=rate, **options)

    duration = FIRST * steps / run(FIRST).attrs["steps"]
    result = run(duration)
    gaps = [np.max(np.abs(arm.closure_gaps(q))) for q in result.q.values]
    states = zip(result.q.values, result.qd.values, strict=True)
    energies = np.array([sum(arm.energy(q, qd)) for q, qd in states])
    change = energies / energies[0] - 1.0
    return Drift(
        name=method,
        steps=int(result.attrs["steps"]),
        duration=duration,
        gap=float(np.max(gaps)) / arm.reach,
        energy=float(change[-1]),
        trend=float(np.max(np.abs(change))),
    )


def main() -> None:
    """Print a row for each kind of links and each method that follows closures."""
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    print("| links | method | steps | duration | gap, of the reach | energy at the end | largest |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: |")
    for flexible in (True, False):
        for name, method in INTEGRATORS.items():
            if method.follows_closures:
                row = drift(four_bar(flexible), name, steps)
                kind = "flexible" if flexible else "rigid"
                print(
                    f"| {kind} | `{row.name}` | {row.steps:,} | {row.duration:.3g} s "
                    f"| {row.gap:.1e} | {row.energy:+.1e} | {row.trend:.1e} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
