"""Extended Kalman filter as functions for C.

The covariance is propagated by the derivatives of the exported step, and the readings are those of
the kernels over symbols. Products of matrices are loops of CasADi's code generator, so that the
size of the code does not grow with the cube of the number of states.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_kind
from flexarm.base.errors import InputError, Problem, shown
from flexarm.bridges.c_code.model_functions import (
    NamedFunction,
    dynamics_of_columns,
    named,
    runge_kutta,
    with_derivatives,
)
from flexarm.bridges.symbolic.kernel_calls import ParametricArm, objects, plain
from flexarm.bridges.symbolic.models import casadi_model
from flexarm.control.filters.estimator import (
    LEAST_STIFFNESS,
    SAG_DIFFERENCE,
    first_variance,
    tip_mass,
)
from flexarm.control.filters.kalman_filter import (
    ExtendedKalmanFilter,
    corrected,
    linearisations,
    propagated,
    split,
    widest_single,
)
from flexarm.control.filters.predicted_readings import Link, PredictedReadings, Readings
from flexarm.linear.models.state_space import find_outputs
from flexarm.linear.step_derivatives.sampled_step import SampledStep
from flexarm.model.arm.spec import UNDRIVEN, serial_only

_PAYLOAD = "payload.mass"
#: Steps of Newton's method for the sag at the start, which a fixed cost requires. Four are exact to
#: rounding for links that bend by 15 % of their length, linear or of second order.
_NEWTON_STEPS = 6


@dataclass(frozen=True, eq=False)
class Observer:
    """Functions of a filter."""

    filter: ExtendedKalmanFilter  # a copy at its start
    functions: tuple[NamedFunction, ...]  # ``observer_start`` and ``observer_update``

    @property
    def sample_time(self) -> float:
        """Sample time, s."""
        return float(self.filter.sample_time)

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes by the names of their macros, without the prefix."""
        dof = self.filter.arm.dof
        states = 2 * dof + 1
        return {
            "OBSERVER_DOF": dof,
            "OBSERVER_READINGS": len(self.reading_names),
            "OBSERVER_MEMORY": states * (1 + states),
        }

    @property
    def reading_names(self) -> list[str]:
        """Name and unit of each reading."""
        outputs = find_outputs(self.filter.arm, [item.output for item in self.filter.instruments])
        return [f"{name}, {one.unit}" for one in outputs for name in one.names]


def exported_observer(arm: Arm, observer: object) -> Observer:
    """Return the functions of a filter for an arm; InputError if the code cannot contain it."""
    hint = getattr(observer, "not_exported", "")
    observer = check_kind("observer", observer, ExtendedKalmanFilter, hint=hint)
    serial_only(observer.arm.spec, "observer", UNDRIVEN)
    if len(observer.covariance) > 2 * observer.arm.dof + 1:
        rule = "estimate no parameters, disturbance torques or biases"
        hint = "The code estimates q, qd and the mass of the payload only."
        raise InputError(Problem("observer", rule, hint=hint))
    late = [i.label for i in observer.instruments if i.delay or i.sample_time is not None]
    if late:
        rule = "have instruments without a delay or a sample_time"
        raise InputError(Problem("observer", rule, ", ".join(late)))
    if observer.arm.n_joints != arm.n_joints:
        rule = f"be for an arm with {arm.n_joints} joints"
        raise InputError(Problem("observer", rule, f"one for {observer.arm.n_joints}"))
    widest = widest_single(observer.arm.spec.payload.mass + tip_mass(observer.arm))
    if observer.payload_deviation > widest:
        rule = f"have a payload_deviation of at most {widest:.3g} kg"
        hint = "Above it the filter is a sum of Gaussians, whose number changes during a run."
        value = shown(observer.payload_deviation)
        raise InputError(Problem("observer", rule, value, hint))
    own = deepcopy(observer)
    own.reset()  # The steps are those of the present sample time.
    writer = _Writer(own)
    return Observer(own, (writer.start(), writer.update()))


