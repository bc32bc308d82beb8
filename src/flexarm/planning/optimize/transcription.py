"""Direct collocation: the problem of an optimal motion as a nonlinear program of CasADi.

The equations of motion hold at the three Gauss points of every interval, in the implicit form
M qdd + bias - torque = 0. Unknown are the accelerations there; coordinates and rates follow from
those at the nodes by the Runge-Kutta matrix of the method. All unknowns are divided by their size
in the first guess.

Reference: J. T. Betts, Practical Methods for Optimal Control and Estimation Using Nonlinear
    Programming, 2nd edition, SIAM 2010, chapter 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import LargeDeflectionWarning, without_warnings
from flexarm.base.late import interpolate, xr
from flexarm.bridges.symbolic.models import casadi_model
from flexarm.control.design.input_shaping import shaped
from flexarm.motion import Motion, joint_motion, rigid_torque
from flexarm.planning.optimize.task import GAUSS, STAGES, Plan, Quantities, Task
from flexarm.simulation.calls.run import simulate

#: Weight of the mean squared torque, relative to its limits or the guess, in the other objectives:
#: torques that do not matter become small and smooth.
_SMOOTHING = {"time": 1e-4, "vibration": 1e-3, "energy": 0.0}
#: Phase (rad) of the fastest vibration in one interval above which it is not resolved, and the
#: weight of the mean squared rates of the modes, relative to those of the guess, in the objective
#: then. Otherwise the solution would shake the arm with vibrations whose phases are wrong.
_UNRESOLVED, _QUIET = 3.0, {"time": 0.0, "vibration": 0.0, "energy": 1e-2}
#: Least size of an unknown, relative to the largest of its kind.
_LEAST_SIZE = 1e-3
#: Range of a free duration, relative to that of the guess.
_SHORTEST, _LONGEST = 0.01, 10.0
#: Options of IPOPT for a guess near a solution: a small barrier parameter and small distances from
#: bounds, so that the first iterates do not leave it.
_NEAR = {"mu_init": 1e-4, "bound_push": 1e-6, "bound_frac": 1e-6}
#: Relative tolerance of IPOPT.
_TOLERANCE = 1e-7


class Answer(NamedTuple):
    """Answer of the solver."""

    plan: Plan  # the last iterate
    status: str  # return status of IPOPT
    converged: bool  # whether it is a solution
    iterations: int  # their number
    violation: float  # largest violated constraint, relative to its size


class _Sizes(NamedTuple):
    """Sizes of unknowns and residuals, for each coordinate or joint; arrays or CasADi matrices."""

    q: Any
    slope: Any
    curve: Any
    torque: Any
    residual: Any


class Transcription:
    """The nonlinear program of one problem, with intervals and sizes of the first guess.

    If the guess is ``near`` a solution, the solver stays near it. All bounds are narrower by
    ``margins`` (k,).
    """

    def __init__(
        self, task: Task, guess: Plan, margins: Sequence[FloatArray], iterations: int, near: bool
    ) -> None:
        self.model = casadi_model(task.arm)
        import casadi

        self.casadi: Any = casadi
        self.task, self.intervals, self.modes = task, guess.intervals, task.resting_modes()
        self.duration = guess.duration if task.duration is None else task.duration
        phase = np.max(task.vibrations, initial=0.0) * self.duration / guess.intervals
        self.quiet = _QUIET[task.objective] if phase > _UNRESOLVED else 0.0
        self.sizes = _sizes(task, guess)
        self.scale = _Sizes._make(map(casadi.DM, self.sizes))
        self.guess, self.margins = self._scaled(guess), margins
        self.ipopt = {"max_iter": iterations, **(_NEAR if near else {})}

    def solve(self) -> Answer:
        """Solve from the guess."""
        casadi, guess = self.casadi, self.guess
        unknowns = {name: casadi.MX.sym(name, *value.shape) for name, value in guess.items()}
        goal, constraints = self._program(**unknowns)
        rows, *sides = zip(*constraints, strict=True)
        lower, upper = (
            np.concatenate([np.resize(s, row.numel()) for s, row in zip(side, rows, strict=True)])
            for side in sides
        )
        x = casadi.veccat(*unknowns.values())
        quiet = {"print_level": 0, "sb": "yes", "tol": _TOLERANCE}
        options = {"print_time": False, "ipopt": {**quiet, **self.ipopt}}
        program = {"x": x, "f": goal, "g": casadi.veccat(*rows)}
        solver = casadi.nlpsol("optimal_motion", "ipopt", program, options)
        ends = self._unknown_bounds()
        given = (casadi.veccat(*map(casadi.DM, part.values())) for part in (guess, *ends))
        at = dict(zip(("x0", "lbx", "ubx"), given, strict=True))
        optimum = solver(**at, lbg=lower, ubg=upper)
        g, stats = np.array(optimum["g"]).ravel(), solver.stats()
        violation = float(np.max(np.maximum(lower - g, g - upper), initial=0.0))
        status = str(stats["return_status"])
        converged = status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
        parts = casadi.Function("parts", [x], [*unknowns.values()])(optimum["x"])
        plan = self._plan(*(np.array(part).T for part in parts))
        return Answer(plan, status, converged, int(stats["iter_count"]), violation)

    def _program(
        self, T: Any, q: Any, slope: Any, curve: Any, torque: Any
    ) -> tuple[Any, list[tuple[Any, Any, Any]]]:
        """Return the objective and the constraints of the scaled unknowns, with their bounds."""
        task, N, repmat = self.task, self.intervals, self.casadi.repmat
        first, last = (torque[:, :-1], torque[:, 1:]) if task.continuous else (torque, torque)
        residual, q_end, slope_end, bounded, cost = self._interval().map(N)(
            q[:, :-1], slope[:, :-1], curve, first, last, repmat(T, 1, N)
        )
        gaps = q[:, 1:] - q_end, slope[:, 1:] - slope_end
        rows: list[tuple[Any, Any, Any]] = [(part, 0.0, 0.0) for part in (residual, *gaps)]
        pairs = zip(task.bounds, self.margins, strict=True)
        sides = zip(*([s / b.size for s in b.within(margin)] for b, margin in pairs), strict=True)
        low, high = (np.concatenate(side) for side in sides) if task.bounds else ((), ())
        rows.append((bounded, low, high))
        if task.continuous:
            step = torque[:, 1:] - torque[:, :-1]
            limited = np.flatnonzero(np.isfinite(task.torque_rate)).tolist()
            most = (task.torque_rate / self.sizes.torque)[limited] * self.duration / N
            allowed = repmat(self.casadi.DM(most) * T, 1, N)
            rows += [(side * step[limited, :] - allowed, -np.inf, 0.0) for side in (1.0, -1.0)]
        if self.modes is not None:
            away = self.scale.q * q[:, -1] - self.casadi.DM(task.end.q)
            rate = self.scale.slope * slope[:, -1]
            rows.append((self._scaled_modes(self.sizes.q) @ away, 0.0, 0.0))
            rows.append((self._scaled_modes(self.sizes.slope) @ rate, 0.0, 0.0))
        total = self.casadi.sum2(cost)
        return T + total if task.objective == "time" else total, rows

    def _interval(self) -> Any:
        """Return the function of one interval, over scaled unknowns."""
        sx, arm, N, scale = self.casadi.SX, self.task.arm, self.intervals, self.scale
        n, joints = arm.dof, arm.n_joints
        shapes = [(n, 1), (n, 1), (n, STAGES), (joints, 1), (joints, 1), (1, 1)]
        names = ["q", "slope", "curve", "first", "last", "T"]
        given = [sx.sym(name, *shape) for name, shape in zip(names, shapes, strict=True)]
        q, slope = scale.q * given[0], scale.slope * given[1]
        curve = self.casadi.repmat(scale.curve, 1, STAGES) * given[2]
        first, last = scale.torque * given[3], scale.torque * given[4]
        T, h = self.duration * given[5], 1.0 / N
        residual, limited, cost = [], [], 0.0
        for j, c in enumerate(GAUSS.c):
            at = q + c * h * slope + h * h * (curve @ self.casadi.DM(GAUSS.AA[j]))
            rate = (slope + h * (curve @ self.casadi.DM(GAUSS.A[j]))) / T
            torque = first + c * (last - first)
            motion = (at, rate, curve[:, j] / T**2, torque, 0, self.model.nominal)
            residual.append(self.model.residual(*motion) / scale.residual)
            limited.append(self._limited(at, rate))
            cost += h * GAUSS.b[j] * self._cost(rate, torque)
        q_end = q + h * slope + h * h * (curve @ self.casadi.DM(GAUSS.bA))
        slope_end = slope + h * (curve @ self.casadi.DM(GAUSS.b))
        limited.append(self._limited(q_end, slope_end / T))
        vertcat = self.casadi.vertcat
        ends = q_end / scale.q, slope_end / scale.slope
        results = [vertcat(*residual), *ends, vertcat(*limited), cost]
        return self.casadi.Function("interval", given, results)

    def _limited(self, q: Any, rate: Any) -> Any:
        """Return the quantities of all bounds, divided by their sizes."""
        index = self.task.arm.joint_index.tolist()
        nominal = self.model.nominal
        tip = self.model.tip(q, nominal)
        state = Quantities(q[index], rate[index], self.model.strain(q, nominal), tip)
        found = []
        for bound in self.task.bounds:
            value = bound.value(state)
            column = self.casadi.vertcat(*value) if isinstance(value, list) else value
            found.append(column / self.casadi.DM(bound.size))
        return self.casadi.vertcat(*found)

    def _cost(self, rate: Any, torque: Any) -> Any:
        """Return the integrand of the objective over the fraction s of the duration."""
        effort = self.casadi.sumsqr(torque) / float(np.sum(self.sizes.torque**2))
        smooth = _SMOOTHING[self.task.objective] * effort
        elastic = self.task.elastic.tolist()
        if not elastic:
            return effort if self.task.objective == "energy" else smooth
        usual = float(np.sum((self.sizes.slope[elastic] / self.duration) ** 2))
        shaking = self.casadi.sumsqr(rate[elastic]) / usual
        if self.task.objective == "vibration":
            return shaking + smooth
        return (effort if self.task.objective == "energy" else smooth) + self.quiet * shaking

    def _unknown_bounds(self) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return the bounds of the unknowns: rest at both ends, torques, and the duration."""
        lower = {name: np.full(value.shape, -np.inf) for name, value in self.guess.items()}
        upper = {name: np.full(value.shape, np.inf) for name, value in self.guess.items()}
        task, sizes = self.task, self.sizes
        free = task.duration is None
        lower["T"][:], upper["T"][:] = (_SHORTEST, _LONGEST) if free else (1.0, 1.0)
        most = (task.torque / sizes.torque)[:, None]
        lower["torque"][:], upper["torque"][:] = -most, most
        last = np.arange(task.arm.dof) if self.modes is None else task.arm.joint_index
        for part in (lower, upper):
            part["q"][:, 0], part["slope"][:, 0] = task.start.q / sizes.q, 0.0
            part["q"][last, -1], part["slope"][last, -1] = (task.end.q / sizes.q)[last], 0.0
            if task.continuous:
                part["torque"][:, 0] = task.start.torque / sizes.torque
                part["torque"][:, -1] = task.end.torque / sizes.torque
        return lower, upper

    def _scaled_modes(self, sizes: FloatArray) -> Any:
        """Return the rows of the resting modes, divided by their size for such coordinates."""
        assert self.modes is not None
        return self.casadi.DM(self.modes / np.linalg.norm(self.modes * sizes, axis=1)[:, None])

    def _scaled(self, plan: Plan) -> dict[str, FloatArray]:
        """Return the unknowns of a plan, a column for each node, stage or interval."""
        s, torque = self.sizes, plan.torque[:, 0]
        if self.task.continuous:
            torque = np.vstack([torque, plan.torque[-1:, 1]])
        torque = np.clip(torque, -self.task.torque, self.task.torque)
        curve = plan.curve.reshape(-1, plan.curve.shape[-1])
        rows = {"T": np.array([[plan.duration / self.duration]]), "q": plan.q / s.q}
        rows |= {"slope": plan.slope / s.slope, "curve": curve / s.curve}
        return {name: part.T for name, part in (rows | {"torque": torque / s.torque}).items()}

    def _plan(
        self, T: FloatArray, q: FloatArray, slope: FloatArray, curve: FloatArray, torque: FloatArray
    ) -> Plan:
        """Return the plan of the unknowns, a row for each node, stage or interval."""
        s, task = self.sizes, self.task
        torque = np.clip(torque * s.torque, -task.torque, task.torque)
        first, last = (torque[:-1], torque[1:]) if task.continuous else (torque, torque)
        return Plan(
            duration=float(T[0, 0]) * self.duration,
            q=q * s.q,
            slope=slope * s.slope,
            curve=(curve * s.curve).reshape(self.intervals, STAGES, -1),
            torque=np.stack([first, last], axis=1),
        )


