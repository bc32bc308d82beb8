"""Model predictive control: the regulator, within torque limits; (C.29) to (C.31)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from flexarm.arguments import check_count
from flexarm.arm import Arm
from flexarm.control.base import FloatArray, Measurement, Reference
from flexarm.control.linear_design import Design, scales
from flexarm.control.lqg import LQG
from flexarm.errors import InputError, Problem

_MOST_STEPS = 500
#: Of torques, in parts of the limits: polishing then solves for the active ones to rounding.
_TOLERANCE = 1e-6
_ITERATIONS = 20_000


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

    Raises:
        InputError: as `LQG`; OSQP is not installed.

    Solved by OSQP (Stellato and others 2020), from the solution of the sample before. When it is
    not solved, ``update`` raises ``RuntimeError``: rates that cannot be kept together with the
    limits are the usual reason.
    """

    name = "mpc"
    references = "Stellato2020"

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
        try:
            import osqp  # noqa: F401
        except ImportError:
            hint = "pip install 'flexarm[mpc]' brings it."
            raise InputError(Problem("MPC", "osqp", "be installed", "not", hint)) from None
        self.horizon = check_count("MPC", "horizon", horizon, most=_MOST_STEPS)
        self.torque_rate = torque_rate
        super().__init__(
            arm, posture, torque_limit=torque_limit, sample_time=sample_time, **options
        )

    def _prepare(self, where: str) -> None:
        joints = self.arm.joints
        if self.torque_limit is None:
            raise InputError(Problem(where, "torque_limit", "be given", "nothing"))
        self._rate_step = (
            None
            if self.torque_rate is None
            else self.sample_time * scales(where, "torque_rate", self.torque_rate, joints)
        )
        super()._prepare(where)
        self._difference = np.eye(self.horizon * joints) - np.eye(self.horizon * joints, k=-joints)
        self._solver: Any = None

    def _link(self) -> None:
        super()._link()
        self._free, self._by_torque, self._by_force, self._price = self._arrays.arrays[4:]

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_solver": None}  # of OSQP, which makes no copies

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
        """Forget the estimate, the integrals, the nominal motion and the last solution."""
        super().reset()
        self._applied: FloatArray | None = None
        self._solver = None
        #: Samples at which a limit was in reach, and OSQP's iterations there.
        self.solved, self.iterations = 0, 0

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``.

        Raises:
            RuntimeError: there are no torques within the limits, or they were not found.
        """
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
            return free[:m]  # the regulator keeps within the limits: nothing is cheaper
        return free[:m] + self._changes(low, high)[:m]

    def _bounds(self, nominal: FloatArray, free: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Room that the regulator leaves to the limits, over the horizon."""
        assert self.torque_limit is not None
        torque = nominal + free
        most = np.tile(self.torque_limit, self.horizon)
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

    def _changes(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the cheapest changes (horizon joints,) to the regulator's torques; (C.31)."""
        assert self.torque_limit is not None
        scale = float(np.max(self.torque_limit))
        rows = self._by_torque
        if self._rate_step is not None:
            rows = np.vstack([rows, self._difference @ rows])
        one = self._price / np.max(np.diag(self._price))
        price = np.asarray(np.kron(np.eye(self.horizon), one), dtype=np.float64)
        low, high = low / scale, high / scale
        if self._solver is None:
            self._set_up(price, rows, low, high)
        else:
            self._solver.update(
                Px=price[self._price_places],
                Ax=rows[self._row_places],
                q=np.zeros(len(price)),
                l=low,
                u=high,
            )
        found = self._solver.solve(raise_error=False)
        self.solved += 1
        self.iterations += int(found.info.iter)
        if found.info.status != "solved":
            raise RuntimeError(f"no torques within the limits were found ({found.info.status})")
        changes: FloatArray = scale * found.x
        return changes

    def _set_up(
        self, price: FloatArray, rows: FloatArray, low: FloatArray, high: FloatArray
    ) -> None:
        """Make a solver; the same entries of its sparse matrices are written at each sample."""
        import osqp
        from scipy.sparse import csc_matrix

        block = np.kron(np.eye(self.horizon), np.ones_like(self._price))
        lower = np.kron(np.tril(np.ones((self.horizon,) * 2)), np.ones_like(self._price))
        times = len(rows) // len(lower)
        self._price_places = _columns_first(np.triu(block))
        self._row_places = _columns_first(np.tile(lower, (times, 1)))
        P = csc_matrix((price[self._price_places], self._price_places), shape=price.shape)
        G = csc_matrix((rows[self._row_places], self._row_places), shape=rows.shape)
        self._solver = osqp.OSQP()
        self._solver.setup(
            P,
            np.zeros(len(price)),
            G,
            low,
            high,
            verbose=False,
            polishing=True,
            warm_starting=True,
            eps_abs=_TOLERANCE,
            eps_rel=_TOLERANCE,
            max_iter=_ITERATIONS,
        )


def _lower(blocks: list[FloatArray]) -> FloatArray:
    """Return the block matrix whose diagonals below the first hold the blocks in turn."""
    count, (rows, columns) = len(blocks), blocks[0].shape
    whole = np.zeros((count * rows, count * columns))
    for i in range(count):
        for j in range(i + 1):
            place = slice(i * rows, (i + 1) * rows), slice(j * columns, (j + 1) * columns)
            whole[place] = blocks[i - j]
    return whole


def _columns_first(pattern: FloatArray) -> tuple[Any, Any]:
    """Return rows and columns of the entries that are not zero, as sparse columns hold them."""
    columns, rows = np.nonzero(pattern.T)
    return rows, columns
