"""Stable, non-causal inversion: torques that make the tip of a flexible arm follow a path.

Theory page "separation", sections 4 and 5. The torques begin before the tip moves and end after it
has stopped, because the links must be bent when the tip starts and unbent after it has come to
rest.

References:
    E. Bayo, J. Robotic Systems 4 (1987) 63-75: one link, in the frequency domain.
    S. Devasia, D. Chen and B. Paden, IEEE Trans. Automatic Control 41 (1996) 930-942.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.bending import warn_of_bending
from flexarm.base.arguments import check_positive
from flexarm.base.errors import (
    FlexarmError,
    InputError,
    LargeDeflectionWarning,
    Problem,
    SimulationError,
    public_call,
    shown,
    without_warnings,
)
from flexarm.base.late import interpolate, linalg
from flexarm.linear import modes
from flexarm.linear.small_deviations.along import stage_times, torque_response
from flexarm.model.quantities import Positive
from flexarm.motion import JointState, Motion, rigid_torque
from flexarm.motion.dynamics.dynamics_along import TipConstraint, dynamics_along
from flexarm.motion.geometry.inverse_kinematics import RigidChain
from flexarm.motion.motion import check_motion
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.inversion.torques import (
    DEGREE,
    CorrectedTorque,
    JointSupport,
    RestEnd,
    SupportedTorque,
    free_coefficients,
    joint_supports,
    rest_end,
    spline_knots,
    spline_values,
)
from flexarm.simulation.run.settings import RunSettings, close, relative_tolerance, replaced

#: Samples per knot of the torque's spline; a spline of order 6 through them is exact to 1e-6.
_PER_KNOT = 8.0
#: Coefficients of u^3, u^4 and u^5 in the quintic law that ends the motion of the joints at rest.
_EASE = (10.0, -15.0, 6.0)
#: Bending that remains at the start of the torques, as a fraction of that at the motion's start.
_LEFT = 1e-6
#: Longest time before and after a motion, as a multiple of its duration.
_LONGEST = 5.0
_LONGEST_GIVEN = 100.0
#: Knots of the torque and samples of the tip per period of the slowest vibration.
_KNOTS, _SAMPLES = 12.0, 64.0
#: Levenberg-Marquardt damping, as a fraction of the tip's response to all coefficients together. It
#: decreases to the minimum after each successful step and increases after each failed one.
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-5, 1e-7, 0.1
#: The reduction is relative to the tip error under rigid torques, or to this fraction of the length
#: of the arm if that is smaller.
_MOST_RIGID = 0.05
_STEPS = 12
#: Part of that error below which an inversion is worth its torques.
_USEFUL = 0.2
#: Knots of the unsupported torque per knot of the original one, and samples per knot.
_FINER, _PER_FINER = 4, 4
#: Relative tolerance of the runs that determine the unsupported torque.
_CLOSE = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class InversionReference(Motion):
    """Joint angles of a flexible arm whose tip follows a motion.

    As a reference for feedback, the joint angles include the effect of bending on the *tip*. The
    reference begins before the motion and ends after it, as the torques do.

    Attributes:
        motion: of the rigid model; the tip follows it.
        torque: function of time: (joints,) N m, consistent with the joint angles.
        initial: (dof,) initial coordinates.
    """

    motion: Motion
    torque: CorrectedTorque
    initial: FloatArray
    start_time: float
    duration: float
    _coordinates: interpolate.BSpline = field(repr=False)
    _joints: NDArray[np.intp] = field(repr=False)
    chain: RigidChain = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "chain", self.motion.chain)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Start and end, and the breaks of the motion in between, s."""
        inner = (t for t in self.motion.breaks if self.start_time < t < self.end_time)
        return (self.start_time, *inner, self.end_time)

    def tip(self, t: ArrayLike) -> FloatArray:
        """Return the reference position of the tip (2,) or (T, 2), world axes, m."""
        return self.motion.tip(t)

    def at(self, times: FloatArray) -> JointState:
        return JointState(*(part[:, self._joints] for part in self.coordinates(times)))

    def coordinates(self, times: FloatArray) -> list[FloatArray]:
        """Return q, qd and qdd of the bent arm, (T, dof) each, at times (T,)."""
        inside = np.clip(times, self.start_time, self.end_time)
        moving = ((times >= self.start_time) & (times < self.end_time))[:, None]
        rate, acceleration = (self._coordinates(inside, nu) * moving for nu in (1, 2))
        return [self._coordinates(inside), rate, acceleration]


