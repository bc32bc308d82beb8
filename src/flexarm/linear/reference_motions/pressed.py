"""References for force control: the bent arm follows a surface and presses on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.bending import one_warning, warn_of_bending
from flexarm.base.arguments import (
    check_direction,
    check_function,
    check_kind,
    check_nonnegative,
    check_positive,
    check_times,
)
from flexarm.base.errors import InputError, Problem, public_call
from flexarm.base.user_functions import call
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.motion import Motion
from flexarm.motion.geometry.inverse_kinematics import tip_jacobian
from flexarm.motion.motion import check_motion

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

T = TypeVar("T")

#: Tolerance of the tip position relative to the length of the arm, and most corrections.
_CLOSE, _CORRECTIONS = 1e-9, 60
_FEWEST_SAMPLES, _MOST_SAMPLES = 8, 4000
#: Additional coefficient of friction of ``PressedMotion.rougher``.
_MORE_FRICTION = 0.1
#: Friction changes sign smoothly below this fraction of the largest sliding speed, because a jump
#: would excite vibration.
_SLOW = 0.2
#: Largest part of the path along the normal under a force, and number of instants to find it.
#: Shaped motions deviate from their path, and the force may begin before the path arrives.
_MOST_ACROSS, _INSTANTS = 0.5, 201


class JointFeedback(NamedTuple):
    """Equilibrium of the bent arm at one instant, with the contact force at its tip."""

    angle: FloatArray  # (joints,) rad
    torque: FloatArray  # (joints,) N m, in equilibrium
    pressing: FloatArray  # (joints,) N m, minus the torque of the rigid model
    q: FloatArray  # (dof,)


class PressedMotion:
    """Reference for force control: a motion of the joints and the force at the tip.

    At each instant the joint angles place the tip of the *bent* arm, in equilibrium with the
    contact force, on the path of the motion. Between the sampled times all quantities are splines
    of degree five. After the last sample the arm is at rest and the force remains constant. All
    methods accept a time (s) or times (T,).

    Attributes:
        motion: motion of the rigid arm, whose tip follows the path.
        start_time, end_time, breaks: those of ``motion``, s.
        initial: q (dof,) of the arm in contact at time zero.
        friction: coefficient of sliding friction that is planned for.
        vectorized: true: methods accept many times at once.
    """

    vectorized = True

    def __init__(
        self,
        arm: Arm,
        motion: Motion,
        force: Callable[[float], float],
        normal: Callable[[float], FloatArray],
        times: FloatArray,
        friction: float,
    ) -> None:
        search = _Search(arm, motion, friction)
        with one_warning():
            held = [search.at(t, force(t), normal(t)) for t in times.tolist()]
        self._given = (arm, motion, force, normal, times)
        self._bent = np.array([one.q for one in held])
        self.motion, self.friction = motion, friction
        self.start_time, self.end_time, self.breaks = (
            motion.start_time,
            motion.end_time,
            motion.breaks,
        )
        self.initial = held[0].q
        self._force, self._normal = force, normal
        self._first, self._last = float(times[0]), float(times[-1])
        self._angle = _spline(times, [one.angle for one in held])
        self._rate, self._acceleration = self._angle.derivative(1), self._angle.derivative(2)
        self._holding = _spline(times, [one.torque for one in held])
        self._pressing = _spline(times, [one.pressing for one in held])

    def __repr__(self) -> str:
        size = self.motion.joints
        return f"<flexarm.PressedMotion: {size} joints, up to {self._last:g} s>"

    @cached_property
    def rougher(self) -> PressedMotion:
        """The same motion and force with more ``friction``, computed at the first use.

        Controllers that estimate the friction interpolate between the two.
        """
        return PressedMotion(*self._given, self.friction + _MORE_FRICTION)

    def _inside(self, t: ArrayLike) -> FloatArray:
        return np.clip(check_times("t", t), self._first, self._last)

    def _moving(self, t: ArrayLike) -> FloatArray:
        """Return 1 within the sampled times and 0 outside, (..., 1)."""
        times = check_times("t", t)
        return np.asarray((times >= self._first) & (times <= self._last), float)[..., None]

    @public_call
    def joint_angle(self, t: ArrayLike) -> FloatArray:
        """Return the joint angles (joints,) or (T, joints), rad."""
        return np.asarray(self._angle(self._inside(t)))

    @public_call
    def joint_rate(self, t: ArrayLike) -> FloatArray:
        """Return the joint rates (joints,) or (T, joints), rad/s."""
        return np.asarray(self._rate(self._inside(t)) * self._moving(t))

    @public_call
    def joint_acceleration(self, t: ArrayLike) -> FloatArray:
        """Return the joint accelerations (joints,) or (T, joints), rad/s^2."""
        return np.asarray(self._acceleration(self._inside(t)) * self._moving(t))

    @public_call
    def holding_torque(self, t: ArrayLike) -> FloatArray:
        """Return the equilibrium torques of the arm in contact, (joints,) or (T, joints), N m."""
        return np.asarray(self._holding(self._inside(t)))

    @public_call
    def pressing_torque(self, t: ArrayLike) -> FloatArray:
        """Return ``holding_torque`` minus the torque of the rigid model at the same angles, N m."""
        return np.asarray(self._pressing(self._inside(t)))

    def tip(self, t: ArrayLike) -> FloatArray:
        """Return the prescribed position of the tip, (2,) or (T, 2), m."""
        return self.motion.tip(t)

    @public_call
    def contact_force(self, t: ArrayLike) -> FloatArray:
        """Return the contact force () or (T,) of the tip on the surface, N, at least 0."""
        times = self._inside(t)
        forces = [float(self._force(float(now))) for now in times.ravel()]
        return np.array(forces).reshape(times.shape)

    @public_call
    def normal(self, t: ArrayLike) -> FloatArray:
        """Return the outward unit normal of the surface, (2,) or (T, 2), world axes."""
        times = self._inside(t)
        normals = [self._normal(float(now)) for now in times.ravel()]
        return np.array(normals).reshape(*times.shape, 2)


def _spline(times: FloatArray, values: Sequence[FloatArray]) -> BSpline:
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(times, np.array(values), k=5)


@public_call
def pressed_motion(
    arm: Arm,
    motion: Motion,
    force: float | Callable[[float], float],
    normal: ArrayLike | Callable[[float], ArrayLike],
    *,
    duration: float | None = None,
    friction: float = 0.0,
    interval: float = 0.05,
) -> PressedMotion:
    """Compute a reference for a tip that presses on a surface along a motion.

    Args:
        arm: flexible or rigid; its deflection under the force and gravity is included.
        motion: motion of the rigid arm whose tip path is on the surface.
        force: N, at least 0, or a smooth function of time (s) that returns it.
        normal: (2,) outward normal of the surface on the path, world axes, any length; or a
            function of time that returns it, for a surface that is not straight.
        duration: s, of the whole run; by default until the end of the motion.
        friction: coefficient of sliding friction at the tip.
        interval: s between the times at which the equilibrium is computed; force and path must be
            smooth over several intervals.

    Raises:
        InputError: if a force is negative or not finite, a normal is zero, ``friction`` is
            negative, the motion is for another arm, the bent arm cannot reach the path, or the
            path moves along the normal by more than half of its length while the force is not zero.
        SimulationError: if a function of time raises an exception.
    """
    arm = check_kind("arm", arm, Arm)
    motion = check_motion(motion, arm)
    friction = check_nonnegative("friction", friction)
    interval = check_positive("interval", interval)
    end = check_positive("duration", motion.end_time if duration is None else duration)
    count = min(max(int(np.ceil(end / interval)) + 1, _FEWEST_SAMPLES), _MOST_SAMPLES)
    times = np.linspace(0.0, end, count)
    pressing = _over_time("force", force, check_nonnegative)
    outward = _over_time("normal", normal, check_direction)
    _refuse_across(motion, pressing, outward, end)
    found = PressedMotion(arm, motion, pressing, outward, times, friction)
    warn_of_bending(arm, found._bent)
    return found


def _refuse_across(
    motion: Motion,
    force: Callable[[float], float],
    normal: Callable[[float], FloatArray],
    end: float,
) -> None:
    """Raise if the path crosses the surface, instead of following it, until a time (s)."""
    times = np.linspace(0.0, end, _INSTANTS)
    steps = np.diff(motion.tip(times), axis=0)
    middles = (0.5 * (times[1:] + times[:-1])).tolist()
    moves = [(t, step) for t, step in zip(middles, steps, strict=True) if step.any()]
    across = sum(abs(float(normal(t) @ step)) for t, step in moves if force(t) > 0.0)
    way = float(np.hypot(*steps.T).sum())
    if across > _MOST_ACROSS * way:
        rule = f"is the direction of {across / way:.0%} of the path while the tip presses"
        hint = "A tip that presses moves along the surface, at right angles to its normal."
        raise InputError(Problem("normal", rule, hint=hint))


def _over_time(name: str, given: Any, check: Callable[[str, object], T]) -> Callable[[float], T]:
    """Return a value, or a function of time, as a function of time that checks its values."""
    if callable(given):
        check_function(name, given)
    return partial(_checked, name, given, check)


def _checked(name: str, given: Any, check: Callable[[str, object], T], t: float) -> T:
    if not callable(given):
        return check(name, given)
    return check(f"{name} at t = {t:g} s", call(f"the {name}", given, t))


class _Search:
    """Search for joint angles that place the tip of the loaded arm, starting at the last result."""

    def __init__(self, arm: Arm, motion: Motion, friction: float) -> None:
        self._arm, self._motion, self._friction = arm, motion, friction
        self._rigid = arm.rigid()
        times = np.linspace(motion.start_time, motion.end_time, _INSTANTS)
        fastest = float(np.hypot(*np.gradient(motion.tip(times), times, axis=0).T).max())
        self._slow = _SLOW * fastest or 1.0  # without motion the speed is zero
        self._close = _CLOSE * float(arm.lengths.sum())
        self._q: FloatArray | None = None
        self._beside = np.zeros(arm.joints)
        self._drift = np.zeros(arm.joints)  # its change between two times

    def at(self, t: float, force: float, normal: FloatArray) -> JointFeedback:
        """Return the equilibrium at time t (s) under a force (N) along a normal (2,)."""
        arm, motion = self._arm, self._motion
        tangent = np.array([-normal[1], normal[0]])
        rigid = np.asarray(motion.joint_angle(t))
        J = tip_jacobian(motion.chain.lengths, rigid + motion.chain.offset)
        sliding = float(np.tanh(tangent @ J @ motion.joint_rate(t) / self._slow))
        on_tip = force * (normal - self._friction * sliding * tangent)
        angle, desired = rigid + self._beside + self._drift, motion.tip(t)
        J = tip_jacobian(motion.chain.lengths, angle + motion.chain.offset)
        way = np.asarray(np.linalg.pinv(J, rcond=1e-6), dtype=np.float64)
        step, before = np.zeros(arm.joints), np.zeros(2)
        for _ in range(_CORRECTIONS):
            if self._q is None:
                rest = equilibrium(arm, angle, tip_force=on_tip)
            else:
                start = self._q.copy()
                start[arm.joint_index] = angle
                rest = equilibrium(arm, tip_force=on_tip, start=start)
            self._q = rest.q
            missed = arm.tip(rest.q)[:2] - desired
            if np.hypot(*missed) < self._close:
                self._drift = angle - rigid - self._beside
                self._beside = angle - rigid
                rigid_counterpart = self._rigid.bias_force(
                    self._rigid.rest(angle), np.zeros(self._rigid.dof)
                )
                pressing = rest.torque - rigid_counterpart[self._rigid.joint_index]
                return JointFeedback(angle, rest.torque, pressing, rest.q)
            if step.any():  # Broyden's update of the inverse Jacobian
                gained = way @ (missed - before)
                scale = step @ gained
                if scale > 0.1 * (step @ step):
                    way += np.outer(step - gained, step @ way) / scale
            step, before = -way @ missed, missed
            angle = angle + step
        hint = "The arm bends too far under the force, or its tip is at the edge of its reach."
        rule = f"misses the path by {np.hypot(*missed):.3g} m at t = {t:g} s"
        raise InputError(Problem("the bent arm", rule, hint=hint))
