"""Random arms against a second integrator, and against equations that share no formula.

The second integrator is LSODA of SciPy at tight tolerances, with the accelerations of the package.
The independent equations are Lagrange's, by automatic differentiation of energies in nodal
coordinates, and integrated too for arms of few coordinates.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import flexarm as fa
from arm_states import drawn
from fuzz.farm import Part
from oracles.lagrangian import LagrangianOracle

#: Allowed distance of the tips without a warning, relative to the reach: three times the default
#: accuracy of a run; and relative to their largest distance from the start, or a thousandth of the
#: reach.
_OF_REACH, _OF_MOTION = 3e-5, 1e-3
_REFERENCE = {"rtol": 1e-10, "atol": 1e-12, "method": "LSODA"}
#: Samples of a case.
_SAMPLES = 20


def _integrated(accelerations: Any, q: Any, qd: Any, times: Any) -> Any:
    """Return the coordinates (times, dof) by the second integrator."""

    def rates(t: float, y: Any) -> Any:
        half = y.size // 2
        return np.concatenate([y[half:], accelerations(y[:half], y[half:])])

    start = np.concatenate([q, qd])
    run = solve_ivp(rates, (0.0, times[-1]), start, t_eval=times, **_REFERENCE)
    assert run.success, run.message
    return run.y[: q.size].T


def _duration(arm: fa.Arm) -> float:
    """Return the duration of a case, of which the fastest vibration has few periods."""
    zero = np.zeros(arm.dof)
    stiffness, mass = arm.stiffness_matrix(zero), arm.mass_matrix(zero)
    fastest = np.sqrt(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(mass, stiffness)))))
    return float(min(0.2, 200.0 / max(fastest, 1.0)))


def _assert_equal_tips(arm: fa.Arm, found: Any, exact: Any) -> None:
    tips = np.array([[arm.tip(q)[:2] for q in run] for run in (found, exact)])
    moved = np.linalg.norm(tips[1] - tips[1][0], axis=1).max()
    reach = sum(link.length for link in arm.spec.links)
    error = np.linalg.norm(tips[0] - tips[1], axis=1).max()
    allowed = min(_OF_REACH * reach, _OF_MOTION * max(moved, 1e-3 * reach))
    assert error < allowed, f"the tips differ by {error:.2g} m, allowed are {allowed:.2g} m"


def _simulated(d: Any, duration: float) -> tuple[Any, Any]:
    """Return the coordinates of a run with default arguments, and its times."""
    run = fa.simulate(
        d.arm,
        duration,
        initial=d.q,
        initial_rate=d.qd,
        torque=lambda t: d.torque,
        rate=_SAMPLES / duration,
    )
    return run["q"].values, run["time"].values


def _scaled_condition(mass: Any) -> float:
    """Return the condition number of a mass matrix whose diagonal is scaled to ones."""
    scale = np.sqrt(np.diag(mass))
    return float(np.linalg.cond(mass / np.outer(scale, scale)))


def second_integrator(rng: np.random.Generator, number: int) -> None:
    """Simulate a random arm with the default arguments and with LSODA."""
    d = drawn(int(rng.integers(2**31)), links=1 + number % 3, elements=1 + number % 2)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found, times = _simulated(d, _duration(d.arm))
    warned = any("error of the tip" in str(item.message) for item in caught)
    exact = _integrated(lambda q, qd: d.arm.forward_dynamics(q, qd, d.torque), d.q, d.qd, times)
    if not warned:
        _assert_equal_tips(d.arm, found, exact)


def independent_equations(rng: np.random.Generator, number: int) -> None:
    """Compare accelerations with Lagrange's equations; every tenth time, a run of a small arm."""
    whole = number % 10 == 0
    wishes = {"links": 1 + number % 2, "elements": 1, "rigid": bool(number % 20)} if whole else {}
    d = drawn(int(rng.integers(2**31)), **wishes)
    oracle = LagrangianOracle(d.arm.spec, precision=np.float64)
    q = oracle.coordinates(d.state.angles, d.state.nodal)
    qd = oracle.coordinates(d.state.angle_rates, d.state.nodal_rates)
    exact = oracle.acceleration(q, qd, d.torque, d.tip_force)
    found = d.arm.forward_dynamics(d.q, d.qd, d.torque, d.tip_force)
    found = oracle.coordinates(d.arm.joint_angles(found), d.arm.nodal(found))
    mass = oracle.mass_matrix(q)
    scale = np.sqrt(np.diag(mass))
    # Nothing in double precision is better than rounding times the condition number. The modes of a
    # full mesh that carries a heavy link all move that link, so that their matrix has the larger
    # number: 6e6 where nodal coordinates have 2e3.
    condition = max(_scaled_condition(mass), _scaled_condition(d.arm.mass_matrix(d.q)))
    limit = max(1e-9, 1e-14 * condition)
    error = np.linalg.norm(scale * (found - exact)) / np.linalg.norm(scale * exact)
    assert error < limit, f"accelerations differ by {error:.2g}, allowed are {limit:.2g}"
    if not whole:
        return
    found, times = _simulated(d, min(0.05, _duration(d.arm)))
    moved = _integrated(
        lambda q, qd: oracle.acceleration(q, qd, d.torque, np.zeros(3)), q, qd, times
    )
    joints = moved[:, oracle.joint_index]
    error = np.abs(joints - [d.arm.joint_angles(one) for one in found]).max()
    change = np.abs(joints - joints[0]).max()
    assert error < 10.0 * _OF_REACH * max(change, 1e-3), f"joint angles differ by {error:.2g} rad"


PARTS = {
    "arms": Part(
        "random arms (links, modes, sections, damping, gravity, theory) with default arguments "
        "against LSODA at 1e-10: tips equal to 3e-5 of the reach and 1e-3 of their motion, or a "
        "warning",
        second_integrator,
    ),
    "equations": Part(
        "accelerations of random arms against Lagrange's equations (1e-9, or the condition "
        "number), every tenth time also runs of small arms",
        independent_equations,
    ),
}