def inversion_reference(
    arm: Arm,
    torque: CorrectedTorque,
    ends: tuple[float, float],
    initial: FloatArray,
    final: FloatArray,
    supported: SupportedTorque | None = None,
) -> InversionReference:
    """Simulate an arm under the torques of an inversion and return its joint angles."""
    start, end = ends
    if supported is not None:
        arm = supported.support.arm
    spacing = float(np.max(np.diff(torque.knots)))
    count = int(np.ceil(_PER_KNOT * (end - start) / spacing))
    rate = count / (end - start)
    with without_warnings(LargeDeflectionWarning):  # the user's run warns
        result = simulate(
            arm,
            end - start,
            torque=_Later(supported or torque, start),
            initial=initial,
            rate=rate,
            rtol=1e-9,
            progress=False,
        )
    times, angles = result.time.values, result.joint_angle.values
    after = torque.motion.end_time - start
    u = np.clip((times - after) / (times[-1] - after), 0.0, 1.0)
    ease = u**3 * (_EASE[0] + u * (_EASE[1] + u * _EASE[2]))
    q = np.array(result.q.values)
    q[:, arm.joint_index] += np.outer(ease, arm.joint_angles(final) - angles[-1])
    still = [(1, np.zeros(arm.dof)), (2, np.zeros(arm.dof))]
    spline = interpolate.make_interp_spline(times + start, q, k=5, bc_type=(still, still))
    span, joints = end - start, arm.joint_index
    return InversionReference(torque.motion, torque, initial, start, span, spline, joints)


@dataclass(frozen=True)
class _Later:
    """Torque with a shifted time axis."""

    torque: CorrectedTorque | SupportedTorque
    start: float
    vectorized: bool = True

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(t - self.start for t in self.torque.breaks)

    def __call__(self, t: ArrayLike) -> FloatArray:
        return self.torque(np.asarray(t) + self.start)


class InversionError(FlexarmError, RuntimeError):
    """No torque was found that keeps the tip on its path.

    Attributes:
        tip_error: largest distance of the tip from the path in the best run, m.
    """

    def __init__(self, tip_error: float, reason: str) -> None:
        super().__init__(tip_error, reason)
        self.tip_error = tip_error
        self.reason = reason

    def __str__(self) -> str:
        return f"the tip comes within {self.tip_error:.3g} m of its path, not closer: {self.reason}"


@dataclass(frozen=True, eq=False)
class TipInversion:
    """Torques that make the tip of a flexible arm follow a path, with errors of the result.

    Attributes:
        torque: function of time: (joints,) N m, for ``simulate``.
        start, end: interval in which the torques differ from those of the arm at rest, s.
        initial, final: (dof,) coordinates at rest before ``start`` and after ``end``.
        pre_actuation, post_actuation: duration of the torques before and after the motion, s.
        tip_error: largest distance of the tip from the path in the last run, m. Under gravity that
            run has feedback of the joints, as in ``simulate`` with a controller on ``reference``.
        rigid_tip_error: the same under rigid torques.
        open_loop_tip_error: the same under ``torque`` alone, m; infinite if the arm falls. Without
            gravity it is ``tip_error``.
        zeros: eigenvalues of the links' motion with the tip constrained to its start, 1/s: those
            in the right half-plane make the arm non-minimum phase.
    """

    arm: Arm
    motion: Motion
    torque: CorrectedTorque
    start: float
    end: float
    initial: FloatArray
    final: FloatArray
    tip_error: float
    rigid_tip_error: float
    zeros: NDArray[np.complex128]
    open_loop_tip_error: float
    _supported: SupportedTorque | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        return (
            f"<flexarm.TipInversion: {self.torque.joints} torques from {self.start:.4g} to "
            f"{self.end:.4g} s, tip within {self.tip_error:.2g} m of its path "
            f"({self.rigid_tip_error:.2g} m under rigid torques)>"
        )

    @cached_property
    def reference(self) -> InversionReference:
        """Joint angles for these torques: the reference of an additional feedback."""
        ends = self.start, self.end
        states = self.initial, self.final
        return inversion_reference(self.arm, self.torque, ends, *states, self._supported)

    @property
    def pre_actuation(self) -> float:
        """Duration of the torques before the tip moves, s."""
        return self.motion.start_time - self.start

    @property
    def post_actuation(self) -> float:
        """Duration of the torques after the tip has stopped, s."""
        return self.end - self.motion.end_time


