"""The paper's own model in CasADi, integrated by CVODES: equations as symbols, exact Jacobians."""

from __future__ import annotations

from collections.abc import Callable

import casadi
import numpy as np
from peers.arms import TORQUE_ENDS, Case

import flexarm as fa
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.cache import undecorated
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes


def prepare(case: Case, arm: fa.Arm, rtol: float) -> Callable[[], np.ndarray]:
    """Build the integrator; return what gives the states (samples, 2 dof).

    The equations are those of ``arm``, written by our kernels over CasADi's scalars: what a user
    would derive by hand. One integrator up to the end of the torque, one after.
    """
    y, t, on = (
        casadi.SX.sym(name, size) for name, size in (("y", 2 * arm.dof), ("t", 1), ("on", 1))
    )
    wave = on * casadi.sin(2.0 * np.pi * t)
    rates = _rates(arm, y, [value * wave for value in case.amplitude])
    equations = {"x": y, "t": t, "p": on, "ode": casadi.vertcat(*rates)}
    options = {"reltol": rtol, "abstol": 1e-2 * rtol, "max_num_steps": 1_000_000}
    samples = np.arange(case.samples) / case.rate
    parts = []
    for share in (1.0, 0.0):
        grid = samples[(samples <= TORQUE_ENDS) if share else (samples >= TORQUE_ENDS)]
        if len(grid) < 2:
            continue
        solver = casadi.integrator("F", "cvodes", equations, grid[0], grid[1:], options)
        parts.append((solver, share))
    start = np.concatenate([arm.rest(case.joint_angles), np.zeros(arm.dof)])

    def run() -> np.ndarray:
        states = [start[:, None]]
        for solver, share in parts:
            states.append(np.array(solver(x0=states[-1][:, -1], p=share)["xf"]))
        return np.hstack(states).T

    return run


def _rates(arm: fa.Arm, y: casadi.SX, torque: list[casadi.SX]) -> list[casadi.SX]:
    """Return the derivative of y = (q, qd) as expressions."""
    before = casadi.GlobalOptions.getNumpyMode() if _modes() else None
    if before is not None:
        # NumPy's sine of a CasADi scalar is to be a CasADi scalar; newer versions must be told so.
        casadi.GlobalOptions.setNumpyMode(-1)
    try:
        constants = arm.assembly.constants
        q, qd = _entries(casadi.vertsplit(y)).reshape(2, arm.dof)
        state = np.stack([arm.padded(q), arm.padded(qd)])
        drive = arm.padded_torque(_entries(torque))
        work = new_workspace(constants, object)
        sizes, loads = run_time_sizes(constants), no_loads(constants)
        undecorated(forward_dynamics)(sizes, constants, state, drive, loads, work)
        return [*qd, *arm.unpadded(work.acceleration)]
    finally:
        if before is not None:
            casadi.GlobalOptions.setNumpyMode(before)


def _modes() -> bool:
    return hasattr(casadi.GlobalOptions, "setNumpyMode")


def _entries(scalars: list[casadi.SX]) -> np.ndarray:
    array = np.empty(len(scalars), dtype=object)
    array[:] = scalars
    return array
