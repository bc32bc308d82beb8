"""Torques that make the tip of a flexible arm follow a path: stable, non-causal inversion.

Theory page "separation", sections 4 and 5. The torques begin before the tip moves and end after it
has stopped: the links must be bent when the tip sets off, and unbent when it has come to rest.

References:
    E. Bayo, J. Robotic Systems 4 (1987) 63-75: one link, in the frequency domain.
    S. Devasia, D. Chen and B. Paden, IEEE Trans. Automatic Control 41 (1996) 930-942.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arguments import check_kind, check_positive
from flexarm.arm import Arm
from flexarm.assemble import FloatArray
from flexarm.bending import warn_of_bending
from flexarm.errors import (
    FlexarmError,
    InputError,
    LargeDeflectionWarning,
    Problem,
    SimulationError,
    shown,
)
from flexarm.inversion.correction import (
    DEGREE,
    CorrectedTorque,
    free_coefficients,
    spline_knots,
    spline_values,
)
from flexarm.inversion.joint_support import JointSupport, SupportedTorque, joint_support
from flexarm.inversion.reference import InversionReference, inversion_reference
from flexarm.inversion.zero_dynamics import RestEnd, rest_end
from flexarm.linear import modes
from flexarm.linear.response import torque_response
from flexarm.motion import Motion, gauss, rigid_torque
from flexarm.motion.dynamics_along import dynamics_along
from flexarm.motion.motion import check_motion
from flexarm.motion.tip_constraint import TipConstraint
from flexarm.simulation.run import simulate

#: What is left of the bending, as a part of that at the start of the motion, where torques begin.
_LEFT = 1e-6
#: Longest time before and after a motion, as a multiple of its duration.
_LONGEST = 5.0
_LONGEST_GIVEN = 100.0
#: Knots of the torque and samples of the tip in a period of the slowest vibration.
_KNOTS, _SAMPLES = 12.0, 64.0
#: Torques that hardly move the tip are damped as if they moved it by this part of all together.
#: After a step that helps less so, down to the least; where one fails, more so.
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-5, 1e-7, 0.1
#: Rigid torques that miss by more than this part of the arm's length are no yardstick.
_MOST_RIGID = 0.05
_STEPS = 12
#: Knots of the torque without support, in a knot of the searched one, and samples in each.
_FINER, _PER_FINER = 4, 4


class InversionError(FlexarmError, RuntimeError):
    """No torque was found that keeps the tip on its path.

    Attributes:
        tip_error: largest distance from the path that was reached, m.
    """

    def __init__(self, tip_error: float, reason: str) -> None:
        super().__init__(tip_error, reason)
        self.tip_error = tip_error
        self.reason = reason

    def __str__(self) -> str:
        return f"the tip comes within {self.tip_error:.3g} m of its path, not closer: {self.reason}"


@dataclass(frozen=True, eq=False)
class TipInversion:
    """The torques that make the tip of a flexible arm follow a path.

    Attributes:
        torque: function of time: (joints,) N m, for ``simulate``.
        start, end: when they depart from those that hold the arm at rest, s.
        initial, final: (dof,) coordinates at rest before ``start`` and after ``end``.
        pre_actuation, post_actuation: how long they act before and after the motion, s.
        tip_error: largest distance of the tip from the path in the last run, m. Under gravity that
            run has feedback of the joints, as in ``simulate`` with a controller on ``reference``.
        rigid_tip_error: the same under rigid torques.
        open_loop_tip_error: the same under ``torque`` alone, m; infinite if the arm falls. Without
            gravity it is ``tip_error``.
        zeros: eigenvalues of the motion that is left to the links with the tip held at its start,
            1/s: those in the right half-plane make it non-minimum phase.
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
        """The joint angles that go with the torques: what feedback is to follow besides them."""
        ends = self.start, self.end
        return inversion_reference(
            self.arm, self.torque, ends, self.initial, self.final, self._supported
        )

    @property
    def pre_actuation(self) -> float:
        """How long the torques act before the tip moves, s."""
        return self.motion.start_time - self.start

    @property
    def post_actuation(self) -> float:
        """How long they act after the tip has stopped, s."""
        return self.end - self.motion.end_time


