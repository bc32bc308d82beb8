"""Model predictive control on the nonlinear model, with real-time iterations."""

from __future__ import annotations

from inspect import signature
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.control.contract.base import FloatArray, Measurement, Reference, applied
from flexarm.control.design.linear_design import Design, preview_cost
from flexarm.control.design.nominal import Nominal
from flexarm.control.laws.linear.lqg import LQG
from flexarm.control.laws.linear.mpc import MPC
from flexarm.linear.step_derivatives.sampled_step import SampledSteps, Steps
from flexarm.model import Link, ModalDamping
from flexarm.model.drives.linear import NonlinearMPCParameters


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

    def __post_init__(self) -> None:
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
        beyond = preview_cost(item, self._previewed, self._stride)
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
            inputs = {"nominal_angle": nominal.angle}
            if "tip" in self.design_requirements.integrated:
                inputs["nominal_tip"] = self._desired_tip(nominal)
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
        """Return the programme about the motion from x (2 dof,) under torques (N, joints).

        The result is None if the motion or the programme overflows.
        """
        from scipy.linalg import lapack

        if not all(np.all(np.isfinite(array)) for array in steps):
            return None
        N, n, m = self.horizon, self._states, self._joints
        s = n + self._integrals
        weight, cost, torque_weight, to_integrals = self._arrays.arrays[4:8]
        by = np.zeros((N, s, s + N * m))
        last = np.eye(s, s + N * m)
        for k in range(N):
            end = s + k * m
            by[k, :n, :end] = steps.state[k] @ last[:n, :end]
            by[k, :n, end : end + m] = steps.torque[k]
            if s > n:
                by[k, n:, :end] = last[n:, :end] + to_integrals @ last[:n, :end]
            last = by[k]
        weighted = np.empty_like(by)
        np.matmul(weight, by[:-1], out=weighted[:-1])
        np.matmul(cost, by[-1], out=weighted[-1])
        flat = weighted.reshape(N * s, -1)
        both = by[:, :, s:].reshape(N * s, -1).T @ flat
        hessian = both[:, s:]
        blocks = np.einsum("kikj->kij", hessian.reshape(N, m, N, m))  # a view of the diagonal
        blocks += torque_weight
        # LAPACK directly, because it takes a quarter of the time of an inverse by NumPy.
        factor, failed = lapack.dpotrf(hessian, lower=1)
        if failed:
            return None
        root = lapack.dtrtri(factor, lower=1)[0].T
        states = np.vstack([x, steps.after])
        return _Prepared(states, torques.ravel(), flat, last[:, s:], both[:, :s], root)

    def _next_plan(
        self, ready: _Prepared | None, x: FloatArray, wanted: FloatArray, plans: dict[str, Any]
    ) -> FloatArray:
        """Return the torques (N joints,) of the programme for the state x (2 dof,) at its start.

        Without a programme they are those of the last plan.
        """
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
