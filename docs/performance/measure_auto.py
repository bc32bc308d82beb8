"""Settings that "auto" could choose, on the random arms of ``measure_default_step``.

A row with an angle has a given step: the fastest vibration turns by this angle in it.

    python docs/performance/measure_auto.py [ARMS]
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from measure_default_step import DURATION, Case, apart, cases, run

import flexarm as fa
from flexarm.simulation.run.tolerance import fastest_frequency

ARMS = 70
TOLERANCES = (1e-3, 1e-5, 1e-7)
#: Angles (rad) of a step of rk4; a step of cowell_4 is half of it, with half the evaluations.
ANGLES = (0.25, 0.5, 1.0)
#: A given step is at most this fraction of the run.
LONGEST = 1.0 / 20.0


class Setting(NamedTuple):
    """An integrator with a tolerance, or with a step given by an angle (rad)."""

    integrator: str
    rtol: float = 0.0
    angle: float = 0.0

    def __str__(self) -> str:
        """Return the cell of the table."""
        return f"`rtol={self.rtol:g}`" if self.rtol else f"{self.angle:g} rad"


SETTINGS = (
    *(Setting("dormand_prince_8", rtol) for rtol in TOLERANCES),
    *(Setting("kennedy_carpenter_5", rtol) for rtol in TOLERANCES),
    *(Setting("rk4", angle=angle) for angle in ANGLES),
    *(Setting("cowell_4", angle=angle / 2.0) for angle in ANGLES),
)


class Outcome(NamedTuple):
    """Error of the tip as a part of the reach, None for a failure; evaluations by the reference."""

    error: float | None
    cost: float


def measure(case: Case, setting: Setting) -> Outcome:
    """Run one arm with one setting."""
    how: dict[str, float] = {"rtol": setting.rtol, "atol": setting.rtol / 100.0}
    if setting.angle:
        start = np.stack([case.settings["initial"], case.settings["initial_rate"]])  # type: ignore[arg-type]
        fastest = fastest_frequency(case.arm, case.arm.padded(start))
        part = 1.0 if setting.integrator == "rk4" else 0.5
        how = {"step": min(setting.angle / fastest, part * LONGEST * DURATION)}
    try:
        with warnings.catch_warnings():
            # The table shows the errors of large tolerances, also for smoothed friction.
            warnings.filterwarnings("ignore", ".*smoothing_rate", fa.AccuracyWarning)
            result = run(case.arm, case.settings, integrator=setting.integrator, **how)
    except fa.SimulationError:
        return Outcome(None, 0.0)
    cost = result.attrs["evaluations"] / case.exact.attrs["evaluations"]
    return Outcome(apart(case.arm, result, case.exact), cost)


def row(setting: Setting, outcomes: list[Outcome]) -> str:
    """Return the line of the table for one setting."""
    errors = [outcome.error for outcome in outcomes if outcome.error is not None]
    cost = np.median([outcome.cost for outcome in outcomes if outcome.error is not None])
    return (
        f"| `{setting.integrator}` | {setting} | {len(outcomes) - len(errors)} | "
        f"{np.median(errors):.0e} | {max(errors):.0e} | {cost:.2f} |"
    )


def table(found: dict[Setting, list[Outcome]]) -> str:
    """Return the table of all settings."""
    lines = [
        "| integrator | setting | failed | median error | largest error | median of evaluations |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    return "\n".join([*lines, *(row(setting, found[setting]) for setting in SETTINGS)])


def main(count: int) -> None:
    """Print the table."""
    found: dict[Setting, list[Outcome]] = {setting: [] for setting in SETTINGS}
    for number, case in enumerate(cases(count), start=1):
        print(f"arm {number} of {count}, seed {case.seed}", file=sys.stderr, flush=True)
        for setting in SETTINGS:
            found[setting].append(measure(case, setting))
    print(table(found))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else ARMS)
