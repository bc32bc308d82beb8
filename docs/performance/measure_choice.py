"""Tables "choice" and "promise" of accuracy.md: cost of default runs over that of the best method.

The arms are those of ``measure_default_step``. The first table compares with all methods at the
error of the default run, the second one with methods with step control at the error that it may
have. The cost of a method at an error is interpolated between its settings (logarithms of both).
Work is counted in evaluations.

    python docs/performance/measure_choice.py [ARMS]
"""

from __future__ import annotations

import sys
import warnings
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from measure_auto import ARMS, LONGEST
from measure_default_step import DURATION, Case, apart, cases, run

import flexarm as fa
from flexarm.integrate import INTEGRATORS
from flexarm.simulation.run.tolerance import fastest_frequency

TOLERANCES = (1e-3, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
#: Error (over the reach) that a default run may have, and tolerances for the second table.
PROMISED, LOOSER = 1e-5, (1e-2, 1e-4)
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


class Compared(NamedTuple):
    """A default run beside other methods."""

    kind: str
    error: float  # over the reach
    ratio: float  # of its evaluations to the least of all methods at its error
    promised: float  # of its evaluations to the least at `PROMISED`
    costs: dict[str, float]  # evaluations of each method over the least, at the error of the run


def kind_of(case: Case) -> str:
    """Return which of stops and friction an arm has."""
    joints = case.arm.spec.joints
    rubs = "friction" if any(joint.friction is not None for joint in joints) else "neither"
    return "stops" if any(joint.limits is not None for joint in joints) else rubs


def compare(case: Case) -> Compared:
    """Compare the default run of an arm with other methods."""
    error, cost = outcome(case)
    found = {
        name: [outcome(case, integrator=name, **how) for how in settings_of(case, name)]
        for name in INTEGRATORS
    }
    at = {name: cost_at(error, outcomes) for name, outcomes in found.items()}
    least = min(*at.values(), cost)
    costs = {name: value / least for name, value in at.items()}
    loose = {
        name: [outcome(case, integrator=name, rtol=rtol, atol=rtol / 100.0) for rtol in LOOSER]
        for name, method in INTEGRATORS.items()
        if method.adaptive
    }
    allowed = [cost_at(PROMISED, found[name] + more) for name, more in loose.items()]
    return Compared(kind_of(case), error, cost / least, cost / min(allowed), costs)


def tables(found: list[Compared]) -> str:
    """Return all tables: ratios, methods, and kinds of arms."""
    ratios = [one.ratio for one in found]
    lines = ["| default / best | arms |", "| --- | --- |"]
    edges = 1.0, 1.1, 2.0, 4.0, np.inf  # infinite: a run that stops
    for (low, high), arms in zip(pairwise(edges), np.histogram(ratios, edges)[0], strict=True):
        lines.append(f"| {low:g} to {high:g} | {arms} |")
    lines += ["", f"median {np.median(ratios):.2f}, worst {max(ratios):.1f}", ""]
    lines += ["| integrator | best, within 10 % | median cost / best |", "| --- | --- | --- |"]
    for name in INTEGRATORS:
        costs = [one.costs[name] for one in found]
        best = sum(cost <= NEARLY for cost in costs)
        lines.append(f"| `{name}` | {best} | {np.median(costs):.2g} |")
    return "\n".join([*lines, "", table_of_kinds(found)])


def table_of_kinds(found: list[Compared]) -> str:
    """Return the table of errors and ratios by kind of arm."""
    head = "joints with", "arms", "median error", "largest error", "default / best", "largest ratio"
    lines = ["| " + " | ".join(head) + " |", "| --- " * len(head) + "|"]
    for kind in ("neither", "friction", "stops"):
        some = [one for one in found if one.kind == kind]
        if some:
            errors, ratios = [one.error for one in some], [one.promised for one in some]
            sizes = f"{np.median(errors):.0e} | {max(errors):.0e}"
            most = f"{np.median(ratios):.1f} | {max(ratios):.0f}"
            lines.append(f"| {kind} | {len(some)} | {sizes} | {most} |")
    return "\n".join(lines)


def main(count: int) -> None:
    """Print the tables."""
    found = []
    for number, case in enumerate(cases(count), start=1):
        found.append(compare(case))
        one = found[-1]
        words = ", ".join(f"{name} {value:.2f}" for name, value in one.costs.items())
        print(
            f"arm {number} of {count}, seed {case.seed}: error {one.error:.0e}, default "
            f"{one.ratio:.2f}, at the promised error {one.promised:.2f}, {words}",
            file=sys.stderr,
            flush=True,
        )
    print(tables(found))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else ARMS)