def _sizes(task: Task, guess: Plan) -> _Sizes:
    """Return the sizes of the unknowns in a guess."""
    kinds = task.arm.joint_index, task.elastic
    found = [_size(values, kinds) for values in (guess.q, guess.slope, guess.curve)]
    largest = np.abs(guess.torque).max(axis=(0, 1))
    M = np.abs(task.arm.mass_matrix(task.start.q))
    least = _LEAST_SIZE * np.diag(M)[task.arm.joint_index] / guess.duration**2
    torque = np.where(np.isfinite(task.torque), task.torque, np.maximum(largest, least))
    residual = M @ found[2] / guess.duration**2
    q, slope, curve = found
    return _Sizes(q, slope, curve, torque, residual)


def _size(values: FloatArray, kinds: tuple[Any, Any]) -> FloatArray:
    """Return the largest magnitudes (dof,) of coordinates, of joints and of links apart."""
    largest = np.abs(values).reshape(-1, values.shape[-1]).max(axis=0)
    for kind in kinds:
        if len(kind):
            most = float(largest[kind].max()) or 1.0
            largest[kind] = np.maximum(largest[kind], _LEAST_SIZE * most)
    return np.asarray(largest)


#: Fraction of the limits of torques and rates that the guess uses.
_USED = 0.9
#: Modes for which it is shaped, and the least part of the duration that is left for the motion.
_SHAPED, _LEAST = 2, 0.4
#: Factors of the search for a duration, and its largest number of steps.
_LONGER, _SHORTER, _STEPS = 1.4, 0.9, 80
#: Samples of the motion per interval of the plan.
_SAMPLES = 20


