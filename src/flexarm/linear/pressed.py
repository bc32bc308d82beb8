"""A motion of the tip along a surface that it presses on: how the bent arm does that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import (
    check_function,
    check_kind,
    check_nonnegative,
    check_positive,
    check_times,
)
from flexarm.arm import Arm
from flexarm.assemble import FloatArray
from flexarm.bending import one_warning, warn_of_bending
from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.linear.equilibrium import equilibrium
from flexarm.motion import Motion
from flexarm.motion.kinematics import tip_jacobian
from flexarm.motion.motion import check_motion
from flexarm.user_functions import call

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

#: The tip is brought onto its path this closely (m), within so many corrections.
_CLOSE, _CORRECTIONS = 1e-9, 60
_FEWEST_SAMPLES, _MOST_SAMPLES = 8, 4000
#: Friction turns over smoothly below this part of the fastest sliding: a jump would excite the arm.
_SLOW = 0.2


class Held(NamedTuple):
    """The bent arm at one moment, pressing and held still."""

    angle: FloatArray  # (joints,) rad
    torque: FloatArray  # (joints,) N m that hold it
    pressing: FloatArray  # (joints,) N m of these that the rigid twin does not take
    q: FloatArray  # (dof,)


class PressedMotion:
    """A reference for force control: a motion of the joints, and the force at the tip with it.

    The joints go where the tip of the *bent* arm, pressed by the force and held still at each
    moment, lies on the motion's path. Between the sampled times everything is a spline of the
    fifth degree; after the last one the arm rests and the force stays. Every method takes a time
    (s) or times (T,).

    Attributes:
        motion: of the rigid arm, whose tip is the path.
        start_time, end_time, breaks: its own, s.
        initial: q (dof,) of the arm pressed at time zero.
        vectorized: true: methods take many times at once.
    """

    vectorized = True

    def __init__(
        self,
        motion: Motion,
        force: Callable[[float], float],
        normal: Callable[[float], FloatArray],
        times: FloatArray,
        held: Sequence[Held],
    ) -> None:
        self.motion = motion
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

    def _inside(self, t: ArrayLike) -> FloatArray:
        return np.clip(check_times("PressedMotion", "t", t), self._first, self._last)

    def _moving(self, t: ArrayLike) -> FloatArray:
        """Return 1 within the sampled times and 0 outside of them, (..., 1)."""
        times = check_times("PressedMotion", "t", t)
        return np.asarray((times >= self._first) & (times <= self._last), float)[..., None]

    def joint_angle(self, t: ArrayLike) -> FloatArray:
        """Joint angles (joints,) or (T, joints), rad."""
        return np.asarray(self._angle(self._inside(t)))

    def joint_rate(self, t: ArrayLike) -> FloatArray:
        """Joint rates (joints,) or (T, joints), rad/s."""
        return np.asarray(self._rate(self._inside(t)) * self._moving(t))

    def joint_acceleration(self, t: ArrayLike) -> FloatArray:
        """Joint accelerations (joints,) or (T, joints), rad/s^2."""
        return np.asarray(self._acceleration(self._inside(t)) * self._moving(t))

    def holding_torque(self, t: ArrayLike) -> FloatArray:
        """Torques (joints,) or (T, joints) N m that hold the bent arm, pressing, at each moment."""
        return np.asarray(self._holding(self._inside(t)))

    def pressing_torque(self, t: ArrayLike) -> FloatArray:
        """Part of ``holding_torque`` that is not what the rigid twin takes at these angles."""
        return np.asarray(self._pressing(self._inside(t)))

    def tip(self, t: ArrayLike) -> FloatArray:
        """Where the tip is to be, (2,) or (T, 2), m."""
        return self.motion.tip(t)

    def contact_force(self, t: ArrayLike) -> FloatArray:
        """Force () or (T,) N that the tip presses on the surface with, at least 0."""
        times = self._inside(t)
        forces = [float(self._force(float(now))) for now in times.ravel()]
        return np.array(forces).reshape(times.shape)

    def normal(self, t: ArrayLike) -> FloatArray:
        """Unit normal (2,) or (T, 2) of the surface, world axes, away from it."""
        times = self._inside(t)
        normals = [self._normal(float(now)) for now in times.ravel()]
        return np.array(normals).reshape(*times.shape, 2)


def _spline(times: FloatArray, values: Sequence[FloatArray]) -> BSpline:
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(times, np.array(values), k=5)


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
    """Make a motion along a surface one that presses on it.

    Args:
        arm: flexible or rigid; how far it yields to the force and to gravity counts.
        motion: its tip path lies on the surface.
        force: N, at least 0, or a smooth function of time (s) that gives it.
        normal: (2,) of the surface where the path is, away from it, world axes, any length; or a
            function of time that gives it, on a surface that is not straight.
        duration: s, of the whole run; None for the motion's end.
        friction: coefficient, of a sliding tip.
        interval: s between the times at which the arm's equilibrium is computed; force and path
            must be smooth over some of them.

    Raises:
        InputError: a force that is negative or not finite, a normal of no direction, a friction
            that is negative, a motion of another arm, or an arm that cannot follow.
        SimulationError: a function of time that raises an exception.
    """
    where = "pressed_motion"
    arm = check_kind(where, "arm", arm, Arm)
    motion = check_motion(where, motion, arm)
    friction = check_nonnegative(where, "friction", friction)
    interval = check_positive(where, "interval", interval)
    end = check_positive(where, "duration", motion.end_time if duration is None else duration)
    count = min(max(int(np.ceil(end / interval)) + 1, _FEWEST_SAMPLES), _MOST_SAMPLES)
    times = np.linspace(0.0, end, count)
    pressing, outward = _force(where, force), _normal(where, normal)
    search = _Search(arm, motion, friction)
    with one_warning():
        held = [search.at(t, pressing(t), outward(t)) for t in times.tolist()]
    warn_of_bending(arm, np.array([one.q for one in held]))
    return PressedMotion(motion, pressing, outward, times, held)


def _force(where: str, given: float | Callable[[float], float]) -> Callable[[float], float]:
    """Make the force a function of time that refuses negative values."""
    if callable(given):
        check_function(where, "force", given)
    return partial(_checked_force, where, given)


def _checked_force(where: str, given: float | Callable[[float], float], t: float) -> float:
    value = call("the force", given, t) if callable(given) else given
    name = f"force at t = {t:g} s" if callable(given) else "force"
    return check_nonnegative(where, name, value)


def _normal(
    where: str, given: ArrayLike | Callable[[float], ArrayLike]
) -> Callable[[float], FloatArray]:
    """Make the normal a function of time of length one."""
    if callable(given):
        check_function(where, "normal", given)
    return partial(_unit_normal, where, given)


def _unit_normal(
    where: str, given: ArrayLike | Callable[[float], ArrayLike], t: float
) -> FloatArray:
    value = call("the normal", given, t) if callable(given) else given
    name = f"normal at t = {t:g} s" if callable(given) else "normal"
    outward = check_array(where, name, value, (2,))
    length = float(np.hypot(*outward))
    if not length > 0.0:
        raise InputError(Problem(where, name, "have a direction", shown(value)))
    return np.asarray(outward / length)


class _Search:
    """Joint angles at which the tip of the loaded arm is where it is to be; each from the last."""

    def __init__(self, arm: Arm, motion: Motion, friction: float) -> None:
        self._arm, self._motion, self._friction = arm, motion, friction
        self._rigid = arm.rigid()
        times = np.linspace(motion.start_time, motion.end_time, 201)
        fastest = float(np.hypot(*np.gradient(motion.tip(times), times, axis=0).T).max())
        self._slow = max(_SLOW * fastest, 1e-9)
        self._q: FloatArray | None = None
        self._beside = np.zeros(arm.joints)
        self._drift = np.zeros(arm.joints)  # change of that from one time to the next

    def at(self, t: float, force: float, normal: FloatArray) -> Held:
        """Find the arm at time t (s) under a force (N) along a normal (2,)."""
        arm, motion = self._arm, self._motion
        tangent = np.array([-normal[1], normal[0]])
        rigid = np.asarray(motion.joint_angle(t))
        J = tip_jacobian(motion.chain.lengths, rigid + motion.chain.offset)
        sliding = float(np.tanh(tangent @ J @ motion.joint_rate(t) / self._slow))
        on_tip = force * (normal - self._friction * sliding * tangent)
        angle, wanted = rigid + self._beside + self._drift, motion.tip(t)
        J = tip_jacobian(motion.chain.lengths, angle + motion.chain.offset)
        way = np.linalg.pinv(J, rcond=1e-6)
        step, before = np.zeros(arm.joints), np.zeros(2)
        for _ in range(_CORRECTIONS):
            if self._q is None:
                rest = equilibrium(arm, angle, tip_force=on_tip)
            else:
                start = self._q.copy()
                start[arm.joint_index] = angle
                rest = equilibrium(arm, tip_force=on_tip, start=start)
            self._q = rest.q
            missed = arm.tip(rest.q)[:2] - wanted
            if np.hypot(*missed) < _CLOSE:
                self._drift = angle - rigid - self._beside
                self._beside = angle - rigid
                twin = self._rigid.bias_force(self._rigid.rest(angle), np.zeros(self._rigid.dof))
                pressing = rest.torque - twin[self._rigid.joint_index]
                return Held(angle, rest.torque, pressing, rest.q)
            if step.any():  # Broyden's update: the bent arm's way, learnt from the last step
                gained = way @ (missed - before)
                scale = step @ gained
                if scale > 0.1 * (step @ step):
                    way += np.outer(step - gained, step @ way) / scale
            step, before = -way @ missed, missed
            angle = angle + step
        hint = "The arm bends too far under the force, or its tip is at the edge of its reach."
        value = f"{np.hypot(*missed):.3g} m off at t = {t:g} s"
        raise InputError(Problem("pressed_motion", "the bent arm", "reach the path", value, hint))
