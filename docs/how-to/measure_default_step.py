"""Fixed-step methods called without a step, on random arms: errors of the tip, failures and cost.

Two of three arms have joint springs, friction, stops, geared rotors, loads and a moving base.

    python docs/how-to/measure_default_step.py [ARMS]
"""

from __future__ import annotations

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
    """An arm with all that acts on it, and its motion by a method of order 8 at rtol=1e-11."""

    arm: fa.Arm
    settings: dict[str, object]
    exact: xr.Dataset


def run(arm: fa.Arm, settings: dict[str, object], **method: object) -> xr.Dataset:
    """Simulate with large deflections allowed: every method shares their error."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        return fa.simulate(
            arm,
            DURATION,
            rate=RATE,
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
        size = rng.normal(size=arm.joints) * 5.0
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
        "torque": (lambda t: constant) if b.arm.joints else None,
        "tip_force": b.tip_force,
        "loads": b.loads,
        "base_acceleration": b.base_acceleration,
    }


def cases(count: int, first: int = 0) -> Iterator[Case]:
    """Yield arms that can be followed, from a seed on."""
    from flexarm.simulate.tolerance import fastest_frequency

    found, seed = 0, first
    while found < count:
        arm, settings = draw(seed)
        seed += 1
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
            yield Case(arm, settings, exact)


def measure(case: Case, name: str) -> tuple[float | None, int]:
    """Error of the tip as a part of the reach, or None for a failure, and evaluations."""
    try:
        result = run(case.arm, case.settings, integrator=name)
    except fa.SimulationError as error:
        print(f"  {name}: {error}", file=sys.stderr)
        return None, int(error.result.attrs["evaluations"])
    return apart(case.arm, result, case.exact), int(result.attrs["evaluations"])


def main(count: int) -> None:
    """Print one line for each method."""
    found: dict[str, list[float | None]] = {name: [] for name in METHODS}
    cost: dict[str, list[float]] = {name: [] for name in METHODS}
    for number, case in enumerate(cases(count), start=1):
        print(f"arm {number} of {count}", file=sys.stderr)
        for name in METHODS:
            error, evaluations = measure(case, name)
            found[name].append(error)
            cost[name].append(evaluations / case.exact.attrs["evaluations"])
            if error is not None and error > 0.1 * WRONG:
                print(f"  {name}: error {error:.1e}", file=sys.stderr)
    print("| integrator | runs | wrong | failed | largest error | median of evaluations |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name in METHODS:
        good = [error for error in found[name] if error is not None]
        wrong = sum(error > WRONG for error in good)
        print(
            f"| `{name}` | {count} | {wrong} | {count - len(good)} | {max(good):.0e} | "
            f"{np.median(cost[name]):.1f} |",
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else ARMS)
