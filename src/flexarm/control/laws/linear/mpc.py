"""Model predictive control: the regulator of `LQG` with torque limits; (C.29) to (C.31)."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from flexarm.control.contract.base import Arrays, FloatArray, Measurement, Reference, Step
from flexarm.control.design.linear_design import Design
from flexarm.control.laws.linear.lqg import LQG
from flexarm.model.drives.linear import MPCParameters

#: Largest relative excesses of a plan over a limit. Rounding causes 1e-8 if feedback requests
#: hundreds of times the limits. Plans above the first are counted, those above the second not used.
_TOLERANCE, _ACCEPTED = 1e-6, 1e-2
#: Largest number of active-set changes at a sample, per number of limits; a quarter is typical.
_MOST_CHANGES = 10


class MPC(MPCParameters, LQG):
    """Linear model predictive control with limits of torques and of their rates.

    At every sample the controller computes the torques over the horizon with the least cost within
    the limits, and applies the first. The cost beyond the horizon is that of the regulator, so the
    torques are exactly those of `LQG` if no limit is active.

    Raises:
        InputError: as for `LQG`.

    A plan within the limits always exists: a constant torque, the last one. The quadratic programme
    (C.31) is solved exactly as a least-distance problem (Lawson and Hanson 1974, chapter 23). The
    three counts are attributes of results: ``mpc_limited``, ``mpc_inaccurate``, ``mpc_fallback``.
    """

    vectorized = analytic = False
    references = "LawsonHanson1974"

    def _prepare(self) -> None:
        joints = self.arm.joints
        self._most = self.torque_limit
        self._rate_step = None if self.torque_rate is None else self.sample_time * self.torque_rate
        super()._prepare()
        self._difference = np.eye(self.horizon * joints) - np.eye(self.horizon * joints, k=-joints)

    @property
    def limited(self) -> int:
        """Number of samples of the last run at which a limit was active over the horizon."""
        return int(self.memory.get("limited", 0))

    @property
    def inaccurate(self) -> int:
        """Number of those with a plan that exceeded a limit by 1e-6 to 1e-2 of it, and was cut."""
        return int(self.memory.get("inaccurate", 0))

    @property
    def fallback(self) -> int:
        """Number of those without a usable plan, where the last plan, shifted, was used."""
        return int(self.memory.get("fallback", 0))

    @property
    def _steps(self) -> int:
        return super()._steps + self.horizon

    def _node(self, item: Design) -> list[FloatArray]:
        """Return the torques of the horizon per state, torque change and elastic force; (C.30)."""
        m, n, k = item.B.shape[1], len(item.A), len(item.integrated)
        push = np.vstack([item.B, np.zeros((k, m))])
        forced = np.vstack([item.B_elastic, np.zeros((k, item.B_elastic.shape[1]))])
        whole = np.block([[item.A, np.zeros((n, k))], [item.integrated, np.eye(k)]])
        loop = whole - push @ item.gain
        free = [-item.gain]
        for _ in range(self.horizon - 1):
            free.append(free[-1] @ loop)
        by_torque = _lower([np.eye(m), *(row @ push for row in free[:-1])])
        nothing = np.zeros((m, forced.shape[1]))
        by_force = _lower([nothing, *(row @ forced for row in free[:-1])])
        price = item.torque_weight + push.T @ item.cost @ push
        return [*super()._node(item), np.vstack(free), by_torque, by_force, price]

    def at_rest(self) -> LQG:
        """Return a copy without ``nominal`` and ``torque_rate``: a linear loop has no limits.

        Otherwise the small changes of readings between its updates would activate this limit.
        """
        mine = deepcopy(self)
        mine.nominal = mine._rate_step = None
        mine._motion = mine._nominal_motion()
        return mine

    def report(self) -> dict[str, float]:
        names = "limited", "inaccurate", "fallback"
        return super().report() | {f"mpc_{name}": getattr(self, name) for name in names}

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the inputs of `LQG`, and elastic forces and nominal torques over the horizon."""
        inputs = super().planned(t, reference)
        forces, torques = self._motion.missing, self._motion.torques(self.horizon)
        return {**inputs, "forces_ahead": forces, "torques_ahead": torques}

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {**super().initial_memory(readings, inputs), **self._first_plan()}

    def _first_plan(self) -> dict[str, Any]:
        """Return the memory of plans before the first one, which is not a number."""
        m = self.arm.joints
        plans = {"applied": np.full(m, np.nan), "plan": np.full(self.horizon * m, np.nan)}
        return {**plans, "limited": 0, "inaccurate": 0, "fallback": 0}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after, torque = super().step(memory, readings, inputs)
        return {**after, "applied": torque}, torque

    def _within_limits(self, torque: FloatArray, memory: Arrays) -> FloatArray:
        last = memory["applied"]
        if self._rate_step is not None and not np.isnan(last[0]):
            torque = np.clip(torque, last - self._rate_step, last + self._rate_step)
        return super()._within_limits(torque, memory)

    def _feedback(
        self, memory: Arrays, state: FloatArray, arrays: Sequence[FloatArray], inputs: Arrays
    ) -> tuple[FloatArray, Arrays]:
        N, m = self.horizon, self.arm.joints
        ahead, free_by, by_torque, by_force = arrays[3:7]
        forces, nominal = inputs["forces_ahead"], inputs["torques_ahead"].ravel()
        window = sliding_window_view(forces, self._previewed + 1, axis=0)[:N, :, :: self._stride]
        fed = -(np.swapaxes(window, 1, 2).reshape(N, -1) @ ahead.T).ravel()
        free = free_by @ state + by_torque @ fed
        free += by_force @ forces[:N].ravel()
        more = {name: memory[name] for name in self._first_plan()}
        more["plan"] = self._limited(nominal + free, more)
        return more["plan"][:m] - nominal[:m], more

    def _limited(self, free: FloatArray, plans: dict[str, Any]) -> FloatArray:
        """Return optimal torques (horizon joints,) within the limits, or the last plan.

        Args:
            free: (horizon joints,) those without limits, which are optimal if they are within.
            plans: memory of the last plan, in which samples are counted.
        """
        low, high = self._bounds(free, plans["applied"])
        if np.all(low <= 0.0) and np.all(high >= 0.0):
            return free
        plans["limited"] += 1
        change, excess = self._change(low, high)
        if excess > _TOLERANCE:
            plans["inaccurate"] += int(excess <= _ACCEPTED)
        if excess <= _ACCEPTED:
            return free + change
        return self._shifted(free, plans)

    def _shifted(self, first: FloatArray, plans: dict[str, Any]) -> FloatArray:
        """Return the last plan, shifted by one sample; at the first sample ``first``."""
        plans["fallback"] += 1
        plan, m = plans["plan"], self.arm.joints
        if np.isnan(plan[0]):
            return first  # the caller clips the torque
        return np.append(plan[m:], plan[-m:])

    def _bounds(self, torque: FloatArray, applied: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distances of torques over the horizon from the limits."""
        most = np.tile(self._most, self.horizon)
        low, high = -most - torque, most - torque
        if self._rate_step is not None:
            change = self._difference @ torque
            step = np.tile(self._rate_step, self.horizon)
            m = self.arm.joints
            if np.isnan(applied[0]):
                step[:m] = np.inf  # the first torque is arbitrary
            else:
                change[:m] -= applied
            low, high = np.append(low, -step - change), np.append(high, step - change)
        return low, high

    def _change(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, float]:
        """Return the optimal change (horizon joints,) of the regulator's torques; (C.31).

        The second result is its relative excess over a limit, infinite if no change was found.
        """
        N = self.horizon
        by_unknown = self._torque_by_unknown()
        rows, limit = by_unknown, np.tile(self._most, N)
        if self._rate_step is not None:
            rows = np.vstack([rows, self._difference @ rows])
            limit = np.append(limit, np.tile(self._rate_step, N))
        unit = limit[:, None]
        matrix, floor = np.vstack([rows / unit, -rows / unit]), np.append(low, -high)
        floor /= np.append(limit, limit)
        finite = np.isfinite(floor)
        matrix, floor = matrix[finite], floor[finite]
        least = least_distance(matrix, floor)
        if least is None:
            return np.zeros(len(by_unknown)), np.inf
        excess = float(np.max(floor - matrix @ least))
        return by_unknown @ least, excess if np.isfinite(excess) else np.inf

    def _torque_by_unknown(self) -> FloatArray:
        """Return the torques of the horizon by unknowns whose sum of squares is the cost."""
        N, m = self.horizon, self.arm.joints
        by_torque, _, price = self._arrays.arrays[5:8]
        root = np.linalg.inv(np.linalg.cholesky(price)).T
        by: FloatArray = (by_torque.reshape(-1, N, m) @ root).reshape(-1, N * m)
        return by


def least_distance(matrix: FloatArray, floor: FloatArray) -> FloatArray | None:
    """Return the shortest x (n,) with ``matrix @ x >= floor``, or None if it was not found.

    The dual is a nonnegative least-squares problem, which an active-set method solves in finitely
    many steps without tuning parameters. Lawson and Hanson, Solving Least Squares Problems (1974),
    chapter 23, algorithm LDP.
    """
    from scipy.optimize import nnls

    # Scale rows to length one and floors to at most one, so that tolerances are relative.
    length = np.linalg.norm(matrix, axis=1)
    scaled = floor / length
    size = max(float(np.max(scaled)), 1e-300)
    dual = np.vstack([matrix.T / length, scaled / size])
    unit = np.zeros(len(dual))
    unit[-1] = 1.0
    try:
        weights, _ = nnls(dual, unit, maxiter=_MOST_CHANGES * dual.shape[1])
    except RuntimeError:
        return None
    residual = dual @ weights - unit
    if residual[-1] == 0.0:
        return None
    shortest: FloatArray = -size * residual[:-1] / residual[-1]
    return shortest


def _lower(blocks: list[FloatArray]) -> FloatArray:
    """Return the lower block-triangular Toeplitz matrix with these blocks."""
    count, (rows, columns) = len(blocks), blocks[0].shape
    whole = np.zeros((count * rows, count * columns))
    for i in range(count):
        for j in range(i + 1):
            place = slice(i * rows, (i + 1) * rows), slice(j * columns, (j + 1) * columns)
            whole[place] = blocks[i - j]
    return whole
