"""`optimal_motion`: a motion of least time, energy or vibration within limits, and its errors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.bending import one_warning, warn_of_bending
from flexarm.base.arguments import check_choice, check_count, check_kind
from flexarm.base.errors import (
    AccuracyWarning,
    FlexarmError,
    InputError,
    LargeDeflectionWarning,
    Problem,
    check_array,
    public_call,
    warn_caller,
    without_warnings,
)
from flexarm.base.late import interpolate, xr
from flexarm.linear import equilibrium, modes
from flexarm.model.arm.spec import UNDRIVEN, serial_only
from flexarm.model.quantities import Count, Positive
from flexarm.motion import Motion
from flexarm.motion.dynamics.dynamics_along import MotionTorque
from flexarm.motion.geometry.inverse_kinematics import RigidChain, rigid_chain
from flexarm.motion.geometry.mechanism_path import quintic_table
from flexarm.motion.motion import JointState, TabulatedMotion, check_motion
from flexarm.planning.optimize import transcription
from flexarm.planning.optimize.task import (
    OBJECTIVES,
    UNITS,
    Bound,
    MotionLimits,
    Plan,
    Quantities,
    Task,
    task_of,
)
from flexarm.simulation.batch.reductions import Reduction, reduced
from flexarm.simulation.calls.result import make_result
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.derivatives.gradient import goal_gradient
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.tolerance import RTOL


@dataclass(frozen=True, eq=False)
class Remaining:
    """Errors of an optimal motion in the simulation of the full model, without feedback.

    Attributes:
        residual_vibration: largest distance of the tip from its mean after the end, m.
        tip_error: distance of that mean from the tip at rest, m.
        joint_error: largest distance of a joint from its last angle at the end, rad.
        excess: for each limit the largest excess of a value during the motion, in the unit of the
            limit; negative if all values are within it.
    """

    residual_vibration: float
    tip_error: float
    joint_error: float
    excess: dict[str, float]

    def __str__(self) -> str:
        lines = [
            f"residual vibration of the tip: {self.residual_vibration:.3g} m",
            f"mean tip after the end: {self.tip_error:.3g} m from its goal",
            f"joints at the end: within {self.joint_error:.3g} rad",
        ]
        for name, excess in self.excess.items():
            side = "exceeds its limit" if excess > 0.0 else "within its limit"
            lines.append(f"{name}: {side} by {abs(excess):.3g}{UNITS[name]}")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class OptimalTorque(MotionTorque):
    """Torque of an optimal motion, callable with the time; before and after, it holds the arm."""

    motion: OptimalMotion  # the motion
    history: PiecewiseCubic = field(repr=False)  # the torque as piecewise cubics

    def _at(self, times: FloatArray) -> FloatArray:
        duration = self.motion.duration
        return self.history.at(np.clip(times, -duration, 2.0 * duration))


@dataclass(frozen=True, eq=False)
class OptimalMotion(TabulatedMotion):
    """An optimal motion: joint angles over time with their torque, from rest to rest.

    It is a motion like those of `joint_motion`: a reference of controllers, and of `simulate`.

    Attributes:
        arm: the arm.
        objective: "time", "energy" or "vibration".
        duration: s.
        initial, final: (dof,) coordinates at rest before and after the motion.
        modes: number of the lowest vibrations that are at rest at the end.
        iterations: iterations of IPOPT.
        run: result of `simulate` for the full model under the torque, to some time after the end.
        remaining: what remains of vibration and of errors there, and the limits.
    """

    #: Entries of ``flexarm.citation``.
    references: ClassVar[str] = "Betts2010 WaechterBiegler2006 AnderssonEtAl2019"

    arm: Arm = field(repr=False)
    objective: str
    duration: float
    initial: FloatArray = field(repr=False)
    final: FloatArray = field(repr=False)
    modes: int
    iterations: int
    run: xr.Dataset = field(repr=False)
    remaining: Remaining = field(repr=False)
    _plan: Plan = field(repr=False)
    _history: PiecewiseCubic = field(repr=False)
    _table: interpolate.PPoly = field(repr=False)
    chain: RigidChain = field(repr=False)
    start_time: float = 0.0

    def __repr__(self) -> str:
        return (
            f"<flexarm.OptimalMotion: least {self.objective}, {self.duration:.4g} s, "
            f"{self.joints} joints, {self.intervals} intervals, residual vibration "
            f"{self.remaining.residual_vibration:.2g} m>"
        )

    @property
    def intervals(self) -> int:
        """Number of intervals of the collocation."""
        return self._plan.intervals

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times of the nodes, s."""
        return tuple(self._plan.times.tolist())

    @property
    def torque(self) -> OptimalTorque:
        """Torque of the motion, for ``simulate``: (joints,) N m as a function of time."""
        return OptimalTorque(self, self._history)


