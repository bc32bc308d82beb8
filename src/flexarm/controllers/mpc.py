"""Model predictive control: the regulator, within torque limits; (C.29) to (C.31)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from flexarm.arguments import check_count
from flexarm.arm import Arm
from flexarm.control.base import FloatArray, Measurement, Reference
from flexarm.control_design.linear_design import Design, scales
from flexarm.controllers.lqg import LQG
from flexarm.errors import InputError, Problem

_MOST_STEPS = 500
#: Largest excess of a plan over a limit, in parts of it: rounding leaves 1e-8 where feedback
#: requests hundreds of times the limits. Larger ones are counted, and up to the second used.
_TOLERANCE, _ACCEPTED = 1e-6, 1e-2
#: Active-set changes of one sample, as a multiple of the number of limits; the usual number is a
#: quarter of them.
_MOST_CHANGES = 10


class MPC(LQG):
    """Linear model predictive control with limits of torques and of their rates.

    At every sample it finds the torques of the horizon that cost least within the limits, and
    applies the first. Beyond the horizon the cost is the regulator's: where no limit is reached it
    does what `LQG` does, exactly.

    Args:
        arm, posture, options: as for `LQG`, which also says what each means.
        torque_limit: N m, one number or one for each joint.
        torque_rate: N m/s, likewise, or None: how fast torques may change from sample to sample.
        horizon: number of samples, 1 to 500.
        sample_time: s.

    Attributes:
        limited: samples of the last run at which a limit was within reach of the horizon.
        inaccurate: those of them whose plan exceeded a limit by 1e-6 to 1e-2 of it; the torque
            itself is cut.
        fallback: those of them without a usable plan; the plan of the sample before was used,
            one sample later.

    Raises:
        InputError: as `LQG`.

    A plan within the limits always exists: the last torque, held. The quadratic programme (C.31)
    is solved exactly as a least-distance problem (Lawson and Hanson 1974, chapter 23). The three
    counts are attributes of results: ``mpc_limited``, ``mpc_inaccurate``, ``mpc_fallback``.
    """

    name = "mpc"
    memory = LQG.memory
    references = "LawsonHanson1974"

    def __init__(
        self,
        arm: Arm,
        posture: ArrayLike | None = None,
        *,
        torque_limit: ArrayLike,
        torque_rate: ArrayLike | None = None,
        horizon: int = 40,
        sample_time: float = 5e-3,
        **options: Any,
    ) -> None:
        self.horizon = check_count("MPC", "horizon", horizon, most=_MOST_STEPS)
        self.torque_rate = torque_rate
        super().__init__(
            arm, posture, torque_limit=torque_limit, sample_time=sample_time, **options
        )

    def _prepare(self, where: str) -> None:
        joints = self.arm.joints
        if self.torque_limit is None:
            raise InputError(Problem(where, "torque_limit", "be given", "nothing"))
        self._most = self.torque_limit
        self._rate_step = (
            None
            if self.torque_rate is None
            else self.sample_time * scales(where, "torque_rate", self.torque_rate, joints)
        )
        super()._prepare(where)
        self._difference = np.eye(self.horizon * joints) - np.eye(self.horizon * joints, k=-joints)

    def _link(self) -> None:
        super()._link()
        self._free, self._by_torque, self._by_force, self._price = self._arrays.arrays[4:]

    @property
    def _steps(self) -> int:
        return super()._steps + self.horizon

    def _node(self, item: Design) -> list[FloatArray]:
        """Torques of the horizon by state, by changes of torque and by elastic forces; (C.30)."""
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
        """Forget the estimate, the integrals, the nominal motion and the last plan."""
        super().reset()
        self._applied: FloatArray | None = None
        self._plan: FloatArray | None = None
        self.limited, self.inaccurate, self.fallback = 0, 0, 0

    def _ignore_rate_limit(self) -> None:
        """Leave out ``torque_rate``, for `linear_controller`: a linear loop has no limits.

        Small changes of a reading from one update to the next would meet this one.
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
        low, high = self._bounds(nominal, free)
        if np.all(low <= 0.0) and np.all(high >= 0.0):
            wanted = free  # the regulator keeps within the limits: nothing is cheaper
        else:
            self.limited += 1
            wanted = self._limited(nominal, free, low, high)
        self._plan = nominal + wanted
        return wanted[:m]

    def _limited(
        self, nominal: FloatArray, free: FloatArray, low: FloatArray, high: FloatArray
    ) -> FloatArray:
        """Return the cheapest torques (horizon joints,) within the limits, or the last plan's."""
        change, excess = self._change(low, high)
        if excess > _TOLERANCE:
            self.inaccurate += excess <= _ACCEPTED
        if excess <= _ACCEPTED:
            return free + change
        self.fallback += 1
        if self._plan is None:
            return free  # at the first sample; what is requested is cut
        m = self.arm.joints
        return np.append(self._plan[m:], self._plan[-m:]) - nominal

    def _bounds(self, nominal: FloatArray, free: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Room that the regulator leaves to the limits, over the horizon."""
        torque = nominal + free
        most = np.tile(self._most, self.horizon)
        low, high = -most - torque, most - torque
        if self._rate_step is not None:
            change = self._difference @ torque
            step = np.tile(self._rate_step, self.horizon)
            m = self.arm.joints
            if self._applied is None:
                step[:m] = np.inf  # motors may begin with any torque
            else:
                change[:m] -= self._applied
            low, high = np.append(low, -step - change), np.append(high, step - change)
        return low, high

    def _change(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, float]:
        """Return the cheapest change (horizon joints,) of the regulator's torques; (C.31).

        And by how much it exceeds a limit, in parts of it; infinite if none was found.
        """
        N, m = self.horizon, self.arm.joints
        # In these unknowns the cost is the sum of squares, however different the joints are.
        root = np.linalg.inv(np.linalg.cholesky(self._price)).T
        by_unknown = (self._by_torque.reshape(-1, N, m) @ root).reshape(-1, N * m)
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
            return np.zeros(N * m), np.inf
        excess = float(np.max(floor - matrix @ least))
        return by_unknown @ least, excess if np.isfinite(excess) else np.inf


def least_distance(matrix: FloatArray, floor: FloatArray) -> FloatArray | None:
    """Return the shortest x (n,) with ``matrix @ x >= floor``; None if it was not found.

    By the dual, a problem of nonnegative least squares: an active-set method that ends after
    finitely many steps and has nothing to tune. Lawson and Hanson, Solving Least Squares
    Problems (1974), chapter 23, algorithm LDP.
    """
    from scipy.optimize import nnls

    # Rows of length one and floors of at most one: the answer's scale is that of the problem.
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
    """Return the block matrix whose diagonals below the first hold the blocks in turn."""
    count, (rows, columns) = len(blocks), blocks[0].shape
    whole = np.zeros((count * rows, count * columns))
    for i in range(count):
        for j in range(i + 1):
            place = slice(i * rows, (i + 1) * rows), slice(j * columns, (j + 1) * columns)
            whole[place] = blocks[i - j]
    return whole
