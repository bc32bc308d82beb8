"""Model predictive control: the regulator of `LQG` with torque limits; (C.29) to (C.31)."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from flexarm.control.contract.base import FloatArray, Measurement, Reference
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

    Attributes:
        limited: number of samples of the last run at which a limit was active over the horizon.
        inaccurate: number of those whose plan exceeded a limit by 1e-6 to 1e-2 of it; the applied
            torque is clipped.
        fallback: number of those without a usable plan; the plan of the previous sample was used,
            shifted by one sample.

    Raises:
        InputError: as for `LQG`.

    A plan within the limits always exists: a constant torque, the last one. The quadratic programme
    (C.31) is solved exactly as a least-distance problem (Lawson and Hanson 1974, chapter 23). The
    three counts are attributes of results: ``mpc_limited``, ``mpc_inaccurate``, ``mpc_fallback``.
    """

    memory = LQG.memory
    references = "LawsonHanson1974"

    def _prepare(self) -> None:
        joints = self.arm.joints
        self._most = self.torque_limit
        self._rate_step = None if self.torque_rate is None else self.sample_time * self.torque_rate
        super()._prepare()
        self._difference = np.eye(self.horizon * joints) - np.eye(self.horizon * joints, k=-joints)

    def _link(self) -> None:
        super()._link()
        self._free, self._by_torque, self._by_force, self._price = self._arrays.arrays[4:]

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

    def reset(self) -> None:
        """Clear the estimate, the integrals, the nominal motion and the last plan."""
        super().reset()
        self._applied: FloatArray | None = None
        self._plan: FloatArray | None = None
        self.limited, self.inaccurate, self.fallback = 0, 0, 0

    def _ignore_rate_limit(self) -> None:
        """Ignore ``torque_rate``, for `linear_controller`: a linear loop has no limits.

        Otherwise the small changes of readings between its updates would activate this limit.
        """
        self._rate_step = None

    def report(self) -> dict[str, float]:
        """See ``Controller.report``."""
        names = "limited", "inaccurate", "fallback"
        return super().report() | {f"mpc_{name}": getattr(self, name) for name in names}

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        self._applied = super().update(t, measurement, reference)
        return self._applied

    def _within_limits(self, torque: FloatArray) -> FloatArray:
        if self._rate_step is not None and self._applied is not None:
            last, step = self._applied, self._rate_step
            torque = np.clip(torque, last - step, last + step)
        return super()._within_limits(torque)

    def _feedback(self) -> FloatArray:
        N, m = self.horizon, self.arm.joints
        missing = self._motion.missing
        window = sliding_window_view(missing, self._previewed + 1, axis=0)[:N, :, :: self._stride]
        fed = -(np.swapaxes(window, 1, 2).reshape(N, -1) @ self._ahead.T).ravel()
        free = self._free @ self._whole + self._by_torque @ fed
        free += self._by_force @ missing[:N].ravel()
        nominal = self._motion.torques(N).ravel()
        self._plan = self._limited(nominal + free)
        found: FloatArray = self._plan[:m] - nominal[:m]
        return found

    def _limited(self, free: FloatArray) -> FloatArray:
        """Return optimal torques (horizon joints,) within the limits, or the last plan.

        ``free`` (horizon joints,) are those without limits, which are optimal if they are within.
        """
        low, high = self._bounds(free)
        if np.all(low <= 0.0) and np.all(high >= 0.0):
            return free
        self.limited += 1
        change, excess = self._change(low, high)
        if excess > _TOLERANCE:
            self.inaccurate += excess <= _ACCEPTED
        if excess <= _ACCEPTED:
            return free + change
        return self._shifted(free)

    def _shifted(self, first: FloatArray) -> FloatArray:
        """Return the last plan, shifted by one sample; at the first sample ``first``."""
        self.fallback += 1
        if self._plan is None:
            return first  # the caller clips the torque
        m = self.arm.joints
        return np.append(self._plan[m:], self._plan[-m:])

    def _bounds(self, torque: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distances of torques over the horizon from the limits."""
        most = np.tile(self._most, self.horizon)
        low, high = -most - torque, most - torque
        if self._rate_step is not None:
            change = self._difference @ torque
            step = np.tile(self._rate_step, self.horizon)
            m = self.arm.joints
            if self._applied is None:
                step[:m] = np.inf  # the first torque is arbitrary
            else:
                change[:m] -= self._applied
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
        root = np.linalg.inv(np.linalg.cholesky(self._price)).T
        by: FloatArray = (self._by_torque.reshape(-1, N, m) @ root).reshape(-1, N * m)
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
