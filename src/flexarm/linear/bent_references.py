"""References of the bent arm: quasi-static ones, and references that press on a surface.

Quasi-static: links bend statically under inertia and gravity, with the tip on its path; theory page
"position control", (C.13) to (C.15).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.arm.bending import one_warning, warn_of_bending
from flexarm.base.arguments import (
    check_count,
    check_direction,
    check_function,
    check_nonnegative,
    check_positive,
    check_times,
)
from flexarm.base.errors import (
    AccuracyWarning,
    InputError,
    Problem,
    SimulationError,
    public_call,
    warn_caller,
)
from flexarm.base.late import interpolate
from flexarm.base.user_functions import call
from flexarm.linear.statics.equilibrium import equilibrium, equilibrium_near
from flexarm.linear.tables import evaluated, tabulated
from flexarm.linear.vibration.modal import lowest_frequency, modes
from flexarm.model.quantities import NonNegative, Positive
from flexarm.motion.dynamics.dynamics_along import MotionTorque, TipConstraint, dynamics_along
from flexarm.motion.geometry.inverse_kinematics import tip_jacobian
from flexarm.motion.motion import DerivedMotion, JointState, Motion, check_motion
from flexarm.motion.shaping import window_points

T = TypeVar("T")

#: Tolerance of the tip position relative to the length of the arm, and most corrections.
_CLOSE, _CORRECTIONS = 1e-9, 60
_FEWEST_SAMPLES, _MOST_SAMPLES = 8, 4000
#: Intervals in a period of the lowest frequency, and their limits, by default. A rigid arm has no
#: period.
_PER_PERIOD, _FEWEST, _MOST, _RIGID = 20, 64, 1200, 256
#: Additional coefficient of friction of ``PressedMotion.rougher``.
_MORE_FRICTION = 0.1
#: Friction changes sign smoothly below this fraction of the largest sliding speed, because a jump
#: would excite vibration.
_SLOW = 0.2
#: Largest part of the path along the normal under a force, and number of instants to find it.
#: Shaped motions deviate from their path, and the force may begin before the path arrives.
_MOST_ACROSS, _PATH_INSTANTS = 0.5, 201
#: Speed below which the path is at rest for its curvature, relative to the largest.
_STILL = 1e-3


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
        with one_warning(report=False):
            held = search.along(times, force, normal)
        angle, torque, pressing, self._bent = map(np.array, zip(*held, strict=True))
        self._given = (arm, motion, force, normal, times)
        self.motion, self.friction = motion, friction
        self.start_time, self.end_time = motion.start_time, motion.end_time
        self.breaks = motion.breaks
        self.initial = self._bent[0]
        self._force, self._normal = force, normal
        self._first, self._last = float(times[0]), float(times[-1])
        self._angle = _spline(times, angle)
        self._rate, self._acceleration = self._angle.derivative(1), self._angle.derivative(2)
        self._holding = _spline(times, torque)
        self._pressing = _spline(times, pressing)

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

    @cached_property
    def _curved(self) -> tuple[FloatArray, FloatArray]:
        """Return times (T,) s at which the path moves, and the curvatures there."""
        times = np.linspace(self.start_time, self.end_time, _PATH_INSTANTS)
        normals = np.array([self._normal(t) for t in times.tolist()])
        middle = 0.5 * (normals[1:] + normals[:-1])
        tangent = np.column_stack([-middle[:, 1], middle[:, 0]])
        turned = np.sum(np.diff(normals, axis=0) * tangent, axis=1)
        moved = np.sum(np.diff(self.motion.tip(times), axis=0) * tangent, axis=1)
        moving = np.abs(moved) > _STILL * np.abs(moved).max()
        if not moving.any():
            return times[:1], np.zeros(1)
        return 0.5 * (times[1:] + times[:-1])[moving], turned[moving] / moved[moving]

    @public_call
    def curvature(self, t: ArrayLike) -> FloatArray:
        """Return the curvature () or (T,) of the surface near t, 1/m: positive if it is convex."""
        return np.asarray(np.interp(check_times("t", t), *self._curved))


def _spline(times: FloatArray, values: FloatArray) -> interpolate.BSpline:
    return interpolate.make_interp_spline(times, values, k=5)


@public_call
def pressed_motion(
    arm: Arm,
    motion: Motion,
    force: float | Callable[[float], float],
    normal: ArrayLike | Callable[[float], ArrayLike],
    *,
    duration: float | None = None,
    friction: NonNegative = 0.0,
    interval: Positive | None = None,
) -> PressedMotion:
    """Compute a reference for a tip that presses on a surface along a motion.

    Args:
        arm: flexible or rigid; its deflection under the force and gravity is included.
        motion: motion of the rigid arm whose tip path is on the surface.
        force: N, at least 0, or a smooth function of time (s) that returns it.
        normal: (2,) outward normal of the surface on the path, world axes, any length; or a
            function of time that returns it, for a surface that is not straight.
        duration: s, of the whole run; by default until the end of the motion. After it the
            reference is at rest and presses on with its last force and normal.
        friction: coefficient of sliding friction at the tip.
        interval: s between the times at which the equilibrium is computed; force and path must be
            smooth over several intervals. By default a twentieth of the lowest period of the
            straight arm with locked joints, but 64 to 1200 intervals, and 256 for a rigid arm.

    Raises:
        InputError: if a force is negative or not finite, a normal is zero, ``friction`` is
            negative, the motion is for another arm, the bent arm cannot reach the path, or the
            path moves along the normal by more than half of its length while the force is not zero.
        SimulationError: if a function of time raises an exception.
    """
    motion = check_motion(motion, arm)
    end = check_positive("duration", motion.end_time if duration is None else duration)
    if interval is not None:
        count = min(max(int(np.ceil(end / interval)) + 1, _FEWEST_SAMPLES), _MOST_SAMPLES)
    elif np.isfinite(rate := lowest_frequency(arm)):
        count = 1 + int(np.clip(np.ceil(_PER_PERIOD * end * rate / (2.0 * np.pi)), _FEWEST, _MOST))
    else:
        count = 1 + _RIGID
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
    times = np.linspace(0.0, end, _PATH_INSTANTS)
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
        times = np.linspace(motion.start_time, motion.end_time, _PATH_INSTANTS)
        fastest = float(np.hypot(*np.gradient(motion.tip(times), times, axis=0).T).max())
        self._slow = _SLOW * fastest or 1.0  # without motion the speed is zero
        self._close = _CLOSE * arm.reach
        self._q: FloatArray | None = None
        self._beside = np.zeros(arm.n_joints)
        self._drift = np.zeros(arm.n_joints)  # its change between two times

    def along(
        self,
        times: FloatArray,
        force: Callable[[float], float],
        normal: Callable[[float], FloatArray],
    ) -> list[tuple[FloatArray, ...]]:
        """Return the equilibrium at each time (s) under a force (N) along a normal (2,).

        Joint angles (joints,) rad, the torques in equilibrium and minus those of the rigid model
        (joints,) N m, and q (dof,).
        """
        motion, equilibria = self._motion, []
        angles, rates, _ = motion.state(times)
        for t, rigid, rate, desired in zip(
            times.tolist(), angles, rates, motion.tip(times), strict=True
        ):
            outward = normal(t)
            tangent = np.array([-outward[1], outward[0]])
            J = tip_jacobian(motion.chain.lengths, rigid + motion.chain.offset)
            sliding = float(np.tanh(tangent @ J @ rate / self._slow))
            on_tip = force(t) * (outward - self._friction * sliding * tangent)
            equilibria.append(self._at(t, rigid, desired, on_tip))
        return equilibria

    def _at(
        self, t: float, rigid: FloatArray, desired: FloatArray, on_tip: FloatArray
    ) -> tuple[FloatArray, ...]:
        """Return the equilibrium with the tip where it is desired (2,) under a force (2,)."""
        arm, motion = self._arm, self._motion
        angle = rigid + self._beside + self._drift
        J = tip_jacobian(motion.chain.lengths, angle + motion.chain.offset)
        way = np.asarray(np.linalg.pinv(J, rcond=1e-6), dtype=np.float64)
        step, before = np.zeros(arm.n_joints), np.zeros(2)
        for _ in range(_CORRECTIONS):
            if self._q is None:
                self._q = equilibrium(arm, angle, tip_force=on_tip).q
            else:
                start = self._q.copy()
                start[arm.joint_index] = angle
                self._q = equilibrium_near(arm, start, on_tip)
            missed = arm.tip(self._q)[:2] - desired
            if np.hypot(*missed) < self._close:
                rest = equilibrium(arm, tip_force=on_tip, start=self._q)
                self._drift = angle - rigid - self._beside
                self._beside = angle - rigid
                model = self._rigid
                bias = model.bias_force(model.rest(angle), np.zeros(model.dof))
                pressing = rest.torque - bias[model.joint_index]
                return angle, rest.torque, pressing, rest.q
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


#: Number of instants at which warnings look for the largest bending.
_INSTANTS = 161
#: Most steps, and motion of the tip by the joints over the largest of a nearly straight arm.
_NEWTON_STEPS, _STRAIGHT = 12, 0.1
#: Gauss points between two breaks of the bending.
_POINTS = 32
#: Amplitudes of the cosines in the window (C.15) for each order. The second one has no second
#: moment: the average of a parabola is its value in the middle.
_FLAT = (2.0 * np.pi**2 / 3.0 - 1.0) / 3.0
_WINDOWS = {0: (1.0,), 1: (1.0,), 2: (_FLAT, _FLAT - 1.0)}
#: Breaks that rounding separates are one: relative to the duration, or to their times if larger.
_APART = 1e-9
#: Largest change of the bending by the second order, of that of the first, without a warning.
_SMALL = 0.2
#: Default averaging window as a fraction of the slowest period.
_SHARE = 0.25


@dataclass(frozen=True, eq=False, repr=False)
class QuasiStaticReference(DerivedMotion):
    """Joint angles that keep the tip of a flexible arm on a motion, and the torques for them.

    The bending at each instant is the static response to inertia and gravity, without vibration.

    Attributes:
        motion: motion of the rigid arm, which the tip follows.
        arm: the flexible arm.
        smoothing: s, window over which the bending is averaged, centred at each instant.
        order: 0 if gravity alone bends the links, 1 if inertia does, too, or 2 if the accelerations
            of the bending do, too.
    """

    arm: Arm
    smoothing: float
    order: int
    _moving: Motion  # its rates and accelerations bend the links
    _window: tuple[float, ...]
    _bends: tuple[interpolate.BSpline, ...]  # before, between two breaks each, after

    def _times(self) -> tuple[float, float]:
        start = self._moving.start_time - 0.5 * self.smoothing
        return start, self._moving.duration + self.smoothing

    @property
    def breaks(self) -> tuple[float, ...]:
        """Breaks of the motion, and the times at which they enter and leave the window, s."""
        own, half = self._moving.breaks, 0.5 * self.smoothing
        inner = {t + d for t in own for d in (-half, 0.0, half)}
        every = [self.start_time]
        apart = _APART * max(self.duration, abs(self.start_time), abs(self.end_time))
        for t in sorted(t for t in inner if self.start_time < t < self.end_time):
            if min(t - every[-1], self.end_time - t) > apart:
                every.append(t)
        return (*every, self.end_time)

    @cached_property
    def initial(self) -> FloatArray:
        """Coordinates q (dof,) before the start."""
        return np.asarray(self.coordinates(np.array([-np.inf]))[0][0])

    @property
    def torque(self) -> QuasiStaticTorque:
        """Joint torques (joints,) N m of the bent arm along this reference, as a function of time.

        See (C.14).
        """
        return QuasiStaticTorque(self)

    def tip(self, t: ArrayLike) -> FloatArray:
        """Return the prescribed position of the tip, (2,) or (T, 2), world axes, m."""
        return self.motion.tip(t)

    def at(self, times: FloatArray) -> JointState:
        return JointState(*(part[:, self.arm.joint_index] for part in self.coordinates(times)))

    @public_call
    def coordinates(self, times: FloatArray) -> list[FloatArray]:
        """Return q, qd and qdd of the bent arm, (T, dof) each, at times (T,)."""
        times = check_times("times", times).reshape(-1)
        parts = evaluated(self._averaged, np.array(self.breaks), times)
        whole = list(parts.reshape(len(times), 3, self.arm.dof).swapaxes(0, 1))
        for array, rigid in zip(whole, self.motion.at(times), strict=True):
            array[:, self.arm.joint_index] += rigid
        return whole

    @cached_property
    def _averaged(self) -> list[interpolate.BSpline]:
        """Averages (3 dof,) of ``_averages``: before, between two breaks each, after."""
        turn = 2.0 * np.pi / self.smoothing
        sizes = np.outer((1.0, turn, turn**2), coordinate_sizes(self.arm)).reshape(-1)
        return tabulated(self.breaks, self._averages, sizes)

    def _averages(self, times: FloatArray) -> FloatArray:
        """Return the averaged bending and its two derivatives (T, 3 dof); (C.15)."""
        half = 0.5 * self.smoothing
        ages, shares = window_points(times, self._moving.breaks, (-half, half), _POINTS)
        counted = np.any(shares > 0.0, axis=0)  # no weight between breaks outside the window
        ages, shares = ages[:, counted], shares[:, counted]
        bent = evaluated(self._bends, np.array(self._moving.breaks), times[:, None] - ages)
        turn = 2.0 * np.pi / self.smoothing
        moving = (times >= self.start_time) & (times < self.end_time)
        windows = np.zeros((3, *ages.shape))
        windows[0] = 1.0
        for k, part in enumerate(self._window, start=1):
            w = k * turn
            windows[0] += part * np.cos(w * ages)
            windows[1] -= part * w * np.sin(w * ages)
            windows[2] -= part * w**2 * np.cos(w * ages)
        windows[1:] *= moving[:, None]
        averages = np.einsum("wtk,tk,tkd->twd", windows, shares, bent)
        return np.asarray(averages.reshape(len(times), -1))


@dataclass(frozen=True, eq=False)
class QuasiStaticTorque(MotionTorque):
    """Torque of the bent arm along a quasi-static reference; callable with the time."""

    motion: QuasiStaticReference

    def _at(self, times: FloatArray) -> FloatArray:
        arm = self.motion.arm
        force = arm.inverse_dynamics_many(*self.motion.coordinates(times))
        return np.asarray(force[:, arm.joint_index])


@public_call
def quasi_static_reference(
    arm: Arm, motion: Motion, *, smoothing: float | None = None, order: int = 1
) -> QuasiStaticReference:
    """Compute joint angles and torques that keep the tip of a flexible arm on a motion.

    The links bend statically under inertia and gravity: their vibration is neglected. Order 1
    neglects that the bending is itself accelerated. Order 2 includes this acceleration, with the
    bending of order 1: the integral manifold of second order, to which smooth motions are closer.
    Order 0 is the bending at rest, under gravity alone, for controllers that compensate the effect
    of inertia themselves, such as LQG.

    Args:
        arm: the arm, with links that bend.
        motion: motion of the rigid arm from rest to rest, whose tip is followed. With three joints
            or more, all joints except the two that move the tip best follow the motion. With a
            single link, the tip keeps the direction of the rigid link.
        smoothing: s, window over which the bending is averaged, by default a quarter of the slowest
            period with locked joints. Averaging is necessary because bending follows the
            accelerations, which may have jumps or corners. The reference starts half a window
            before the motion and ends half a window after it, for order 2 a whole window.
        order: 0, 1 or 2.

    Raises:
        InputError: if ``motion`` is not a motion of this arm, the arm is rigid, the joints cannot
            move the tip in every direction somewhere along the motion, the window is not positive,
            or the order is not one of these.
        SimulationError: if Newton's method does not converge.

    (C.13) to (C.15). These are the first terms of the solution that `tip_inversion` computes in
    full, at a small fraction of the cost.

    References:
        M. W. Spong, K. Khorasani and P. V. Kokotovic, IEEE J. Robotics and Automation 3 (1987)
        291-300: integral manifolds of elastic joints.
        M. Moallem, K. Khorasani and R. V. Patel, IEEE Trans. Robotics and Automation 13 (1997)
        823-837: of elastic links, and the position of the tip.
    """
    order = check_count("order", order, 0, 2)
    motion = check_motion(motion, arm)
    if arm.dof == arm.n_joints:
        raise InputError(Problem("arm", "is rigid"))
    constraint = TipConstraint(arm, motion)
    constraint.check()
    if smoothing is None:
        slowest = modes(arm, motion.joint_angle(motion.start_time)).frequency_hz
        window = _SHARE / float(slowest[slowest > 0.0].min())
    else:
        window = check_positive("smoothing", smoothing, "s")
    reference = _bent_by(motion, constraint, window, order)
    times = np.linspace(motion.start_time - window, motion.end_time + window, _INSTANTS)
    if order == 2:
        first, reference = reference, _bent_by(reference, constraint, window, order)
        _warn_of_growth(motion, first, reference, times)
    warn_of_bending(arm, reference.coordinates(times)[0])
    return reference


def _warn_of_growth(
    motion: Motion, first: QuasiStaticReference, second: QuasiStaticReference, times: FloatArray
) -> None:
    """Warn if the second correction is not small compared with the first: a divergent series."""
    q, bent = first.coordinates(times)[0], second.coordinates(times)[0]
    joints = first.arm.joint_index
    change = np.abs(bent - q).max()
    q[:, joints] -= motion.at(times)[0]
    if change > _SMALL * np.abs(q - q[0]).max():
        warn_caller(
            "the second order changes the bending of the first by more than "
            f"{100 * _SMALL:.0f} %: the motion is too fast for order 2, which may be less accurate "
            "than order 1. Use tip_inversion, or move more slowly.",
            AccuracyWarning,
        )


def _bent_by(
    moving: Motion, constraint: TipConstraint, window: float, order: int
) -> QuasiStaticReference:
    """Return the reference whose links bend under the rates and accelerations of a motion."""
    bending = partial(_bending, constraint, moving, order == 0)
    sizes = coordinate_sizes(constraint.arm)
    bends = tuple(tabulated(moving.breaks, bending, sizes))
    fields = (window, order, moving, _WINDOWS[order], bends)
    return QuasiStaticReference(constraint.motion, constraint.arm, *fields)


def _bending(
    constraint: TipConstraint, moving: Motion, at_rest: bool, times: FloatArray
) -> FloatArray:
    """Solve (C.13) by Newton's method at each instant; return the corrections of q, (T, dof).

    Rates and accelerations are zero, or those of ``moving``, which is rigid or already bent.
    """
    arm, motion = constraint.arm, constraint.motion
    elastic: NDArray[np.intp] = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
    rigid = np.zeros((3, times.size, arm.dof))
    rigid[:, :, arm.joint_index] = np.stack(motion.at(times))
    _, qd, qdd = rigid if moving is motion else moving.coordinates(times)  # type: ignore[attr-defined]
    if at_rest:
        qd, qdd = np.zeros((2, *qd.shape))
    added, unit = np.zeros((times.size, arm.dof)), coordinate_sizes(arm)
    for _ in range(_NEWTON_STEPS):
        q = rigid[0] + added
        along = dynamics_along(arm, q, qd, qdd)
        value, by = constraint.misses(times, q, along)
        missing = np.concatenate([along.force[:, elastic], value], axis=1)
        matrix = np.concatenate([along.force_by[:, elastic, 0], by], axis=1)
        step = np.linalg.solve(matrix, missing[:, :, None])[:, :, 0]
        added -= step
        size = np.abs(step / unit).max(axis=1)
        if not np.all(np.isfinite(size)):
            break
        if size.max() <= 1e-11 * (1.0 + np.abs(added / unit).max()):
            return added
    worst = int(np.argmax(np.nan_to_num(size, nan=np.inf)))
    _, by = constraint.misses(times, rigid[0], dynamics_along(arm, rigid[0], qd, qdd))
    moved = np.linalg.svd(by[worst][:, arm.joint_index], compute_uv=False)
    reason, hint = "links bend too far.", "Move more slowly, or make the links stiffer."
    if moved[-1] < _STRAIGHT * moved[0]:
        reason, hint = "a nearly straight arm cannot compensate bending.", "Avoid this posture."
    raise SimulationError(float(times[worst]), reason, hint)
