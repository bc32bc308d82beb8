"""Table "choice" of accuracy.md: cost of default runs over that of the best method as accurate.

The arms are those of ``measure_default_step``. The cost of a method at the error of the default is
interpolated between its settings (logarithms of both). Work is counted in evaluations.

    python docs/performance/measure_choice.py [ARMS]
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from measure_auto import ARMS, LONGEST
from measure_default_step import DURATION, Case, apart, cases, run

import flexarm as fa
from flexarm.integrate import INTEGRATORS
from flexarm.simulation.run.tolerance import fastest_frequency

TOLERANCES = (1e-3, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
#: Angles (rad) by which the fastest vibration turns in a given step.
ANGLES = (0.06, 0.125, 0.25, 0.5, 1.0, 2.0)
#: A method is best up to this ratio to the least cost.
NEARLY = 1.1
#: Smallest error (over the reach) that the reference resolves.
RESOLVED = 1e-13


def settings_of(case: Case, name: str) -> list[dict[str, float]]:
    """Return the settings of a method: tolerances or steps."""
    if INTEGRATORS[name].adaptive:
        return [{"rtol": rtol, "atol": rtol / 100.0} for rtol in TOLERANCES]
    start = np.stack([case.settings["initial"], case.settings["initial_rate"]])  # type: ignore[arg-type]
    fastest = fastest_frequency(case.arm, case.arm.padded(start))
    longest = LONGEST * DURATION
    return [{"step": min(angle / max(fastest, angle / longest), longest)} for angle in ANGLES]


def outcome(case: Case, **how: object) -> tuple[float, float]:
    """Return error over the reach and evaluations; infinite for a run that fails."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fa.AccuracyWarning)
            result = run(case.arm, case.settings, **how)  # type: ignore[arg-type]
    except (fa.SimulationError, fa.InputError):  # failed, or not supported on this arm
        return np.inf, np.inf
    error = max(apart(case.arm, result, case.exact), RESOLVED)
    return error, float(result.attrs["evaluations"])


def cost_at(error: float, outcomes: list[tuple[float, float]]) -> float:
    """Return the evaluations of a method at an error; infinite if no setting is that accurate."""
    finite = sorted(pair for pair in outcomes if np.isfinite(pair[0]))
    good = [cost for found, cost in finite if found <= error]
    if not good:
        return np.inf
    worse = [pair for pair in finite if pair[0] > error]
    best = min(good)
    if worse:
        (e0, c0), (e1, c1) = max(pair for pair in finite if pair[0] <= error), worse[0]
        share = np.log(error / e0) / np.log(e1 / e0)
        best = min(best, float(np.exp(np.log(c0) + share * np.log(c1 / c0))))
    return best


def main(count: int) -> None:
    """Print the ratios, and on how many arms each method is best."""
    ratios, costs = [], []
    for number, case in enumerate(cases(count), start=1):
        error, cost = outcome(case)
        at = {
            name: cost_at(error, [outcome(case, integrator=name, **how) for how in settings])
            for name in INTEGRATORS
            if (settings := settings_of(case, name))
        }
        least = min(*at.values(), cost)
        ratios.append(cost / least)
        costs.append({name: value / least for name, value in at.items()})
        words = ", ".join(f"{name} {value / least:.2f}" for name, value in at.items())
        print(
            f"arm {number} of {count}, seed {case.seed}: error {error:.0e}, default "
            f"{cost / least:.2f}, {words}",
            file=sys.stderr,
            flush=True,
        )
    print("| default / best | arms |", "| --- | --- |", sep="\n")
    for low, high in ((1.0, 1.1), (1.1, 2.0), (2.0, 4.0), (4.0, np.inf)):
        print(f"| {low:g} to {high:g} | {sum(low <= r < high for r in ratios)} |")
    print(f"\nmedian {np.median(ratios):.2f}, worst {max(ratios):.1f}\n")
    print(
        "| integrator | best, within 10 % | median cost / best |", "| --- | --- | --- |", sep="\n"
    )
    for name in INTEGRATORS:
        own = [cost[name] for cost in costs]
        print(f"| `{name}` | {sum(c <= NEARLY for c in own)} | {np.median(own):.2g} |")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else ARMS)