class OptimizationError(FlexarmError, RuntimeError):
    """No optimal motion was found.

    Attributes:
        reason: status of IPOPT, or the limit that the full model violates.
        hint: a sentence with a remedy.
        last: the last iterate, an ``xarray.Dataset`` over time; it is not a solution.
    """

    def __init__(self, reason: str, hint: str, last: xr.Dataset) -> None:
        super().__init__(reason, hint, last)
        self.reason = reason
        self.hint = hint
        self.last = last

    def __str__(self) -> str:
        return f"no optimal motion found: {self.reason}. {self.hint}"


def last_iterate(task: Task, plan: Plan) -> xr.Dataset:
    """Return coordinates, joint angles and torques at the nodes of a plan, as a dataset."""
    torque = np.concatenate([plan.torque[:, 0], plan.torque[-1:, 1]])
    joint = task.arm.joint_index
    channels = {
        "joint_angle": plan.q[:, joint],
        "joint_rate": plan.rate[:, joint],
        "torque": torque,
        "q": plan.q,
        "qd": plan.rate,
    }
    return make_result(task.arm, plan.times, channels, {"duration": plan.duration})


def tabulated(task: Task, plan: Plan) -> tuple[interpolate.PPoly, RigidChain]:
    """Return the joint angles of a plan as polynomials of degree 5, and the rigid chain."""
    # Accelerations at the nodes are those of the equations of motion.
    arm, joint = task.arm, task.arm.joint_index
    starts = plan.q[:-1], plan.rate[:-1], plan.torque[:, 0]
    ends = plan.q[1:], plan.rate[1:], plan.torque[:, 1]
    acceleration = np.array(
        [
            [arm.forward_dynamics(*state)[joint] for state in zip(*side, strict=True)]
            for side in (starts, ends)
        ]
    )
    angle, rate = plan.q[:, joint], plan.rate[:, joint]
    first = JointState(angle[:-1], rate[:-1], acceleration[0])
    last = JointState(angle[1:], rate[1:], acceleration[1])
    rests = np.array([task.start.q[joint], task.end.q[joint]])
    return quintic_table(plan.times, first, last, rests), rigid_chain(arm)


#: Simulated time after the end: periods of the slowest vibration with locked joints, and limits of
#: it as fractions of the duration.
_PERIODS, _SHORTEST_END, _LONGEST_END = 3.0, 0.2, 2.0
#: Samples per interval, and per period of the fastest vibration, at which the limits are checked.
_SAMPLES = 10


def simulated(task: Task, plant: Arm, plan: Plan) -> xr.Dataset:
    """Simulate the full model under the torque of a plan, and for some time after its end."""
    joint_angles = task.arm.joint_angles(task.start.q)
    hertz = modes(plant, task.arm.joint_angles(task.end.q), joints="locked").frequency_hz
    slowest = float(np.min(hertz[hertz > 0.0], initial=np.inf))
    after = float(
        np.clip(_PERIODS / slowest, _SHORTEST_END * plan.duration, _LONGEST_END * plan.duration)
    )
    periods = np.max(task.vibrations, initial=0.0) * plan.duration / (2.0 * np.pi)
    with without_warnings(LargeDeflectionWarning):  # once, for the last plan
        return simulate(
            plant,
            plan.duration + after,
            torque=plan.torque_history(task.start.torque, task.end.torque),
            initial=equilibrium(plant, joint_angles).q,
            rate=_SAMPLES * max(plan.intervals, int(np.ceil(periods))) / plan.duration,
            rtol=RTOL,
            progress=False,
        )


def excess_of(bound: Bound, run: xr.Dataset, duration: float) -> FloatArray:
    """Return the largest excess (k,) of a bound during the motion; negative within it."""
    moving = run.sel(time=slice(None, duration * (1.0 + 1e-9)))
    strain = moving.strain.values.T if "strain" in moving else np.zeros((0, moving.time.size))
    state = Quantities(
        moving.joint_angle.values.T, moving.joint_rate.values.T, strain, moving.tip.values.T
    )
    return bound.excess(np.array(bound.value(state)))


