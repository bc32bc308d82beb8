"""Correction of a plan so that the simulated arm is at rest at its goal.

Modes that vibrate faster than the intervals resolve have other phases in the simulation than in the
collocation, and joints without inertia of their own follow these modes. Newton's method on the
simulation finds the least change of the torques after which the arm is at rest: its Jacobian is
that of the steps of the integrator, `goal_gradient`.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import FlexarmError, LargeDeflectionWarning
from flexarm.planning.optimize.guess import states_of
from flexarm.planning.optimize.plan import Plan
from flexarm.planning.optimize.task import Task
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.derivatives.gradient import goal_gradient

#: Errors at the end, relative to the motion, below which nothing is corrected, and that end the
#: correction.
_CLOSE, _ENOUGH = 1e-4, 1e-8
#: Most steps of Newton's method, and the shortest part of one.
_STEPS, _SHORTEST = 12, 0.05
#: Samples of the simulation per interval.
_SAMPLES = 10


class _End(NamedTuple):
    """End of a simulation.

    Attributes:
        run: its result.
        error: (2 m,) amplitudes that should be zero, relative to the motion.
    """

    run: Any
    error: FloatArray


def corrected(task: Task, plan: Plan) -> Plan:
    """Return a plan that ends at rest in the simulation; the given one if there is none.

    Torques and their rates stay within their limits.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LargeDeflectionWarning)  # only the last run matters
            return _Correction(task, plan).plan()
    except FlexarmError:  # the simulation failed; the verification reports it
        return plan


class _Correction:
    def __init__(self, task: Task, plan: Plan) -> None:
        self._task, self._given = task, plan
        rows = task.resting_modes()
        joints = np.eye(task.arm.dof)[task.arm.joint_index]
        own = np.eye(task.arm.dof) if rows is None else np.vstack([joints, rows])
        still = task.end.q
        sizes = [np.abs(own @ part.T).max(axis=1) for part in (plan.q - still, plan.rate)]
        self._rows = np.kron(np.eye(2), own) / np.concatenate(sizes)[:, None]
        self._goal = np.concatenate([still, np.zeros_like(still)])

    def plan(self) -> Plan:
        """Return the corrected plan."""
        torque = self._torque_of(self._given)
        end = self._simulated(torque)
        if np.abs(end.error).max() < _CLOSE:
            return self._given
        for _ in range(_STEPS):
            change = self._change(torque, end.error)
            if change is None:
                return self._given
            part, size = 1.0, np.linalg.norm(end.error)
            while np.linalg.norm((new := self._simulated(torque + part * change)).error) > size:
                part *= 0.5
                if part < _SHORTEST:
                    return self._given
            torque, end = torque + part * change, new
            if np.abs(end.error).max() < _ENOUGH:
                break
        if np.abs(end.error).max() > _CLOSE:
            return self._given
        q, slope, curve = states_of(end.run, 0.0, self._given.duration, self._given.intervals)
        return replace(self._given, q=q, slope=slope, curve=curve, torque=self._pieces(torque))

    def _torque_of(self, plan: Plan) -> FloatArray:
        """Return the torques of the intervals, or of the nodes if they are continuous."""
        first = plan.torque[:, 0]
        return np.vstack([first, plan.torque[-1:, 1]]) if self._task.continuous else first.copy()

    def _pieces(self, torque: FloatArray) -> FloatArray:
        pair = (torque[:-1], torque[1:]) if self._task.continuous else (torque, torque)
        return np.stack(pair, axis=1)

    @property
    def _options(self) -> dict[str, Any]:
        interpolation = "linear" if self._task.continuous else "hold"
        start = self._task.start.q
        return {"torque_interpolation": interpolation, "initial": start, "progress": False}

    def _simulated(self, torque: FloatArray) -> _End:
        plan = self._given
        history = replace(plan, torque=self._pieces(torque)).torque_history(torque[0], torque[-1])
        run = simulate(
            self._task.arm,
            plan.duration,
            torque=history,
            initial=self._task.start.q,
            rate=_SAMPLES * plan.intervals / plan.duration,
            progress=False,
        )
        last = np.concatenate([run.q.values[-1], run.qd.values[-1]])
        return _End(run, self._rows @ (last - self._goal))

    def _jacobian(self, torque: FloatArray) -> FloatArray:
        """Return the derivatives (2 m, size of the torques) of the error."""
        plan, dof = self._given, self._task.arm.dof
        found = []
        for row in self._rows:
            weights = {name: np.zeros((plan.intervals + 1, dof)) for name in ("q", "qd")}
            weights["q"][-1], weights["qd"][-1] = row[:dof], row[dof:]
            rate = plan.intervals / plan.duration
            arguments = {"torque": torque, "rate": rate, "error_estimate": False, **self._options}
            gradient = goal_gradient(self._task.arm, plan.duration, weights, **arguments)
            found.append(gradient.torque.values.ravel())
        return np.array(found)

    def _change(self, torque: FloatArray, error: FloatArray) -> FloatArray | None:
        """Return the least change of the torques within limits that removes a linear error."""
        import casadi

        task, J = self._task, self._jacobian(torque)
        lower, upper = -task.torque - torque, task.torque - torque
        if task.continuous:  # the torque of rest at both ends
            lower[[0, -1]] = upper[[0, -1]] = 0.0
        lower, upper = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
        x = casadi.MX.sym("change", torque.size)
        rows, least, most = [casadi.DM(J) @ x], [-error], [-error]
        for joint in np.flatnonzero(np.isfinite(task.torque_rate)):
            step = task.torque_rate[joint] * self._given.duration / self._given.intervals
            places = np.arange(joint, torque.size, torque.shape[1]).tolist()
            now = np.diff(torque[:, joint])
            rows.append(x[places[1:]] - x[places[:-1]])
            least.append(np.minimum(-step - now, 0.0))
            most.append(np.maximum(step - now, 0.0))
        program: dict[str, Any] = {"x": x, "f": casadi.sumsqr(x), "g": casadi.vertcat(*rows)}
        quiet: dict[str, Any] = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes"}}
        solver = casadi.nlpsol("correction", "ipopt", program, quiet)
        bounds = {"lbx": lower.ravel(), "ubx": upper.ravel()}
        found = solver(x0=0, lbg=np.concatenate(least), ubg=np.concatenate(most), **bounds)
        if not solver.stats()["success"]:
            return None
        change = np.array(found["x"]).reshape(torque.shape)
        return np.clip(change, lower, upper)
