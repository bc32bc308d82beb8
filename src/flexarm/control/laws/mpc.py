"""Model predictive control: linear, (C.29) to (C.31), and nonlinear, with real-time iterations."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from inspect import signature
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.base.late import linalg, optimize
from flexarm.control.contract.base import Arrays, FloatArray, Measurement, Reference, Step, applied
from flexarm.control.design.linear_design import Design, previewed, regulated
from flexarm.control.design.nominal import Nominal
from flexarm.control.laws.lqg import LQG
from flexarm.linear.step_derivatives.sampled_step import SampledSteps, Steps
from flexarm.model import Link, ModalDamping
from flexarm.model.arm.spec import UNDRIVEN
from flexarm.model.drives.linear import MPCParameters, NonlinearMPCParameters

#: Largest relative excesses of a plan over a limit. Rounding causes 1e-8 if feedback requests
#: hundreds of times the limits. Plans above the first are counted, those above the second not used.
_TOLERANCE, _ACCEPTED = 1e-6, 1e-2
#: Largest violation of a constraint that is a rounding error, relative to the largest distance.
_ROUNDING = 1e-9
#: Largest number of active-set changes at a sample, per number of limits; a quarter is typical.
_MOST_CHANGES = 10
#: Largest number of active sets that are tried from that of the last sample; one to four are
#: typical, and each costs a quarter of the method that needs no guess.
_MOST_TRIED = 8


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
    knows_limits = False  # plans within its own ones
    references = "LawsonHanson1974"

    def _prepare(self) -> None:
        N, m = self.horizon, self.arm.n_joints
        self._rate_step = None if self.torque_rate is None else self.sample_time * self.torque_rate
        self._difference = np.eye(N * m) - np.eye(N * m, k=-m)
        kinds = [limit for limit in (self.torque_limit, self._rate_step) if limit is not None]
        self._limits = np.concatenate([np.tile(limit, N) for limit in kinds])
        super()._prepare()

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
        m, k = item.B.shape[1], len(item.integrated)
        push, loop = regulated(item)
        forced = np.vstack([item.B_elastic, np.zeros((k, item.B_elastic.shape[1]))])
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
        mine.nominal = mine.torque_rate = None
        mine._prepare()
        return mine

    def report(self) -> dict[str, float]:
        names = "limited", "inaccurate", "fallback"
        return super().report() | {f"mpc_{name}": getattr(self, name) for name in names}

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the inputs of `LQG`, and elastic forces and nominal torques over the horizon."""
        inputs = super().planned(t, reference)
        forces, torques = self._motion.missing, self._nominal_torques(self.horizon)
        return {**inputs, "forces_ahead": forces[self._delayed :], "torques_ahead": torques}

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {**super().initial_memory(readings, inputs), **self._first_plan()}

    def _first_plan(self) -> dict[str, Any]:
        """Return the memory of plans before the first one, which is not a number."""
        m = self.arm.n_joints
        plans = {"applied": np.full(m, np.nan), "plan": np.full(self.horizon * m, np.nan)}
        active = np.zeros(
            (2 * self._limits.size // (self.horizon * m), self.horizon, m), dtype=bool
        )
        return {**plans, "active": active, "limited": 0, "inaccurate": 0, "fallback": 0}

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
        N, m = self.horizon, self.arm.n_joints
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
        """Return optimal torques (horizon joints,) within the limits, or the last plan."""
        low, high = self._bounds(free, plans["applied"])
        if np.all(low <= 0.0) and np.all(high >= 0.0):
            return free
        plans["limited"] += 1
        change, excess, plans["active"] = self._change(low, high, plans["active"])
        if excess > _TOLERANCE:
            plans["inaccurate"] += int(excess <= _ACCEPTED)
        if excess <= _ACCEPTED:
            return free + change
        return self._shifted(free, plans)

    def _shifted(self, first: FloatArray, plans: dict[str, Any]) -> FloatArray:
        """Return the last plan, shifted by one sample; at the first sample ``first``."""
        plans["fallback"] += 1
        plan, m = plans["plan"], self.arm.n_joints
        if np.isnan(plan[0]):
            return first  # the caller clips the torque
        return np.append(plan[m:], plan[-m:])

    def _bounds(self, torque: FloatArray, applied: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distances of torques over the horizon from the limits."""
        limits, planned = self._limits, torque
        if self._rate_step is not None:
            planned = np.append(torque, self._difference @ torque)
            first = slice(torque.size, torque.size + applied.size)
            if np.isnan(applied[0]):
                limits = limits.copy()
                limits[first] = np.inf  # the first torque is arbitrary
            else:
                planned[first] -= applied
        return -limits - planned, limits - planned

    def _change(
        self, low: FloatArray, high: FloatArray, active: NDArray[np.bool_]
    ) -> tuple[FloatArray, float, NDArray[np.bool_]]:
        """Return the optimal change (horizon joints,) of the regulator's torques; (C.31).

        ``active`` are the active limits of the last sample. The second result is the relative
        excess of the change over a limit, infinite if none was found; the third its active limits.
        """
        rows = by_unknown = self._torque_by_unknown()
        if self._rate_step is not None:
            rows = np.vstack([rows, self._difference @ rows])
        rows = rows / self._limits[:, None]
        matrix = np.concatenate([rows, -rows])
        with np.errstate(invalid="ignore"):  # the first torque is arbitrary
            floor = np.concatenate([low / self._limits, -high / self._limits])
        later = np.concatenate([active[:, 1:], active[:, -1:]], axis=1).ravel()
        finite, found = np.isfinite(floor), np.zeros(later.size, dtype=bool)
        matrix, floor = matrix[finite], floor[finite]
        least, found[finite] = least_distance(matrix, floor, later[finite])
        if least is None:
            return np.zeros(len(by_unknown)), np.inf, active
        excess = float(np.max(floor - matrix @ least))
        change = by_unknown @ least
        return change, excess if np.isfinite(excess) else np.inf, found.reshape(active.shape)

    def _torque_by_unknown(self) -> FloatArray:
        """Return the torques of the horizon by unknowns whose sum of squares is the cost."""
        N, m = self.horizon, self.arm.n_joints
        by_torque, _, price = self._arrays.arrays[5:8]
        root = np.linalg.inv(np.linalg.cholesky(price)).T
        return np.asarray((by_torque.reshape(-1, N, m) @ root).reshape(-1, N * m))


def least_distance(
    matrix: FloatArray, floor: FloatArray, active: NDArray[np.bool_]
) -> tuple[FloatArray | None, NDArray[np.bool_]]:
    """Return the shortest x (n,) with ``matrix @ x >= floor``, or None, and its active rows.

    The rows that are ``active`` are tried first: those with a negative multiplier are replaced by
    those that are violated, until neither exist (Hintermueller, Ito and Kunisch, SIAM J. Optim. 13
    (2002) 865-888). Otherwise the dual, a nonnegative least-squares problem, is solved in finitely
    many steps (Lawson and Hanson, Solving Least Squares Problems (1974), chapter 23, LDP).
    """
    # Scale rows to length one and floors to at most one, so that tolerances are relative.
    length = np.sqrt(np.einsum("ij,ij->i", matrix, matrix))
    rows, scaled = matrix / length[:, None], floor / length
    size = max(float(np.max(scaled)), 1e-300)
    tried = active if np.any(active) else scaled > 0.0
    for _ in range(_MOST_TRIED):
        chosen = rows[tried]
        _, multipliers, failed = linalg.lapack.dposv(chosen @ chosen.T, scaled[tried])
        least = multipliers @ chosen
        missed, better = scaled - rows @ least, multipliers > 0.0
        exact = np.abs(missed[tried]).max() <= _ROUNDING * size
        others = missed > _ROUNDING * size
        if not failed and exact and np.all(better) and not np.any(others & ~tried):
            return least, tried
        others[tried] = better
        if failed or not np.any(others):
            break
        tried = others
    dual = np.vstack([rows.T, scaled / size])
    unit = np.zeros(len(dual))
    unit[-1] = 1.0
    try:
        weights, _ = optimize.nnls(dual, unit, maxiter=_MOST_CHANGES * dual.shape[1])
    except RuntimeError:
        return None, active
    residual = dual @ weights - unit
    if residual[-1] == 0.0:
        return None, active
    return -size * residual[:-1] / residual[-1], weights > 0.0


def _lower(blocks: list[FloatArray]) -> FloatArray:
    """Return the lower block-triangular Toeplitz matrix with these blocks."""
    count, (rows, columns) = len(blocks), blocks[0].shape
    whole = np.zeros((count * rows, count * columns))
    for i in range(count):
        for j in range(i + 1):
            place = slice(i * rows, (i + 1) * rows), slice(j * columns, (j + 1) * columns)
            whole[place] = blocks[i - j]
    return whole


class _Prepared(NamedTuple):
    """Quadratic programme about a predicted motion; s = 2 dof + k states and integrals."""

    states: FloatArray  # (N + 1, 2 dof) [q, qd] from the next sample on
    torques: FloatArray  # (N joints,) of the motion, N m
    weighted: FloatArray  # (N s, s + N joints) states after the first, weighted, by x and torques
    terminal: FloatArray  # (s, N joints) the last of them by torques, without weights
    coupling: FloatArray  # (N joints, s) gradient of the cost by the first state
    root: FloatArray  # (N joints, N joints) R with R R' the inverse of the Hessian


class NonlinearMPC(NonlinearMPCParameters, MPC):
    """Nonlinear model predictive control with limits of torques and of their rates.

    At every sample the controller takes one Gauss-Newton step (a real-time iteration) towards the
    torques with the least cost over the horizon, as predicted by the nonlinear dynamics of the arm
    and applies the first. The weights, the cost beyond the horizon, and the gain
    of the estimator are those of `LQG`, so the torques are nearly those of `LQG` for small motions
    within the limits. The estimate begins at the first readings of the encoders, and is predicted
    by the nonlinear dynamics, too.

    Attributes:
        arm: the model of the controller; with ``modes``, with at most so many for each link.
        limited, inaccurate, fallback: as for `MPC`; for several iterations, of the last.
            ``fallback`` also counts samples without a plan because the prediction overflowed; the
            estimate then starts again from the readings of the encoders.

    Raises:
        InputError: as for `LQG`.

    ``update`` is ``feedback``, which solves a quadratic programme, and then ``prepare``, which
    linearises the prediction for the next sample. A control loop can apply the torque between the
    two. Diehl, Bock and Schloeder, SIAM J. Control Optim. 43 (2005) 1714-1736, with the states
    eliminated: all of them are those of a simulation under the torques of the last sample.
    """

    references = "DiehlBockSchloeder2005 LawsonHanson1974"
    _unsupported = UNDRIVEN
    hardware: ClassVar[None] = None  # type: ignore[misc]

    def __post_init__(self) -> None:
        if self.actuated is not None:
            rule = "is not supported for nonlinear predictions"
            raise InputError(Problem("actuated", rule, hint="Use MPC."))
        if self.modes is not None:
            self.arm = with_modes(self.arm, self.modes)
        super().__post_init__()

    def at_rest(self) -> LQG:
        """Return the regulator that computes nearly its torques for small motions within limits.

        It has the same model, weights and sample time. Its `loop_margins` are those to look at.
        """
        names = signature(LQG).parameters.keys() - {"arm", "nominal"}
        return LQG(self.arm, **{name: getattr(self, name) for name in names})

    def _prepare(self) -> None:
        self._model_steps = SampledSteps(self.arm, self._sample_time, self.horizon + 1)
        super()._prepare()

    def _node(self, item: Design) -> list[FloatArray]:
        beyond = previewed(item, regulated(item)[1].T, self._previewed, self._stride)
        own = [item.weight, item.cost, item.torque_weight, item.integrated]
        return [*LQG._node(self, item), *own, beyond.reshape(len(beyond), -1)]

    def reset(self) -> None:
        """Clear the estimate, the integrals, the nominal motion and the last plan."""
        super().reset()
        self._plans = self._first_plan()
        self._known = np.zeros(self._states + self._outputs)
        self._whole = np.zeros(self._states + self._integrals)
        self._ready: _Prepared | None = None
        self._now: tuple[FloatArray, FloatArray] | None = None

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        torque: FloatArray = self.feedback(t, measurement, reference)
        self.prepare()
        return torque

    def feedback(
        self, t: float, measurement: Measurement, reference: Reference | None
    ) -> FloatArray:
        """Return the torques (joints,) N m of ``update``; call ``prepare`` before the next sample.

        Args:
            t, measurement, reference: as for ``update``.
        """
        if self._now is not None:
            self.prepare()
        m, N = self._joints, self.horizon
        nominal = self._motion.at(t, self._reference_or_rest(measurement, reference))
        self._arrays.at(nominal.angle)
        wanted = self._motion.states(N + 1)
        x = self._estimated(nominal, wanted[0], measurement)
        ready, plans = self._ready, self._plans
        if np.isnan(plans["plan"][0]):
            ready = self._linearised(x, self._motion.torques(N))
        for _ in range(self.iterations - 1):
            plan = self._next_plan(ready, x, wanted, dict(plans))
            ready = self._linearised(x, plan.reshape(N, m))
        plan = plans["plan"] = self._next_plan(ready, x, wanted, plans)
        torque = self._within_limits(plan[:m], plans)
        if self._integrals:
            inputs = {"nominal_angle": nominal.angle, "nominal_reading": nominal.shown}
            if "tip" in self.design_requirements.integrated:
                inputs["nominal_tip"] = self._desired_tip(t, nominal, reference)
            rise, gain = self._rise(measurement, inputs), self._arrays.arrays[1]
            request = -applied(gain[:, self._states :], rise)
            self._whole[self._states :] += (request @ (plan[:m] - torque) <= 0.0) * rise
        plans["applied"], self._now = torque, (x, torque)
        self._keep({**plans, "estimate": self._whole[: self._states].copy()})
        return torque.copy()

    def prepare(self) -> None:
        """Predict the motion from the next sample on under the last plan, and linearise it."""
        if self._now is None:
            return
        (x, torque), self._now = self._now, None
        m = self._joints
        last = self._plans["plan"]
        plan = np.vstack([torque, last[m:].reshape(-1, m), last[-m:]])
        steps = self._model_steps.take(x, plan)
        self._known[: self._states] = steps.after[0]
        rest = Steps(*(array[1:] for array in steps))
        self._ready = self._programme(steps.after[0], rest, plan[1:])

    def _estimated(
        self, nominal: Nominal, wanted: FloatArray, measurement: Measurement
    ) -> FloatArray:
        """Return the estimated state (2 dof,) from its prediction and the measurement; (C.26)."""
        n = self._states
        if self._ready is None:
            # A reference may begin far from the arm; the filter would take that for fast motion.
            self._known[:n] = wanted
            if "joint_angle" in self.design_requirements.measured:
                self._known[self.arm.joint_index] = measurement.joint_angle
        self._known[:n] -= wanted
        shown = [measurement[name] for name in self.design_requirements.measured]
        self._known[n:] = np.concatenate(shown) - nominal.shown
        self._whole[:n] = self._arrays.arrays[0] @ self._known
        x: FloatArray = wanted + self._whole[:n]
        return x

    def _linearised(self, x: FloatArray, torques: FloatArray) -> _Prepared | None:
        return self._programme(x, self._model_steps.take(x, torques), torques)

    @np.errstate(over="ignore", invalid="ignore")
    def _programme(self, x: FloatArray, steps: Steps, torques: FloatArray) -> _Prepared | None:
        """Return the programme about the motion from x (2 dof,) under torques (N, joints)."""
        if not np.isfinite(sum(np.sum(array) for array in steps)):
            return None
        N, n, m = self.horizon, self._states, self._joints
        s = n + self._integrals
        weight, cost, torque_weight, to_integrals = self._arrays.arrays[4:8]
        by, last = np.empty((N, s, s + N * m)), np.eye(s, s + N * m)
        loops = np.tile(np.eye(s), (N, 1, 1))
        loops[:, :n, :n], loops[:, n:, :n] = steps.state, to_integrals
        for k, (loop, row) in enumerate(zip(loops, by, strict=True)):
            last = np.matmul(loop, last, out=row)
            row[:n, s + k * m : s + (k + 1) * m] = steps.torque[k]
        weighted = np.empty_like(by)
        np.matmul(weight, by[:-1], out=weighted[:-1])
        np.matmul(cost, by[-1], out=weighted[-1])
        flat = weighted.reshape(N * s, -1)
        both = by[:, :, s:].reshape(N * s, -1).T @ flat
        hessian = both[:, s:]
        blocks = np.einsum("kikj->kij", hessian.reshape(N, m, N, m))  # a view of the diagonal
        blocks += torque_weight
        # LAPACK directly, because it takes a quarter of the time of an inverse by NumPy.
        factor, failed = linalg.lapack.dpotrf(hessian, lower=1)
        if failed:
            return None
        root = linalg.lapack.dtrtri(factor, lower=1)[0].T
        states = np.vstack([x, steps.after])
        return _Prepared(states, torques.ravel(), flat, last[:, s:], both[:, :s], root)

    def _next_plan(
        self, ready: _Prepared | None, x: FloatArray, wanted: FloatArray, plans: dict[str, Any]
    ) -> FloatArray:
        """Return the torques (N joints,) of the programme for the state x (2 dof,) at its start."""
        if ready is None:
            return self._shifted(self._motion.torques(self.horizon).ravel(), plans)
        _, _, torque_weight, to_integrals, previewed = self._arrays.arrays[4:]
        N, n, m = self.horizon, self._states, self._joints
        s = n + self._integrals
        errors = np.zeros((N + 1, s))
        errors[:, :n] = ready.states - wanted
        if s > n:
            errors[:, n:] = self._whole[n:]
            errors[1:, n:] += np.cumsum(errors[:-1, :n] @ to_integrals.T, axis=0)
        start = np.zeros(s)
        start[:n] = x - ready.states[0]
        beyond = self._motion.missing[N : N + self._previewed + 1 : self._stride]
        push = (ready.torques - self._motion.torques(N).ravel()).reshape(N, m)
        gradient = (
            errors[1:].ravel() @ ready.weighted[:, s:]
            + ready.coupling @ start
            + (push @ torque_weight).ravel()
            + (previewed @ beyond.ravel()) @ ready.terminal
        )
        self._root = ready.root
        return self._limited(ready.torques - ready.root @ (ready.root.T @ gradient), plans)

    def _torque_by_unknown(self) -> FloatArray:
        return self._root


def with_modes(arm: Arm, most: int) -> Arm:
    """Return an arm with at most ``most`` modes of each link, or of each segment of it."""
    links = tuple(_with_modes(link, most) for link in arm.spec.links)
    if all(new is old for new, old in zip(links, arm.spec.links, strict=True)):
        return arm
    return Arm(arm.spec.model_copy(update={"links": links}))


def _with_modes(link: Link, most: int) -> Link:
    if link.coordinates <= most * link.segments:
        return link
    damping = link.damping
    if isinstance(damping, ModalDamping) and isinstance(damping.ratio, tuple):
        damping = ModalDamping(ratio=damping.ratio[:most])
    return link.replace(modes=most, damping=damping)