class _Writer:
    """Construction of the functions; the symbols are those of `ExtendedKalmanFilter`."""

    def __init__(self, observer: ExtendedKalmanFilter) -> None:
        self.filter, self.arm = observer, observer.arm
        self.model = casadi_model(self.arm, [_PAYLOAD])
        self.states = 2 * self.arm.dof + 1
        self.shown = PredictedReadings(self.arm, observer.instruments)
        self.predicted = self._predicted_readings()
        self.own, self.nominal = tip_mass(self.arm), observer.arm.spec.payload.mass
        mean, variance = [self.nominal + self.own], [[observer.payload_deviation**2]]
        self.scale, (prior,) = split(np.array(mean), np.array(variance))
        self.spread = float(prior.P[-1, -1])
        self.steps = SampledStep(self.arm, observer.sample_time).steps
        self.joints = self.arm.joint_index.tolist()
        self.bending = np.setdiff1d(np.arange(self.arm.dof), self.joints).tolist()
        q, mass, zero = casadi.SX.sym("q", self.arm.dof), casadi.SX.sym("mass"), casadi.DM.zeros
        force = self.model.bias_force(q, zero(self.arm.dof), mass)[self.bending]
        results = force, casadi.jacobian(force, q)[:, self.bending]
        self.static = casadi.Function("static", [q, mass], list(map(casadi.densify, results)))
        self.angle = next(i for i in observer.instruments if i.signal == "joint_angle")

    def start(self) -> NamedFunction:
        """Return the estimate at the first readings, for links at rest under gravity."""
        readings = casadi.MX.sym("readings", self.shown.size)
        # Links are straight at the readings of the encoders.
        first = sum(self.shown.counts[: self.filter.instruments.index(self.angle)])
        straight = casadi.MX(casadi.DM.zeros(self.arm.dof))
        straight[self.joints] = readings[first : first + self.arm.n_joints]
        q, by_mass = self._sag(straight)
        x = casadi.vertcat(q, casadi.DM.zeros(self.arm.dof), -0.5 * self.spread)
        along = casadi.vertcat(self.scale * by_mass, casadi.DM.zeros(self.arm.dof), 1.0)
        # The mass has a variance of its own.
        rigid = first_variance(self.arm, self.filter, self.angle, np.ones(self.arm.dof))
        variance = casadi.MX(casadi.DM(np.append(rigid, 0.0)))
        if self.bending:
            stiffness = casadi.diag(self.static(straight, self.nominal)[1])
            least = LEAST_STIFFNESS * casadi.mmax(stiffness)
            variance[self.bending] /= casadi.fmax(stiffness, least)
        P = casadi.diag(variance) + self.spread * (along @ along.T)
        unmoved = casadi.DM.zeros(self.states, self.arm.n_joints)
        still = casadi.DM.zeros(self.arm.n_joints)
        outputs = self._corrected(x, P, unmoved, still, readings)
        summary = "Estimate at the first sample, where the memory starts."
        return named("observer_start", summary, {"readings": readings}, outputs)

    def update(self) -> NamedFunction:
        """Return the estimate at the next sample."""
        size = self.states
        inputs = {
            "readings": casadi.MX.sym("readings", self.shown.size),
            "last_torque": casadi.MX.sym("last_torque", self.arm.n_joints),
            "observer_memory": casadi.MX.sym("observer_memory", size * (1 + size)),
        }
        readings, torque, memory = inputs.values()
        x, P = memory[:size], casadi.reshape(memory[size:], size, size).T
        x, P, moved = self._propagated(x, P, torque)
        outputs = self._corrected(x, P, moved, torque, readings)
        summary = "Estimate from a sample to the next one: prediction, then correction."
        return named("observer_update", summary, inputs, outputs)

    def _mass(self, x: Any) -> tuple[Any, Any]:
        """Return the mass of the payload, and the mass whose logarithm is a state, kg."""
        moving = self.scale * casadi.exp(x[-1])
        return casadi.fmax(moving - self.own, 0.0), moving

    def _sag(self, straight: Any) -> tuple[Any, Any]:
        """Return the coordinates at rest and their derivative by the payload mass."""
        nothing = casadi.DM.zeros(self.arm.dof)
        if not any(self.arm.spec.gravity):
            return straight, nothing
        bent, more = self._at_rest(straight, self.nominal), self.filter.payload_deviation
        if more == 0.0:
            return bent, nothing
        more *= SAG_DIFFERENCE
        return bent, (self._at_rest(straight, self.nominal + more) - bent) / more

    def _at_rest(self, q: Any, mass: float) -> Any:
        """Return the coordinates at rest with locked joints."""
        for _ in range(_NEWTON_STEPS if self.bending else 0):
            now = casadi.MX(q)
            force, stiffness = self.static(q, mass)
            now[self.bending] -= _solved(stiffness, force)
            q = now
        return q

    def _propagated(self, x: Any, P: Any, torque: Any) -> tuple[Any, Any, Any]:
        """Return mean, covariance, and its part with the torque error, after a sample time."""
        given, n, m = self.filter, self.arm.dof, self.arm.n_joints
        mass, moving = self._mass(x)
        values = {"q": x[:n], "qd": x[n : 2 * n], "torque": torque, "parameters": mass}
        columns = with_derivatives(values)
        symbols = {name: casadi.MX.sym(name, *one.shape) for name, one in columns.items()}
        others = {"step": self.filter.sample_time / self.steps, "tip_force": casadi.DM.zeros(3)}
        of_columns = dynamics_of_columns(self.model, tuple(columns))
        after = runge_kutta(of_columns, symbols | others)
        step = casadi.Function("substep", list(symbols.values()), list(after))
        q, qd, *constant = columns.values()
        for _ in range(self.steps):
            q, qd = step(q, qd, *constant)
        after = casadi.vertcat(q, qd)
        states, by_torque, by_mass = after[:, 1 : 2 * n + 1], after[:, 2 * n + 1 : -1], after[:, -1]
        last = casadi.horzcat(casadi.DM.zeros(1, 2 * n), 1.0)
        F = casadi.vertcat(casadi.horzcat(states, by_mass * moving), last)
        G = casadi.vertcat(self._noisy(by_torque), casadi.DM.zeros(1, m))
        link = Link(casadi.vertcat(after[:, 0], x[-1]), F, G)
        P = propagated(P, link)
        if given.payload_drift:
            wandered = given.payload_drift**2 * given.sample_time
            grown = casadi.log1p(wandered / moving**2)
            P = P + casadi.diag(casadi.vertcat(casadi.DM.zeros(2 * n), grown))
        return link.after, P, link.G

    def _noisy(self, by_torque: Any) -> Any:
        """Return derivatives by the torque times the deviation of its error."""
        noise = np.broadcast_to(np.asarray(self.filter.torque_noise), self.arm.n_joints)
        return by_torque * casadi.repmat(casadi.DM(noise).T, by_torque.shape[0], 1)

    def _corrected(self, x: Any, P: Any, moved: Any, torque: Any, readings: Any) -> dict[str, Any]:
        """Return the outputs of a sample."""

        def observe(x: Any) -> Readings:
            mass, moving = self._mass(x)
            values, by_state, by_mass, by_torque = self.predicted(x[:-1], torque, mass)
            return Readings(
                values, casadi.horzcat(by_state, by_mass * moving), self._noisy(by_torque)
            )

        constants = casadi.DM.eye(self.states), casadi.diag(casadi.DM(self.shown.variance))
        x, P, predicted, S = corrected(
            observe, readings, x, P, moved, *constants, linearisations(self.shown), _solved
        )
        missed = readings - predicted
        n, payload = self.arm.dof, self.scale * casadi.exp(x[-1] + 0.5 * P[-1, -1])
        return {
            "observer_memory_out": casadi.vertcat(x, casadi.vec(P.T)),
            "estimated_q": x[:n],
            "estimated_qd": x[n : 2 * n],
            "estimated_payload": casadi.fmax(payload - self.own, 0.0),
            "innovation": casadi.dot(missed, _solved(S, missed)) / self.shown.size,
        }

    def _predicted_readings(self) -> Any:
        """Return readings and their derivatives, a function of state, torque and payload mass."""
        n = self.arm.dof
        x, torque = casadi.SX.sym("x", 2 * n), casadi.SX.sym("torque", self.arm.n_joints)
        mass = casadi.SX.sym("mass")
        values = casadi.DM(self.shown.linear_rows) @ x
        if not self.shown.linear:
            calls = ParametricArm(self.arm, [_PAYLOAD], ()).at(list(objects([mass], casadi)))
            of_state = objects(casadi.vertsplit(x), casadi)
            of_torque = objects(casadi.vertsplit(torque), casadi)
            motions = calls.point_motions(
                of_state[:n], of_state[n:], of_torque, self.shown.stations
            )
            for place, row, sensor in zip(
                self.shown.places, motions, self.shown.sensors, strict=True
            ):
                values[place.tolist()] = casadi.vertcat(
                    *(plain(value) for value in row[sensor.columns])
                )
        slopes = [casadi.densify(casadi.jacobian(values, one)) for one in (x, mass, torque)]
        return casadi.Function("readings", [x, torque, mass], [casadi.densify(values), *slopes])


def _solved(A: Any, B: Any) -> Any:
    """Return the solution of a small symmetric positive definite system by Cholesky's method."""
    a, b = casadi.SX.sym("a", *A.shape), casadi.SX.sym("b", *B.shape)
    root = casadi.chol(a)
    solution = casadi.solve(root, casadi.solve(root.T, b))
    return casadi.Function("solved", [a, b], [casadi.densify(solution)])(A, B)