@public_call
def tip_inversion(
    arm: Arm,
    motion: Motion,
    *,
    pre_actuation: float | None = None,
    post_actuation: float | None = None,
    reduction: Positive = 2e-3,
    settings: RunSettings | None = None,
) -> TipInversion:
    """Compute the torques that make the tip of a flexible arm follow the tip of the rigid model.

    Args:
        arm: the arm, with flexible links.
        motion: rest to rest, of the rigid model. Its start time must be at least
            ``pre_actuation``. Arms with three or more joints are redundant: all joints except the
            two that move the tip best also follow the motion. The tip of a single link follows
            the direction of the rigid link.
        pre_actuation, post_actuation: s; by default until 1e-6 of the bending remains.
        reduction: target of the tip's largest error, as a fraction of that under rigid torques, or
            of a twentieth of the arm's length if the arm falls under those.
        settings: method and accuracy of the runs, see ``RunSettings``.

    Raises:
        InputError: if the motion starts too early or the joints cannot control the tip, or an
            argument has the wrong value.
        InversionError: if the error cannot be reduced to a hundredth, or to ``reduction`` if that
            is larger.

    Levenberg-Marquardt on the full nonlinear model: each step calls ``simulate`` and corrects the
    entire torque history by the response of the arm along that run; (D.12) to (D.14). Under gravity
    the runs have feedback of the joints, which the returned torque includes; of an arm with elastic
    joints, only if it falls without.
    """
    motion = check_motion(motion, arm)
    settings = close(settings)
    if arm.dof == arm.n_joints:
        raise InputError(Problem("arm", "is rigid", hint="Use fa.rigid_torque(arm, motion)."))
    constraint = TipConstraint(arm, motion)
    constraint.check()
    first, last = rest_end(constraint, motion.start_time), rest_end(constraint, motion.end_time)
    before = _span("pre_actuation", pre_actuation, first.growth, motion.duration)
    after = _span("post_actuation", post_actuation, last.decay, motion.duration)
    if motion.start_time < before:
        rule = f"start at {before:.6g} s or later, after the pre-actuation"
        hint = "Set start_time of the motion, or a shorter pre_actuation."
        raise InputError(Problem("motion", rule, f"{motion.start_time:.6g} s", hint))
    start, end = motion.start_time - before, motion.end_time + after
    failures: list[FlexarmError] = []
    for support in joint_supports(arm, motion, (first, last), start, end):
        search = _Search(constraint, first, last, start, end, support, settings)
        try:
            found, rigid = search.run(reduction)
        except SimulationError as error:  # the arm falls
            failures.append(error)
            continue
        if found.tip <= max(reduction, 1e-2) * search.yardstick(rigid.tip):
            break
        reason = f"under rigid torques it is within {rigid.tip:.3g} m."
        share = found.tip / search.yardstick(rigid.tip)
        if share < _USEFUL:  # as with dry friction, which is not smooth
            reason += f" With reduction={1.05 * share:.2g} this is accepted."
        failures.append(InversionError(found.tip, reason))
    else:
        raise failures[-1]
    warn_of_bending(arm, found.q)
    ends, errors = (first.q, last.q), (found.tip, rigid.tip)
    zeros = np.asarray(first.zeros)
    if support is None:
        return TipInversion(arm, motion, found.torque, start, end, *ends, *errors, zeros, found.tip)
    supported = SupportedTorque(support, found.torque)
    torque, alone = search.without_support(supported)
    return TipInversion(arm, motion, torque, start, end, *ends, *errors, zeros, alone, supported)


