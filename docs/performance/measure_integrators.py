"""Work against precision: the table of the page "Accuracy".

The arm of Table I, two elements on link 1 and one on link 2, at rest with its links at 45 and -45
degrees, is driven for a second by 4 sin(2 pi t) and 1.5 sin(2 pi t) N m and then left alone for
another. Errors are the largest distance of the tip from that of a run with the tightest tolerance.

    python docs/performance/measure_integrators.py
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import flexarm as fa

DURATION = 2.0
#: Name of an integrator and how it is set.
CASES: tuple[tuple[str, dict[str, float]], ...] = (
    ("rk4", {"step": 1e-3}),
    ("rk4", {"step": 5e-4}),
    ("rk4", {"step": 1e-4}),
    ("cowell_4", {"step": 1e-3}),
    ("cowell_4", {"step": 5e-4}),
    ("cowell_4", {"step": 1e-4}),
    *(("gauss_6", {"step": step}) for step in (1e-3, 5e-4)),
    *(("generalized_alpha", {"step": step}) for step in (1e-3, 5e-4, 1e-4)),
    *(("kennedy_carpenter_5", {"rtol": rtol, "atol": rtol / 100}) for rtol in (1e-3, 1e-5, 1e-7)),
    *(("dormand_prince_8", {"rtol": rtol, "atol": rtol / 100}) for rtol in (1e-5, 1e-7, 1e-9)),
)
DEFAULT = CASES.index(("dormand_prince_8", {"rtol": 1e-7, "atol": 1e-7 / 100}))


class Row(NamedTuple):
    """One line of the table."""

    integrator: str
    setting: str
    error: float  # m, at the tip
    evaluations: int  # of the forward dynamics
    seconds: float  # of computing, the shortest of all repeats


def arm_of_table_1() -> fa.Arm:
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
    return fa.Arm(
        links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)]
    )


class Torque:
    """One period of a sine on each joint, then nothing."""

    breaks = (1.0,)

    def __call__(self, t: float) -> Any:
        return np.array([4.0, 1.5]) * np.sin(2 * np.pi * t) if t <= 1.0 else np.zeros(2)


def run(integrator: str, **setting: float) -> xr.Dataset:
    arm = arm_of_table_1()
    start = arm.rest([np.pi / 4, -np.pi / 2])
    return fa.simulate(
        arm, DURATION, torque=Torque(), initial=start, integrator=integrator, **setting
    )


def measure(repeats: int) -> list[Row]:
    exact = run("dormand_prince_8", rtol=1e-12, atol=1e-14).tip
    # Repeats take turns, so that a busy moment of the machine hits all cases alike.
    rounds = [[run(name, **setting) for name, setting in CASES] for _ in range(repeats)]
    rows = []
    for k, (name, setting) in enumerate(CASES):
        results = [results[k] for results in rounds]
        off = results[0].tip - exact
        rows.append(
            Row(
                name,
                ", ".join(f"{key} {value:g}" for key, value in setting.items()),
                float(np.hypot(off.sel(axis="x"), off.sel(axis="y")).max()),
                results[0].attrs["evaluations"],
                min(result.attrs["wall_seconds"] for result in results),
            )
        )
    return rows


def table(rows: list[Row]) -> str:
    lines = [
        "| integrator | setting | tip error (m) | evaluations | time / that of rtol 1e-7 |",
        "| --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        ratio = row.seconds / rows[DEFAULT].seconds
        lines.append(
            f"| `{row.integrator}` | {row.setting} | {row.error:.0e} | {row.evaluations} | "
            f"{ratio:.1f} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    run("rk4")  # compiles, if need be
    print(table(measure(repeats=15)))