def tip_inversion(
    arm: Arm,
    motion: Motion,
    *,
    pre_actuation: float | None = None,
    post_actuation: float | None = None,
    reduction: float = 2e-3,
) -> TipInversion:
    """Find the torques that make the tip of a flexible arm follow the tip of the rigid one.

    Args:
        arm: the arm, with links that bend.
        motion: rest to rest, of the rigid arm; it must start late enough for what comes before it,
            ``pre_actuation``. Arms of three joints and more have some to spare: all but the two
            that move the tip best follow it too. The tip of a single link is kept in the
            direction of the rigid one.
        pre_actuation, post_actuation: s; by default until a millionth of the bending is left.
        reduction: stop when the tip's largest error is this part of that under rigid torques, or
            of a twentieth of the arm's length where those leave the arm to fall.

    Raises:
        InputError: the motion starts too early, leaves the joints no hold on the tip, or an
            argument has the wrong value.
        InversionError: the error cannot be reduced to a hundredth, or to ``reduction`` if that is
            more.

    Levenberg-Marquardt on the full nonlinear model: each step runs ``simulate`` and
    corrects the torque, all of it at once, by the response of the arm along that run; (D.12) to
    (D.14). Under gravity the runs have feedback of the joints, which the torque returned includes.
    With elastic joints they have none, and arms that fall by themselves fail.
    """
    where = "tip_inversion"
    arm = check_kind(where, "arm", arm, Arm)
    motion = check_motion(where, motion, arm)
    wanted = check_positive(where, "reduction", reduction)
    if arm.dof == arm.joints:
        hint = "Its torques are fa.rigid_torque(arm, motion)."
        raise InputError(Problem(where, "arm", "have a link that bends", "rigid", hint))
    constraint = TipConstraint(arm, motion)
    constraint.check()
    first, last = rest_end(constraint, motion.start_time), rest_end(constraint, motion.end_time)
    before = _span(where, "pre_actuation", pre_actuation, first.growth, motion.duration)
    after = _span(where, "post_actuation", post_actuation, last.decay, motion.duration)
    if motion.start_time < before:
        rule = f"start at {before:.6g} s or later: the torques begin that long before it"
        hint = "Give start_time where the motion is made, or a shorter pre_actuation."
        problem = Problem(where, "motion", rule, f"starts at {motion.start_time:.6g} s", hint)
        raise InputError(problem)
    start, end = motion.start_time - before, motion.end_time + after
    support = joint_support(arm, motion, (first, last), start, end)
    search = _Search(constraint, first, last, start, end, support)
    found, rigid = search.run(wanted)
    if found.tip > max(wanted, 1e-2) * search.yardstick(rigid.tip):
        raise InversionError(found.tip, f"under rigid torques it is within {rigid.tip:.3g} m.")
    warn_of_bending(arm, found.q)
    ends, errors = (first.q, last.q), (found.tip, rigid.tip)
    zeros = np.asarray(first.zeros)
    if support is None:
        return TipInversion(arm, motion, found.torque, start, end, *ends, *errors, zeros, found.tip)
    supported = SupportedTorque(support, found.torque)
    torque, alone = search.without_support(supported)
    return TipInversion(arm, motion, torque, start, end, *ends, *errors, zeros, alone, supported)


class _Judged(NamedTuple):
    """A torque, the run that it gives, and by how much the conditions are missed there."""

    torque: CorrectedTorque
    error: float  # m, the largest of all conditions together
    tip: float  # m, of the tip alone
    times: FloatArray
    q: FloatArray
    qd: FloatArray
    missed: FloatArray  # (T, n) m
    rows: FloatArray  # (T, n, dof)