class _Judged(NamedTuple):
    """Torque, its run, and the errors of the constraints in that run."""

    torque: CorrectedTorque
    error: float  # m, the largest norm of all constraints
    tip: float  # m, of the tip only
    times: FloatArray
    q: FloatArray
    qd: FloatArray
    missed: FloatArray  # (T, n) m
    rows: FloatArray  # (T, n, dof)


class _Search:
    """Iterative search: simulate, evaluate the tip error, correct the torque."""

    def __init__(
        self,
        constraint: TipConstraint,
        first: RestEnd,
        last: RestEnd,
        start: float,
        end: float,
        support: JointSupport | None,
        settings: RunSettings,
    ) -> None:
        self.settings = settings
        self.constraint, self.first, self.support = constraint, first, support
        arm = self.arm = constraint.arm
        self.plant = arm if support is None else support.arm
        # Without gravity, because the swinging of a hanging arm is not a vibration of its links.
        weightless = Arm(arm.spec.replace(gravity=(0.0, 0.0)))
        angles = constraint.motion.joint_angle(0.0)
        frequency = modes(weightless, angles, joints="free").frequency_hz
        self.period = 1.0 / float(np.min(frequency[frequency > 0.0]))
        rigid = rigid_torque(arm, constraint.motion)
        knots = spline_knots(start, end, self.period / _KNOTS)
        ends = [first.torque - rigid(start - 1.0), last.torque - rigid(end + 1.0)]
        share = np.clip(np.linspace(-0.2, 1.2, len(knots) - 4), 0.0, 1.0)[:, None]
        self.torque = CorrectedTorque(rigid, knots, (1.0 - share) * ends[0] + share * ends[1])
        # One more period shows the vibration that remains after the end.
        self.duration = end + self.period
        self.rate = np.ceil(_SAMPLES / self.period)

    def yardstick(self, rigid: float) -> float:
        """Return the reference error (m) of reductions, limited because an arm may fall."""
        return min(rigid, _MOST_RIGID * self.arm.reach)

    def run(self, reduction: float) -> tuple[_Judged, _Judged]:
        """Correct until errors are small enough or stop decreasing; return best and rigid run."""
        damping, steps = _DAMPING, 0
        best = rigid = self._judged(self.torque)
        allowed = [reduction * self.yardstick(error) for error in (rigid.tip, rigid.error)]
        gram, gradient = self._linear(best)
        while (best.tip > allowed[0] or best.error > allowed[1]) and damping <= _MOST_DAMPING:
            damped = gram + damping**2 * np.trace(gram) * np.eye(len(gram))
            change = linalg.solve(damped, -gradient, assume_a="pos").reshape(-1, self.arm.n_joints)
            coefficients = best.torque.coefficients.copy()
            coefficients[free_coefficients(best.torque.knots)] += change
            try:
                trial = self._judged(replace(best.torque, coefficients=coefficients))
            except SimulationError:
                damping *= 10.0
                continue
            if trial.error >= best.error:
                damping *= 10.0
                continue
            stalled = damping == _LEAST_DAMPING and trial.error > 0.9 * best.error
            damping = max(0.1 * damping, _LEAST_DAMPING)
            best, steps = trial, steps + 1
            if stalled or steps == _STEPS:
                break
            gram, gradient = self._linear(best)
        return best, rigid

    def _judged(self, torque: CorrectedTorque) -> _Judged:
        """Simulate the arm under a torque, with its support if any; return the errors."""
        support = self.support
        acting = torque if support is None else SupportedTorque(support, torque)
        result = self._simulated(self.plant, acting, self.rate)
        times, q, qd = result.time.values, result.q.values, result.qd.values
        missed, rows, error, tip = self._misses(times, q)
        return _Judged(torque, error, tip, times, q, qd, missed, rows)

    def without_support(self, supported: SupportedTorque) -> tuple[CorrectedTorque, float]:
        """Return the sum of torque and support as one torque, and its open-loop tip error, m."""
        given, support = supported.torque, supported.support
        start, end = float(given.knots[0]), float(given.knots[-1])
        count = _FINER * (len(np.unique(given.knots)) - 1)
        # A slightly larger spacing, so that rounding adds no knot and all old knots remain.
        knots = spline_knots(start, end, (end - start) / count * (1.0 + 1e-9))
        rate = np.ceil(_PER_FINER * count / (end - start))
        rtol = min(_CLOSE, relative_tolerance(self.settings, self.arm))
        run = self._simulated(self.plant, supported, rate, rtol)
        inside = (run.time.values >= start) & (run.time.values <= end)
        times, joint = run.time.values[inside], self.arm.joint_index
        rates = run.qd.values[inside][:, joint]
        added = given(times) - given.rigid(times)
        added += support.feedback(times, run.joint_angle.values[inside], rates)
        coefficients = interpolate.make_lsq_spline(times, added, knots, k=DEGREE).c
        torque = CorrectedTorque(given.rigid, knots, coefficients)
        try:
            alone = self._simulated(self.arm, torque, self.rate, rtol)
        except SimulationError:
            return torque, np.inf
        return torque, self._misses(alone.time.values, alone.q.values)[3]

    def _misses(
        self, times: FloatArray, q: FloatArray
    ) -> tuple[FloatArray, FloatArray, float, float]:
        """Return the errors, their derivatives, the largest error and that of the tip, m."""
        along = dynamics_along(self.arm, q, np.zeros_like(q), np.zeros_like(q))
        missed, rows = self.constraint.misses(times, q, along)
        error = float(np.max(np.linalg.norm(missed, axis=1)))
        tip = float(np.max(np.linalg.norm(missed[:, :2], axis=1)))
        return missed, rows, error, tip

    def _simulated(
        self,
        arm: Arm,
        torque: CorrectedTorque | SupportedTorque,
        rate: float,
        rtol: float | None = None,
    ) -> Any:
        rtol = relative_tolerance(self.settings, self.arm) if rtol is None else rtol
        # The caller warns of the last run; the trial runs need no warning.
        with without_warnings(LargeDeflectionWarning):
            settings = replaced(self.settings, rate=rate, rtol=rtol, progress=False)
            start = self.first.q
            return simulate(arm, self.duration, torque=torque, initial=start, settings=settings)

    def _linear(self, run: _Judged) -> tuple[FloatArray, FloatArray]:
        """Return the Gram matrix (p, p) of responses to free coefficients, and the gradient."""
        knots = run.torque.knots
        stages = stage_times(run.times)
        shapes = spline_values(knots, stages.ravel())[:, free_coefficients(knots)]
        shapes = shapes.reshape(*stages.shape, -1)
        response = torque_response(self.plant, run.times, run.q, run.qd, shapes, run.rows)
        matrix = response.reshape(run.missed.size, -1)
        return matrix.T @ matrix, matrix.T @ run.missed.ravel()


def _span(name: str, given: float | None, slowest: float, duration: float) -> float:
    if given is None:
        shortest = 1e-3 * duration
        return float(np.clip(-np.log(_LEFT) / slowest, shortest, _LONGEST * duration))
    span = check_positive(name, given, "s")
    if span > _LONGEST_GIVEN * duration:
        rule = f"be at most {_LONGEST_GIVEN:g} times the motion's duration of {duration:.6g} s"
        raise InputError(Problem(name, rule, shown(given)))
    return span
