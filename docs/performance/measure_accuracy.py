"""Table "requested" of accuracy.md: cost and error of runs with a requested accuracy.

The arms are those of ``tests/accuracy_runs.py``, of one to three links. The cost is the number of
evaluations of all runs of a call, over that of a call whose runs have the tolerances of a run
without verification.

    python docs/performance/measure_accuracy.py [ARMS]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

import flexarm as fa
import flexarm.simulation.calls.run as calls
from accuracy_runs import QUIET, random_arm

ARMS, PARTS = 30, (1e-3, 1e-4, 1e-5, 1e-6)


def arms(damped: bool, count: int) -> Iterator[tuple[fa.Arm, object]]:
    """Yield arms with their torques, with a damping ratio of 2 % or none."""
    for seed in range(count):
        arm, torque = random_arm(seed)
        if not damped:
            links = [link.replace(damping=None) for link in arm.spec.links]
            arm = fa.Arm(links=links, joints=arm.spec.joints)
        yield arm, torque


def measure(arm: fa.Arm, torque: object, parts: tuple[float, ...] = PARTS) -> np.ndarray:
    """Return cost, error over accuracy, and error over its estimate, (parts, 3)."""

    def run(**how: float) -> object:
        return fa.simulate(arm, 1.0, torque=torque, **how, **QUIET)

    exact, reach, rows = run(rtol=1e-11), float(arm.lengths.sum()), []
    for part in parts:
        result = run(accuracy=part * reach)
        with mock.patch.object(calls, "_LEAST_COARSE", np.inf):
            close = run(accuracy=part * reach)
        apart = np.linalg.norm((result.tip - exact.tip).values, axis=1).max()
        cost = result.attrs["evaluations"] / close.attrs["evaluations"]
        rows.append([cost, apart / (part * reach), apart / result.attrs["integration_error"]])
    return np.array(rows)


def table(count: int) -> str:
    lines = ["| arms | accuracy over reach | cost | error over accuracy | error over estimate |"]
    lines.append("| --- | --- | --- | --- | --- |")
    for damped in (True, False):
        rows = np.stack([measure(arm, torque) for arm, torque in arms(damped, count)])
        for part, values in zip(PARTS, np.moveaxis(rows, 1, 0), strict=True):
            middle, most = np.median(values, axis=0), values.max(axis=0)
            cells = [f"{a:.2f}, {b:.2f}" for a, b in zip(middle, most, strict=True)]
            name = "damping ratio 2 %" if damped else "no damping"
            lines.append(f"| {name} | {part:.0e} | {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(int(sys.argv[1]) if len(sys.argv) > 1 else ARMS))