def straight_motion(task: Task) -> Motion:
    """Return a smooth motion of the joints that nearly keeps limits of torques and joint rates."""
    return _quintic(task, _shortest(task) if task.duration is None else task.duration)


def shaped_guess(task: Task, straight: Motion) -> Motion:
    """Return the straight motion, shaped; if the duration is given, after making it shorter."""
    longer = _shaped(task, straight)
    if task.duration is None:
        return longer
    left = 2.0 * straight.duration - longer.duration
    return _shaped(task, _quintic(task, left)) if left > _LEAST * task.duration else straight


def _quintic(task: Task, duration: float) -> Motion:
    start, end = (task.arm.joint_angles(rest.q) for rest in (task.start, task.end))
    return joint_motion(task.arm, start, end, duration)


def _shaped(task: Task, motion: Motion) -> Motion:
    count = min(len(task.elastic), _SHAPED)
    return shaped(motion, task.arm, "zv", modes=count) if count else motion


def _shortest(task: Task) -> float:
    """Return a duration for which the torques of the rigid arm are nearly within their limits."""
    most = [b.upper for b in task.bounds if b.name == "joint_rate"]

    def within(duration: float) -> bool:
        motion = _quintic(task, duration)
        times = np.linspace(0.0, duration, 50)
        torque = np.abs(rigid_torque(task.arm, motion)(times))
        rate = np.abs(motion.joint_rate(times))
        fast = any(np.any(rate > _USED * limit) for limit in most)
        return not fast and not np.any(torque > _USED * task.torque)

    duration = 1.0
    for _ in range(_STEPS):
        if within(duration):
            break
        duration *= _LONGER
    for _ in range(_STEPS):
        if not within(_SHORTER * duration):
            break
        duration *= _SHORTER
    return duration


