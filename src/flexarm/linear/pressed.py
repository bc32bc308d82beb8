"""A motion of the tip along a surface that it presses on: how the bent arm does that."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from flexarm.arm import Arm
from flexarm.assemble import FloatArray
from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.linear.equilibrium import equilibrium
from flexarm.motion import Motion
from flexarm.motion.kinematics import tip_jacobian

#: The tip is brought onto its path this closely (m), within so many corrections.
_CLOSE, _CORRECTIONS = 1e-9, 60
#: Times of rest after the end of the motion that are sampled with it (s).
_MOST_SAMPLES = 4000
#: Friction turns over smoothly below this part of the fastest sliding: a jump would excite the arm.
_SLOW = 0.2


class PressedMotion:
    """A reference for force control: a motion of the joints, and the force at the tip with it.

    The joints go where the tip of the *bent* arm, pressed by the force and held still at each
    moment, lies on the motion's path. Between the sampled times everything is a cubic spline.

    Attributes:
        motion: of the rigid arm, whose tip is the path.
        start_time, end_time, breaks: its own, s.
        initial: q (dof,) of the arm pressed at time zero.
    """

    def __init__(
        self,
        motion: Motion,
        force: Callable[[float], float],
        normal: FloatArray,
        times: FloatArray,
        angles: FloatArray,
        torques: FloatArray,
        initial: FloatArray,
    ) -> None:
        self.motion = motion
        self.start_time, self.end_time, self.breaks = (
            motion.start_time,
            motion.end_time,
            motion.breaks,
        )
        self.initial = initial
        self._force, self._normal = force, normal
        self._last = float(times[-1])
        self._angle = CubicSpline(times, angles)
        self._rate, self._acceleration = self._angle.derivative(1), self._angle.derivative(2)
        self._torque = CubicSpline(times, torques)

    def __repr__(self) -> str:
        return f"<flexarm.PressedMotion: to t = {self._last:g} s, normal {self._normal.tolist()}>"

    def joint_angle(self, t: ArrayLike) -> FloatArray:
        """Joint angles (joints,) or (T, joints), rad."""
        return np.asarray(self._angle(np.minimum(t, self._last)))

    def joint_rate(self, t: ArrayLike) -> FloatArray:
        """Joint rates (joints,) or (T, joints), rad/s."""
        return np.asarray(self._rate(np.minimum(t, self._last)))

    def joint_acceleration(self, t: ArrayLike) -> FloatArray:
        """Joint accelerations (joints,) or (T, joints), rad/s^2."""
        return np.asarray(self._acceleration(np.minimum(t, self._last)))

    def holding_torque(self, t: ArrayLike) -> FloatArray:
        """Torques (joints,) or (T, joints) N m that hold the bent arm, pressing, at each moment."""
        return np.asarray(self._torque(np.minimum(t, self._last)))

    def tip(self, t: ArrayLike) -> FloatArray:
        """Where the tip is to be, (2,) or (T, 2), m."""
        return self.motion.tip(t)

    def contact_force(self, t: float) -> float:
        """Force (N) that the tip presses on the surface with, at least 0."""
        return self._force(t)

    def normal(self, t: float) -> FloatArray:
        """Normal (2,) of the surface, world axes, away from it."""
        return self._normal


def pressed_motion(
    arm: Arm,
    motion: Motion,
    force: float | Callable[[float], float],
    normal: ArrayLike,
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
        normal: (2,) of the surface, away from it, world axes; any length.
        duration: s, of the whole run; None for the motion's end.
        friction: coefficient, of a sliding tip.
        interval: s between the times at which the arm's equilibrium is computed.

    Raises:
        InputError: a force that is negative or not finite, a normal of no direction, a friction
            that is negative, a motion of another arm, or an arm that cannot follow.
    """
    where = "pressed_motion"
    if not isinstance(motion, Motion) or motion.joints != arm.joints:
        rule = f"be a motion of an arm with {arm.joints} joints"
        raise InputError(Problem(where, "motion", rule, shown(motion)))
    outward = check_array(where, "normal", normal, (2,))
    if not np.hypot(*outward) > 0.0:
        raise InputError(Problem(where, "normal", "have a direction", shown(normal)))
    outward = outward / np.hypot(*outward)
    for name, value, least in (("friction", friction, 0.0), ("interval", interval, None)):
        number = float(check_array(where, name, value, ()))
        if number < 0.0 or (least is None and number == 0.0):
            rule = "be at least 0" if least is not None else "be greater than 0"
            raise InputError(Problem(where, name, rule, shown(value)))
    end = motion.end_time if duration is None else float(check_array(where, "duration", duration, ()))
    count = min(max(int(np.ceil(end / interval)) + 1, 8), _MOST_SAMPLES)
    times = np.linspace(0.0, end, count)
    pressing = force if callable(force) else _constant(where, force)
    sought = _Search(arm, motion, outward, friction)
    rows = [sought.at(float(t), _checked(where, pressing, float(t))) for t in times]
    angles, torques, initial = ([row[k] for row in rows] for k in range(3))
    return PressedMotion(
        motion, pressing, outward, times, np.array(angles), np.array(torques), initial[0]
    )


def _constant(where: str, force: float) -> Callable[[float], float]:
    value = float(check_array(where, "force", force, ()))
    return lambda _: value


def _checked(where: str, force: Callable[[float], float], t: float) -> float:
    value = float(check_array(where, f"force at t = {t:g}", force(t), ()))
    if value < 0.0:
        raise InputError(Problem(where, f"force at t = {t:g}", "be at least 0", shown(value)))
    return value


class _Search:
    """Joint angles at which the tip of the loaded arm is where it is to be; each from the last."""

    def __init__(self, arm: Arm, motion: Motion, normal: FloatArray, friction: float) -> None:
        self._arm, self._motion = arm, motion
        self._normal, self._friction = normal, friction
        self._tangent = np.array([-normal[1], normal[0]])
        times = np.linspace(motion.start_time, motion.end_time, 201)
        fastest = float(np.hypot(*np.gradient(motion.tip(times), times, axis=0).T).max())
        self._slow = max(_SLOW * fastest, 1e-9)
        self._q: FloatArray | None = None
        self._beside = np.zeros(arm.joints)
        self._drift = np.zeros(arm.joints)  # change of that from one time to the next

    def at(self, t: float, force: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return joint angles, holding torques (joints,) and q (dof,) at time t under a force."""
        arm, motion = self._arm, self._motion
        rigid = np.asarray(motion.joint_angle(t))
        J = tip_jacobian(motion.chain.lengths, rigid + motion.chain.offset)
        sliding = float(np.tanh(self._tangent @ J @ motion.joint_rate(t) / self._slow))
        on_tip = force * (self._normal - self._friction * sliding * self._tangent)
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
                return angle, rest.torque, rest.q
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
