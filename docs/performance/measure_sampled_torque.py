"""Methods with step control under zero-order-hold torques, on the random arms of
``measure_default_step``.

A row is a range of the angle (rad) by which the fastest vibration turns in one sample.

    python docs/performance/measure_sampled_torque.py [ARMS]
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from measure_default_step import DURATION, apart, draw, run

import flexarm as fa
from flexarm.simulation.run.tolerance import fastest_frequency

ARMS = 60
RATES = (250.0, 500.0, 1000.0, 2000.0)  # torque samples a second
METHODS = ("dormand_prince_8", "kennedy_carpenter_5")
#: Limits (rad) of the rows; beyond the last one a run would take minutes.
ANGLES = (0.0, 0.1, 0.3, 1.0, 10.0)


class Comparison(NamedTuple):
    """Errors of the tip as parts of the reach, and evaluations, of both methods."""

    angle: float
    errors: tuple[float, ...]
    evaluations: tuple[int, ...]


def compare(seed: int, rate: float) -> Comparison | None:
    """Run one arm with random torque samples; None if the reference fails or takes too long."""
    arm, settings = draw(seed)
    start = arm.padded(np.stack([settings["initial"], settings["initial_rate"]]))  # type: ignore[arg-type]
    angle = fastest_frequency(arm, start) / rate
    if not arm.n_joints or angle >= ANGLES[-1]:
        return None
    samples = np.random.default_rng(seed).normal(size=(int(DURATION * rate) + 1, arm.n_joints))
    held = {**settings, "torque": samples, "torque_interpolation": "hold"}
    try:
        exact = run(arm, held, rate, integrator=METHODS[0], rtol=1e-12, atol=1e-14)
        results = [run(arm, held, rate, integrator=method) for method in METHODS]
    except fa.SimulationError:  # the second-order theory ends where links bend too far
        return None
    return Comparison(
        angle,
        tuple(apart(arm, result, exact) for result in results),
        tuple(int(result.attrs["evaluations"]) for result in results),
    )


def row(low: float, high: float, found: list[Comparison]) -> str:
    """Return the line of the table for one range of angles."""
    errors = np.median([item.errors for item in found], axis=0)
    cost = np.median([item.evaluations[1] / item.evaluations[0] for item in found])
    return (
        f"| {low:g} to {high:g} rad | {len(found)} | {errors[0]:.0e} | {errors[1]:.0e} | "
        f"{cost:.2f} |"
    )


def main(count: int) -> None:
    """Print the table."""
    found = [item for seed in range(count) for rate in RATES if (item := compare(seed, rate))]
    print("| sample | runs | `dormand_prince_8` | `kennedy_carpenter_5` | evaluations |")
    print("| --- | --- | --- | --- | --- |")
    for low, high in itertools.pairwise(ANGLES):
        if inside := [item for item in found if low <= item.angle < high]:
            print(row(low, high, inside))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else ARMS)