class _Search:
    """Runs, errors and corrections."""

    def __init__(
        self,
        constraint: TipConstraint,
        first: RestEnd,
        last: RestEnd,
        start: float,
        end: float,
        support: JointSupport | None,
    ) -> None:
        self.constraint, self.first, self.support = constraint, first, support
        arm = self.arm = constraint.arm
        self.plant = arm if support is None else support.arm
        # Without gravity: the swinging of a hanging arm is no vibration of its links.
        weightless = Arm(arm.spec.replace(gravity=(0.0, 0.0)))
        angles = constraint.motion.joint_angle(0.0)
        frequency = modes(weightless, angles, joints="free").frequency_hz
        self.period = 1.0 / float(np.min(frequency[frequency > 0.0]))
        rigid = rigid_torque(arm, constraint.motion)
        knots = spline_knots(start, end, self.period / _KNOTS)
        ends = [first.torque - rigid(start - 1.0), last.torque - rigid(end + 1.0)]
        share = np.clip(np.linspace(-0.2, 1.2, len(knots) - 4), 0.0, 1.0)[:, None]
        self.torque = CorrectedTorque(rigid, knots, (1.0 - share) * ends[0] + share * ends[1])
        # One period more: what vibrates then was not brought to rest.
        self.duration = end + self.period
        self.rate = np.ceil(_SAMPLES / self.period)

    def yardstick(self, rigid: float) -> float:
        """Error (m) that reductions are counted from: an arm that falls misses by any amount."""
        return min(rigid, _MOST_RIGID * float(np.sum(self.arm.lengths)))

    def run(self, reduction: float) -> tuple[_Judged, _Judged]:
        """Correct until the errors are small enough, or no longer fall; what was found, and rigid.

        The tip alone must be close enough, and all conditions together.
        """
        from scipy.linalg import solve

        damping, steps = _DAMPING, 0
        best = rigid = self._judged(self.torque)
        allowed = [reduction * self.yardstick(error) for error in (rigid.tip, rigid.error)]
        gram, gradient = self._linear(best)
        while (best.tip > allowed[0] or best.error > allowed[1]) and damping <= _MOST_DAMPING:
            damped = gram + damping**2 * np.trace(gram) * np.eye(len(gram))
            change = solve(damped, -gradient, assume_a="pos").reshape(-1, self.arm.joints)
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
        """Run the arm under a torque, supported if need be, and find what its tip misses."""
        support = self.support
        acting = torque if support is None else SupportedTorque(support, torque)
        result = self._simulated(self.plant, acting, self.rate)
        times, q, qd = result.time.values, result.q.values, result.qd.values
        missed, rows, error, tip = self._misses(times, q)
        return _Judged(torque, error, tip, times, q, qd, missed, rows)

    def without_support(self, supported: SupportedTorque) -> tuple[CorrectedTorque, float]:
        """Return the torque that does what torque and support do together, and its error, m."""
        from scipy.interpolate import make_lsq_spline

        given, support = supported.torque, supported.support
        start, end = float(given.knots[0]), float(given.knots[-1])
        count = _FINER * (len(np.unique(given.knots)) - 1)
        # A little more than the spacing, so that rounding adds no knot: all old knots stay.
        knots = spline_knots(start, end, (end - start) / count * (1.0 + 1e-9))
        rate = np.ceil(_PER_FINER * count / (end - start))
        run = self._simulated(self.plant, supported, rate, rtol=1e-9, atol=1e-11)
        inside = (run.time.values >= start) & (run.time.values <= end)
        times, joint = run.time.values[inside], self.arm.joint_index
        rates = run.qd.values[inside][:, joint]
        added = given(times) - given.rigid(times)
        added += support.feedback(times, run.joint_angle.values[inside], rates)
        coefficients = make_lsq_spline(times, added, knots, k=DEGREE).c
        torque = CorrectedTorque(given.rigid, knots, coefficients)
        try:
            alone = self._simulated(self.arm, torque, self.rate, rtol=1e-9, atol=1e-11)
        except SimulationError:
            return torque, np.inf
        return torque, self._misses(alone.time.values, alone.q.values)[3]

    def _misses(
        self, times: FloatArray, q: FloatArray
    ) -> tuple[FloatArray, FloatArray, float, float]:
        """Return what is missed, its derivatives, the largest error and that of the tip, m."""
        along = dynamics_along(self.arm, q, np.zeros_like(q), np.zeros_like(q))
        missed, rows = self.constraint.misses(times, q, along)
        error = float(np.max(np.linalg.norm(missed, axis=1)))
        tip = float(np.max(np.linalg.norm(missed[:, :2], axis=1)))
        return missed, rows, error, tip

    def _simulated(
        self, arm: Arm, torque: CorrectedTorque | SupportedTorque, rate: float, **options: Any
    ) -> Any:
        with warnings.catch_warnings():
            # The caller reports the last run; trials on the way do not matter.
            warnings.simplefilter("ignore", LargeDeflectionWarning)
            return simulate(
                arm,
                self.duration,
                torque=torque,
                initial=self.first.q,
                rate=rate,
                progress=False,
                **options,
            )

    def _linear(self, run: _Judged) -> tuple[FloatArray, FloatArray]:
        """Squared response to the free coefficients (p, p), and the gradient of the error (p,)."""
        knots = run.torque.knots
        stages = gauss.stage_times(run.times)
        shapes = spline_values(knots, stages.ravel())[:, free_coefficients(knots)]
        response = torque_response(
            self.plant, run.times, run.q, run.qd, shapes.reshape(*stages.shape, -1), run.rows
        )
        matrix = response.reshape(run.missed.size, -1)
        return matrix.T @ matrix, matrix.T @ run.missed.ravel()


def _span(where: str, name: str, given: float | None, slowest: float, duration: float) -> float:
    if given is None:
        shortest = 1e-3 * duration
        return float(np.clip(-np.log(_LEFT) / slowest, shortest, _LONGEST * duration))
    span = check_positive(where, name, given, "s")
    if span > _LONGEST_GIVEN * duration:
        rule = f"be at most {_LONGEST_GIVEN:g} times the motion's duration of {duration:.6g} s"
        raise InputError(Problem(where, name, rule, shown(given)))
    return span