def remaining(task: Task, plant: Arm, plan: Plan, run: xr.Dataset) -> Remaining:
    """Return what remains of vibration and of errors in a run."""
    after = run.time.values >= plan.duration
    vibration = Reduction("residual", "tip", after=plan.duration)
    angles = task.arm.joint_angles(task.end.q)
    goal = plant.tip(equilibrium(plant, angles).q)[:2]
    at_end = run.joint_angle.values[after][0] - angles
    excess = {b.name: float(np.max(excess_of(b, run, plan.duration))) for b in task.bounds}
    if np.any(np.isfinite(task.torque)):
        excess["torque"] = float(np.max(np.abs(plan.torque).max(axis=(0, 1)) - task.torque))
    if task.continuous:
        rate = np.abs(np.diff(plan.torque, axis=1)).max(axis=(0, 1)) / np.diff(plan.times)[0]
        excess["torque_rate"] = float(np.max(rate - task.torque_rate))
    return Remaining(
        float(reduced(vibration, run.time.values, {"tip": run.tip.values})),
        float(np.hypot(*(run.tip.values[after].mean(axis=0) - goal))),
        float(np.abs(at_end).max()),
        excess,
    )


#: Phase (rad) of the fastest resting mode in one interval; the error of its phase is then 2e-4 rad
#: per interval.
_PHASE = 1.5
#: Numbers of intervals: the fewest and the most by default, and the most that can be given.
_FEWEST, _MOST, _MOST_GIVEN = 40, 160, 2000
#: Violation of constraints, relative to their sizes, up to which their limits are not the reason
#: of a failure.
_FEASIBLE = 1e-6
#: Intervals of the first solution.
_COARSE = 40
#: Solutions with narrower bounds until the full model is within its limits, growth of the margins,
#: and excess relative to a limit: aimed at, and accepted after the last solution.
_ROUNDS, _GROWTH, _AIM, _ACCEPTED = 6, 1.2, 1e-6, 1e-3
#: Distance of the tip from its goal, relative to the reach, that is reported.
_MISSED = 1e-3


@public_call
def optimal_motion(
    arm: Arm,
    start: ArrayLike,
    end: ArrayLike,
    objective: str = "time",
    limits: MotionLimits | None = None,
    *,
    duration: Positive | None = None,
    modes: int | None = None,
    guess: Motion | None = None,
    intervals: int | None = None,
    iterations: Count = 1000,
    plant: Arm | None = None,
) -> OptimalMotion:
    """Compute the optimal motion of a flexible arm between two postures, with its torque.

    The arm is at rest at both ends, also its links: a motion without residual vibration.

    Args:
        arm: the arm.
        start, end: (joints,) relative joint angles, rad. Links sag there under gravity.
        objective: "time" for the least duration; "energy" for the least integral of squared
            torques, to which the heat in motors is proportional; "vibration" for the least integral
            of squared rates of the links' modes during the motion.
        limits: limits of torques, rates, angles, strains, and of the tip; none by default. The
            objective "time" requires a limit of the torque.
        duration: s, for "energy" and "vibration".
        modes: number of the lowest vibrations, with free joints, that are at rest at the end
            besides the joints; all by default, and if the tip would miss its goal otherwise.
        guess: first guess: a motion of the joints, for example one around an obstacle. By default a
            straight motion, shaped for two modes.
        intervals: number of intervals of equal length, by default as many as the resting modes
            need, from 40 to 160. In each, the torque is constant, or linear if its rate has a
            limit.
        iterations: largest number of iterations of IPOPT.
        plant: arm that is simulated, if it differs from ``arm``: one with more modes.

    Returns:
        The motion, with its torque, the simulation of the full model, and what remains there.

    Raises:
        InputError: if CasADi is not installed, an argument has the wrong shape or value, a limit
            excludes the start or the end, or the duration is too short for the joint rates.
        EquilibriumError: if a posture has no equilibrium.
        OptimizationError: if IPOPT does not find a solution, for example because the limits are too
            narrow, or if the full model violates a limit by more than 0.1 %. The last iterate is
            its attribute ``last``.

    Warns:
        LargeDeflectionWarning: a link bends too far for the theory of the arm.

    Direct collocation at three Gauss points per interval, solved by IPOPT through CasADi. Limits
    hold at these points and at the nodes; the problem is solved again, with narrower limits, until
    they also hold in between, in the simulation. If modes are so fast that the intervals do not
    resolve them, the simulated arm would miss its goal: Newton's method then corrects the torques,
    within their limits. Solutions are local optima: another ``guess`` may lead to a better one.
    Contacts are not included.
    """
    plant = plant or arm
    serial_only(arm.spec, "an optimal motion", UNDRIVEN)
    check_choice("objective", objective, OBJECTIVES)
    limits = MotionLimits() if limits is None else check_kind("limits", limits, MotionLimits)
    begin, goal = (
        check_array(name, given, (arm.n_joints,))
        for name, given in (("start", start), ("end", end))
    )
    if plant.n_joints != arm.n_joints:
        rule = f"have the number of joints of the arm ({arm.n_joints})"
        raise InputError(Problem("plant", rule, str(plant.n_joints)))
    count = None if modes is None else check_count("modes", modes, 1, arm.dof - arm.n_joints)
    pieces = None if intervals is None else check_count("intervals", intervals, 2, _MOST_GIVEN)
    own = None if guess is None else check_motion(guess, arm)
    with one_warning():
        task = task_of(arm, begin, goal, objective, limits, duration, count)
        straight = transcription.straight_motion(task) if own is None else own
        pieces = pieces or _default_intervals(task, straight.duration)
        first = transcription.shaped_guess(task, straight) if own is None else own
        plan = transcription.plan_of(task, first, min(pieces, _COARSE))
        optimum = _within_limits(task, plan, plant, pieces, iterations)
    return optimum


