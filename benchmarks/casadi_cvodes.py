"""The paper's model in CasADi, integrated by CVODES: symbolic equations, exact Jacobians."""

from __future__ import annotations

from collections.abc import Callable

import casadi
import numpy as np
from peers.arms import TORQUE_ENDS, Case

import flexarm as fa


def prepare(case: Case, arm: fa.Arm, rtol: float) -> Callable[[], np.ndarray]:
    """Build the integrator; return a function that computes the states (samples, 2 dof).

    The equations are those of ``arm``, from ``flexarm.to_casadi``: a user could derive them by
    hand. One integrator runs up to the end of the torque, a second one from there.
    """
    y, t, on = (
        casadi.SX.sym(name, size) for name, size in (("y", 2 * arm.dof), ("t", 1), ("on", 1))
    )
    q, qd = casadi.vertsplit(y, arm.dof)
    torque = casadi.DM(case.amplitude) * (on * casadi.sin(2.0 * np.pi * t))
    qdd = fa.to_casadi(arm).forward_dynamics(q, qd, torque, 0, [])
    equations = {"x": y, "t": t, "p": on, "ode": casadi.vertcat(qd, qdd)}
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