def plan_of(task: Task, motion: Motion, intervals: int) -> Plan:
    """Return the plan in which the motors follow a motion, by a simulation of the arm."""
    arm, begin, duration = task.arm, motion.start_time, motion.duration
    start = task.start.q.copy()
    start[arm.joint_index] = motion.joint_angle(0.0)
    with without_warnings(LargeDeflectionWarning):  # only the result matters
        run = simulate(
            arm,
            motion.end_time,
            prescribed={int(number): motion for number in arm.joint_numbers},
            initial=start,
            rate=_SAMPLES * intervals / duration,
            progress=False,
        )
    times = run.time.values
    torque = interpolate.CubicSpline(times, run.torque.values)
    at_nodes = torque(begin + duration * np.linspace(0.0, 1.0, intervals + 1))
    ends = np.stack([at_nodes[:-1], at_nodes[1:]], axis=1)
    if not task.continuous:
        ends[:] = ends.mean(axis=1, keepdims=True)
    return Plan(duration, *states_of(run, begin, duration, intervals), ends)


def states_of(
    run: xr.Dataset, begin: float, duration: float, intervals: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return q, dq/ds at the nodes and d2q/ds2 at the stages of a plan, from a simulation."""
    times = run.time.values
    state = interpolate.CubicHermiteSpline(times, run.q.values, run.qd.values)
    rate = interpolate.CubicSpline(times, run.qd.values)
    nodes = begin + duration * np.linspace(0.0, 1.0, intervals + 1)
    stages = (nodes[:-1, None] + duration / intervals * GAUSS.c).ravel()
    curve = rate(stages, 1).reshape(intervals, len(GAUSS.c), -1)
    return state(nodes), duration * rate(nodes), duration**2 * curve