def _default_intervals(task: Task, duration: float) -> int:
    """Return a number of intervals that resolves the resting modes, if it is not too large."""
    needed = np.ceil(task.vibrations[: task.modes] * duration / _PHASE)
    if not needed.size:
        return _FEWEST
    if needed[0] > _MOST_GIVEN:
        rule = "be so near that the arm vibrates less than 500 times on its way"
        raise InputError(Problem("end", rule, f"{needed[0] * _PHASE / (2.0 * np.pi):.3g} times"))
    return int(np.clip(needed[-1], _FEWEST, _MOST))


def _within_limits(
    task: Task, plan: Plan, plant: Arm, intervals: int, iterations: int
) -> OptimalMotion:
    """Solve with few intervals, then with all, until the full model is within its limits."""
    # The few intervals make the search fast, and find better optima than many.
    total = 0
    margins = [np.zeros(bound.lower.shape) for bound in task.bounds]
    slack = [task.slack(bound) for bound in task.bounds]
    for k in range(_ROUNDS):
        problem = transcription.Transcription(task, plan, margins, iterations, near=k > 0)
        answer = problem.solve()
        total += answer.iterations
        if not answer.converged:
            raise _not_converged(task, answer)
        plan = answer.plan
        if plan.intervals == intervals:
            if plant is task.arm:
                plan = _corrected(task, plan)
            run = simulated(task, plant, plan)
            if plant is task.arm and task.modes is not None and _misses(task, plan, run):
                plan = _corrected(replace(task, modes=None), plan)
                run = simulated(task, plant, plan)
            excess = [excess_of(bound, run, plan.duration) for bound in task.bounds]
            over = [np.max(e / b.size) for e, b in zip(excess, task.bounds, strict=True)]
            if max(over, default=0.0) <= _AIM:
                break
            wider = [m + _GROWTH * np.maximum(e, 0.0) for m, e in zip(margins, excess, strict=True)]
            # The start and the end, which may be on a bound, must remain within narrower ones.
            margins = [np.minimum(w, s) for w, s in zip(wider, slack, strict=True)]
        plan = plan.refined(intervals, task.continuous)
    for bound, most in zip(task.bounds, over, strict=True):
        if most > _ACCEPTED:
            reason = f"the full model exceeds the limit {bound.name!r} by {100.0 * most:.2g} %"
            hint = "Take more intervals, or a plant that differs less from the arm."
            raise OptimizationError(reason, hint, last_iterate(task, plan))
    warn_of_bending(task.arm, plan.q)
    rest = remaining(task, plant, plan, run)
    if plant is task.arm and _misses(task, plan, run):
        warn_caller(
            f"the tip comes to rest {rest.tip_error:.2g} m from its goal in the simulation: "
            f"{plan.intervals} intervals do not resolve the fastest modes. Limit the torque_rate, "
            "or take fewer modes of links; see OptimalMotion.remaining.",
            AccuracyWarning,
        )
    table, chain = tabulated(task, plan)
    return OptimalMotion(
        arm=task.arm,
        objective=task.objective,
        duration=plan.duration,
        initial=task.start.q,
        final=task.end.q,
        modes=len(task.elastic) if task.resting_modes() is None else task.modes or 0,
        iterations=total,
        run=run,
        remaining=rest,
        _plan=plan,
        _history=plan.torque_history(task.start.torque, task.end.torque),
        _table=table,
        chain=chain,
    )


def _misses(task: Task, plan: Plan, run: xr.Dataset) -> bool:
    """Return whether the tip comes to rest too far from its goal."""
    error = remaining(task, task.arm, plan, run).tip_error
    return error > _MISSED * task.arm.reach


