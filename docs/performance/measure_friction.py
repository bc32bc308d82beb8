"""Runs of an arm whose joints move and stick: evaluations and errors, also by smoothing rate.

The second table shows the lower limit of the smoothing rate, by relative tolerance.

python docs/performance/measure_friction.py [RATE ...]
"""

from __future__ import annotations

import sys

import numpy as np

import flexarm as fa

RATES = (None, 0.1, 0.01, 0.001)  # rad/s; None: friction holds
STEEP = (1e-3, 1e-4, 1e-5, 1e-6)
TOLERANCES = (1e-6, 1e-7, 1e-8, 1e-9)
METHODS = ("dormand_prince_8", "kennedy_carpenter_5")
ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
DURATION, COULOMB = 2.0, 0.5


def arm_of(smoothing_rate: float | None) -> fa.Arm:
    """Return the arm of Table I with friction in both joints."""
    friction = fa.Friction(coulomb=COULOMB, smoothing_rate=smoothing_rate)
    links = [fa.Link(length=1.4142, elements=2, **ROD), fa.Link(length=1.0, elements=1, **ROD)]
    return fa.Arm(links=links, joints=[fa.Joint(friction=friction)] * 2)


def compare_tolerances(rates: list[float]) -> None:
    """Print the evaluations of 0.1 s of free vibration from 0.02 of a coordinate of bending."""
    print(f"| smoothing rate | {' | '.join(f'`rtol={rtol:.0e}`' for rtol in TOLERANCES)} |")
    print(f"| --- |{' --- |' * len(TOLERANCES)}")
    for rate in rates:
        arm = arm_of(rate)
        how = {"initial": np.eye(arm.dof)[1] * 0.02, "rate": 2000.0, "integrator": METHODS[1]}
        counts = [
            fa.simulate(arm, 0.1, rtol=rtol, atol=rtol / 100.0, **how).evaluations
            for rtol in TOLERANCES
        ]
        print(f"| {rate:g} rad/s | {' | '.join(map(str, counts))} |")


def compare_methods(rates: list[float | None]) -> None:
    """Print the first table; the reference is a run at rtol=1e-10."""
    times = np.arange(DURATION * 1000.0 + 1.0) / 1000.0
    wave = np.sin(2.0 * np.pi * times) * (times < 1.0)
    settings = {"torque": wave[:, None] * [4.0, 1.5], "rate": 1000.0}
    print("| smoothing rate | integrator | evaluations | tip error (m) |")
    print("| --- | --- | --- | --- |")
    for rate in rates:
        arm = arm_of(rate)
        exact = fa.simulate(
            arm, DURATION, integrator=METHODS[0], rtol=1e-10, atol=1e-12, **settings
        )
        for method in METHODS:
            found = fa.simulate(arm, DURATION, integrator=method, **settings)
            error = float(abs(found.tip - exact.tip).max())
            law = "none, holds" if rate is None else f"{rate:g} rad/s"
            print(f"| {law} | `{method}` | {found.evaluations} | {error:.0e} |")


if __name__ == "__main__":
    given = [float(rate) for rate in sys.argv[1:]]
    compare_methods(given or list(RATES))
    print()
    compare_tolerances(given or list(STEEP))
