"""Runs of an arm whose joints move and stick: evaluations and errors by smoothing rate.

python docs/how-to/measure_friction.py [RATE ...]
"""

from __future__ import annotations

import sys

import numpy as np

import flexarm as fa

RATES = (0.1, 0.01, 0.001)  # rad/s
METHODS = ("dormand_prince_8", "kennedy_carpenter_5")
ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
DURATION, COULOMB = 2.0, 0.5


def arm_of(smoothing_rate: float) -> fa.Arm:
    """Return the arm of Table I with friction in both joints."""
    friction = fa.Friction(coulomb=COULOMB, smoothing_rate=smoothing_rate)
    links = [fa.Link(length=1.4142, elements=2, **ROD), fa.Link(length=1.0, elements=1, **ROD)]
    return fa.Arm(links=links, joints=[fa.Joint(friction=friction)] * 2)


def main(rates: list[float]) -> None:
    """Print the table; the reference is a run at rtol=1e-10."""
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
            print(f"| {rate:g} rad/s | `{method}` | {found.evaluations} | {error:.0e} |")


if __name__ == "__main__":
    main([float(rate) for rate in sys.argv[1:]] or list(RATES))