def _not_converged(task: Task, answer: transcription.Answer) -> OptimizationError:
    """Return the error for an iterate that is not a solution."""
    reason = (
        f"IPOPT stopped with {answer.status} after {answer.iterations} iterations; the largest "
        f"violation of a constraint is {answer.violation:.2g} of its size"
    )
    if answer.status == "Maximum_Iterations_Exceeded":
        hint = "Increase iterations, or give a guess that is nearer to the solution."
    elif answer.violation < _FEASIBLE:
        hint = "Fast vibrations may prevent accurate steps: reduce the modes of links (Link.modes)."
    elif task.duration is not None:
        hint = "The duration may be too short: objective='time' finds the shortest one."
    else:
        hint = "The limits may exclude every motion; a guess around obstacles helps."
    return OptimizationError(reason, hint, last_iterate(task, answer.plan))


#: Errors at the end, relative to the motion, below which nothing is corrected, and that end the
#: correction.
_CLOSE, _ENOUGH = 1e-4, 1e-8
#: Most steps of Newton's method, and the shortest part of one.
_STEPS, _SHORTEST = 12, 0.05
#: Samples of the simulation per interval.


def _corrected(task: Task, plan: Plan) -> Plan:
    """Return a plan that ends at rest in the simulation; the same one if there is none."""
    # Modes that vibrate faster than the intervals resolve have other phases in the simulation than
    # in the collocation, and joints without inertia of their own follow these modes. Newton's
    # method on the simulation finds the least change of the torques after which the arm is at rest:
    # its Jacobian is that of the steps of the integrator, `goal_gradient`.
    try:
        with without_warnings(LargeDeflectionWarning):  # only the last run matters
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
        torques = self._given.torque  # of the nodes if they are continuous, else of the intervals
        torque = torques[:, 0].copy()
        if self._task.continuous:
            torque = np.vstack([torque, torques[-1:, 1]])
        run, error = self._simulated(torque)
        if np.abs(error).max() < _CLOSE:
            return self._given
        for _ in range(_STEPS):
            change = self._change(torque, error)
            if change is None:
                return self._given
            part, size = 1.0, np.linalg.norm(error)
            while np.linalg.norm((new := self._simulated(torque + part * change))[1]) > size:
                part *= 0.5
                if part < _SHORTEST:
                    return self._given
            torque, (run, error) = torque + part * change, new
            if np.abs(error).max() < _ENOUGH:
                break
        if np.abs(error).max() > _CLOSE:
            return self._given
        q, slope, curve = transcription.states_of(
            run, 0.0, self._given.duration, self._given.intervals
        )
        return replace(self._given, q=q, slope=slope, curve=curve, torque=self._pieces(torque))

    def _pieces(self, torque: FloatArray) -> FloatArray:
        pair = (torque[:-1], torque[1:]) if self._task.continuous else (torque, torque)
        return np.stack(pair, axis=1)

    @property
    def _options(self) -> dict[str, Any]:
        interpolation = "linear" if self._task.continuous else "hold"
        start = self._task.start.q
        return {"torque_interpolation": interpolation, "initial": start, "progress": False}

    def _simulated(self, torque: FloatArray) -> tuple[xr.Dataset, FloatArray]:
        """Return a run, and amplitudes (2 m,) at its end that should be zero, relative to it."""
        plan = self._given
        history = replace(plan, torque=self._pieces(torque)).torque_history(torque[0], torque[-1])
        run = simulate(
            self._task.arm,
            plan.duration,
            torque=history,
            initial=self._task.start.q,
            rate=_SAMPLES * plan.intervals / plan.duration,
            rtol=RTOL,
            progress=False,
        )
        last = np.concatenate([run.q.values[-1], run.qd.values[-1]])
        return run, self._rows @ (last - self._goal)

    def _change(self, torque: FloatArray, error: FloatArray) -> FloatArray | None:
        """Return the least change of the torques within limits that removes a linear error."""
        import casadi

        plan, dof = self._given, self._task.arm.dof
        gradients = []
        for row in self._rows:
            weights = {name: np.zeros((plan.intervals + 1, dof)) for name in ("q", "qd")}
            weights["q"][-1], weights["qd"][-1] = row[:dof], row[dof:]
            rate = plan.intervals / plan.duration
            arguments = {"torque": torque, "rate": rate, "error_estimate": False, **self._options}
            gradient = goal_gradient(self._task.arm, plan.duration, weights, **arguments)
            gradients.append(gradient.torque.values.ravel())
        task, J = self._task, np.array(gradients)
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
