"""Fixed-step methods called without a step, on random arms: errors of the tip, failures and cost.

Two of three arms have joint springs, friction, stops, geared rotors, loads and a moving base.

    python docs/performance/measure_default_step.py [ARMS]
"""

from __future__ import annotations

import itertools
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

import flexarm as fa
from flexarm.integrate import INTEGRATORS
from random_arms import random_spec, random_state
from random_options import busy

ARMS, DURATION, RATE = 120, 0.5, 100.0
#: Steps of the fastest vibration beyond which an arm is left out: it would take minutes.
MOST_RADIANS = 5e3
METHODS = tuple(name for name, kind in INTEGRATORS.items() if not kind.adaptive)
#: A wrong result is one that errs by more than this part of the reach.
WRONG = 1e-3


class Case(NamedTuple):
    """An arm with all that acts on it, and its motion by a method of order 8 at rtol=1e-12."""

    seed: int
    arm: fa.Arm
    settings: dict[str, object]
    exact: xr.Dataset


class Outcome(NamedTuple):
    """Error of the tip as a part of the reach, or None; evaluations over those of the reference."""

    seed: int
    error: float | None
    cost: float


def run(
    arm: fa.Arm, settings: dict[str, object], rate: float = RATE, **method: object
) -> xr.Dataset:
    """Simulate with large deflections and deep stops allowed: every method solves the same arm."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        warnings.simplefilter("ignore", fa.LimitWarning)
        return fa.simulate(
            arm,
            DURATION,
            rate=rate,
            specialized=False,
            **settings,
            **method,  # type: ignore[arg-type]
        )


def apart(arm: fa.Arm, a: xr.Dataset, b: xr.Dataset) -> float:
    """Largest distance of the tips as a part of the reach."""
    return float(np.linalg.norm((a.tip - b.tip).values, axis=1).max() / arm.lengths.sum())


def draw(seed: int) -> tuple[fa.Arm, dict[str, object]]:
    """Return an arm and the arguments of its run."""
    rng = np.random.default_rng(seed)
    if seed % 3 == 0:
        spec = random_spec(rng, elements=int(rng.integers(1, 3)), reduced=True)
        arm, state = fa.Arm(spec), random_state(rng, spec)
        q = arm.from_nodal(state.angles, state.nodal)
        qd = arm.from_nodal(state.angle_rates, state.nodal_rates)
        size = rng.normal(size=arm.n_joints) * 5.0
        return arm, {
            "initial": q,
            "initial_rate": qd,
            "torque": lambda t: size * np.sin(2.0 * np.pi * t),
        }
    b = busy(seed, reduced=True)
    constant = b.torque
    return b.arm, {
        "initial": b.q,
        "initial_rate": b.qd,
        "torque": (lambda t: constant) if b.arm.n_joints else None,
        "tip_force": b.tip_force,
        "loads": b.loads,
        "base_acceleration": b.base_acceleration,
    }


def cases(count: int, first: int = 0) -> Iterator[Case]:
    """Yield arms that can be followed, from a seed on."""
    from flexarm.simulation.run.tolerance import fastest_frequency

    found = 0
    for seed in itertools.count(first):
        if found == count:
            return
        arm, settings = draw(seed)
        start = arm.padded(np.stack([settings["initial"], settings["initial_rate"]]))
        if fastest_frequency(arm, start) * DURATION > MOST_RADIANS:
            continue
        try:
            exact, check = (
                run(arm, settings, integrator="dormand_prince_8", rtol=rtol, atol=rtol / 100.0)
                for rtol in (1e-12, 1e-11)
            )
        except fa.SimulationError:  # the second-order theory ends where links bend too far
            continue
        if apart(arm, exact, check) < 0.01 * WRONG:
            found += 1
            yield Case(seed, arm, settings, exact)


def measure(case: Case, name: str) -> tuple[float | None, int]:
    """Error of the tip as a part of the reach, or None for a failure, and evaluations."""
    try:
        result = run(case.arm, case.settings, integrator=name)
    except fa.SimulationError as error:
        print(f"  {name}: {error}", file=sys.stderr)
        return None, int(error.result.attrs["evaluations"])
    return apart(case.arm, result, case.exact), int(result.attrs["evaluations"])


def row(name: str, outcomes: list[Outcome]) -> str:
    """Return the line of the table for one method."""
    good = [outcome for outcome in outcomes if outcome.error is not None]
    wrong = sum(outcome.error > WRONG for outcome in good)
    worst = max(good, key=lambda outcome: outcome.error)
    return (
        f"| `{name}` | {len(outcomes)} | {wrong} | {len(outcomes) - len(good)} | "
        f"{worst.error:.1e} | {worst.seed} | {np.median([item.cost for item in outcomes]):.1f} |"
    )


def main(count: int) -> None:
    """Print one line for each method."""
    found: dict[str, list[Outcome]] = {name: [] for name in METHODS}
    for number, case in enumerate(cases(count), start=1):
        print(f"arm {number} of {count}, seed {case.seed}", file=sys.stderr, flush=True)
        for name in METHODS:
            error, evaluations = measure(case, name)
            cost = evaluations / case.exact.attrs["evaluations"]
            found[name].append(Outcome(case.seed, error, cost))
            if error is not None and error > 0.1 * WRONG:
                print(f"  {name}: error {error:.1e}", file=sys.stderr)
    print(
        "| integrator | runs | wrong | failed | largest error | its seed | median of evaluations |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, outcomes in found.items():
        print(row(name, outcomes))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else ARMS)
