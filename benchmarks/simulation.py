"""Two seconds of the Table I arm: error against a tight run and time, beside SciPy's solver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

import flexarm as fa
from benchmarks.arms import sine_torque, table_one
from benchmarks.measure import seconds_per_call

DURATION = 2.0
START = (np.pi / 4, -np.pi / 2)


class Point(NamedTuple):
    """One run of a work-precision diagram."""

    method: str
    tolerance: float
    error: float  # m, largest over the samples
    seconds: float


def work_precision(
    tolerances: tuple[float, ...] = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
    duration: float = DURATION,
    repeats: int = 3,
) -> list[Point]:
    """Measure our integrators and SciPy's DOP853 and LSODA over the same right-hand side."""
    arm = table_one()
    samples = np.arange(round(duration * 1000) + 1) / 1000
    torque = np.array([sine_torque(t) for t in samples])
    initial = arm.rest(START)
    truth = _ours(arm, torque, initial, duration, "dormand_prince_8", 1e-11)
    points = []
    for method in ("dormand_prince_8", "dormand_prince_5"):
        for tolerance in tolerances:

            def run(method: str = method, tolerance: float = tolerance) -> np.ndarray:
                return _ours(arm, torque, initial, duration, method, tolerance)

            points.append(_point(method, tolerance, run, truth, repeats))
    for method in ("DOP853", "LSODA"):
        for tolerance in tolerances[:2]:

            def run(method: str = method, tolerance: float = tolerance) -> np.ndarray:
                return _scipy(arm, initial, samples, method, tolerance)

            points.append(_point(f"SciPy {method}", tolerance, run, truth, 1))
    return points


def _point(method: str, tolerance: float, run: object, truth: np.ndarray, repeats: int) -> Point:
    error = float(np.max(np.abs(run() - truth)))  # type: ignore[operator]
    return Point(method, tolerance, error, seconds_per_call(run, repeats, 1))  # type: ignore[arg-type]


def _ours(
    arm: fa.Arm,
    torque: np.ndarray,
    initial: np.ndarray,
    duration: float,
    method: str,
    rtol: float,
) -> np.ndarray:
    result = fa.simulate(
        arm,
        duration,
        torque=torque,
        initial=initial,
        integrator=method,
        rtol=rtol,
        atol=1e-2 * rtol,
        progress=False,
    )
    return result.tip.values


def _scipy(
    arm: fa.Arm,
    initial: np.ndarray,
    samples: np.ndarray,
    method: str,
    rtol: float,
) -> np.ndarray:
    """Integrate with SciPy, which calls our dynamics from Python: what users write by hand."""
    n = arm.dof

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[n:], arm.forward_dynamics(y[:n], y[n:], sine_torque(t))])

    start = np.concatenate([initial, np.zeros(n)])
    solution = solve_ivp(
        rates,
        (0.0, samples[-1]),
        start,
        method=method,
        t_eval=samples,
        rtol=rtol,
        atol=1e-2 * rtol,
    )
    return np.array([arm.tip(q)[:2] for q in solution.y[:n].T])
