"""Values of the gallery by the oracle: `PYTHONPATH=tests:. python -m oracles.mechanism_runs`.

Prints ``crane`` and ``cooperating_arms`` of ``gallery/data/mechanisms.json``, in ten minutes.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np
from gallery.cases import cooperating_arms, crane
from scipy.integrate import solve_ivp

import flexarm as fa

from .mechanisms import oracle_of


def values_of(arm: fa.Arm, start: Any, torque: Any, times: Any) -> list[dict[str, list[float]]]:
    """Integrate the oracle's accelerations; return tip, joint angles and closure forces."""
    oracle, n = oracle_of(arm, np.float64), arm.dof

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[n:], oracle.at(y[:n], y[n:], torque(t)).acceleration])

    begin = np.concatenate([arm.rest(start), np.zeros(n)])
    span = (0.0, times[-1])
    solution = solve_ivp(rates, span, begin, "DOP853", times, rtol=1e-9, atol=1e-11)
    rows = []
    for t, y in zip(times, solution.y.T, strict=True):
        found = oracle.at(y[:n], y[n:], torque(t))
        rows.append({
            "tip": found.tips[-1, :2].round(12).tolist(),
            "joint_angle": y[:n][arm.joint_index].round(12).tolist(),
            "closure_force": found.closure_force.round(9).tolist(),
        })  # fmt: skip
    return rows


CASES = {
    "crane": lambda: values_of(crane.crane(), crane.START, crane.torque, crane.TIMES),
    "cooperating_arms": lambda: values_of(
        cooperating_arms.arms(),
        cooperating_arms.posture()[0],
        cooperating_arms.torque,
        cooperating_arms.TIMES,
    ),
}

if __name__ == "__main__":
    for name in sys.argv[1:] or CASES:
        print(json.dumps({name: CASES[name]()}), flush=True)
