"""Quasi-static reference: links bend statically under inertia and gravity, tip on its path.

Theory page "position control", (C.13) to (C.15).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.arm.bending import warn_of_bending
from flexarm.base.arguments import check_count, check_kind, check_positive, check_times
from flexarm.base.errors import (
    AccuracyWarning,
    InputError,
    Problem,
    SimulationError,
    public_call,
    warn_caller,
)
from flexarm.linear.vibration.modal import modes
from flexarm.motion.dynamics.dynamics_along import TipConstraint, dynamics_along
from flexarm.motion.motion import DerivedMotion, JointState, Motion, check_motion
from flexarm.motion.shaping import window_points

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

#: Number of instants between two breaks at which the bending of the links is computed.
_INSTANTS = 161
_NEWTON_STEPS = 12
#: Gauss points between two breaks of the bending, and number of times averaged in one batch.
_POINTS, _CHUNK = 32, 512
#: Amplitudes of the cosines in the window (C.15) for each order. The second one has no second
#: moment: the average of a parabola is its value in the middle.
_FLAT = (2.0 * np.pi**2 / 3.0 - 1.0) / 3.0
_WINDOWS = {1: (1.0,), 2: (_FLAT, _FLAT - 1.0)}
#: Breaks that rounding separates are one: relative to the duration.
_APART = 1e-9
#: Largest change of the bending by the second order, of that of the first, without a warning.
_SMALL = 0.2
#: Default averaging window as a fraction of the slowest period.
_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class QuasiStaticReference(DerivedMotion):
    """Joint angles that keep the tip of a flexible arm on a motion, and the torques for them.

    The bending at each instant is the static response to inertia and gravity, without vibration.

    Attributes:
        motion: motion of the rigid arm, which the tip follows.
        arm: the flexible arm.
        smoothing: s, window over which the bending is averaged, centred at each instant.
        order: 1, or 2 if the accelerations of the bending bend the links, too.
    """

    arm: Arm = field(repr=False)
    smoothing: float
    order: int
    _moving: Motion = field(repr=False)  # its rates and accelerations bend the links
    _window: tuple[float, ...] = field(repr=False)
    _bends: tuple[BSpline, ...] = field(repr=False)  # before, between two breaks each, after

    def _times(self) -> tuple[float, float]:
        start = self._moving.start_time - 0.5 * self.smoothing
        return start, self._moving.duration + self.smoothing

    @property
    def breaks(self) -> tuple[float, ...]:
        """Breaks of the motion, and the times at which they enter and leave the window, s."""
        own, half = self._moving.breaks, 0.5 * self.smoothing
        inner = {t + d for t in own for d in (-half, 0.0, half)}
        every = [self.start_time]
        for t in sorted(t for t in inner if self.start_time < t < self.end_time):
            if min(t - every[-1], self.end_time - t) > _APART * self.duration:
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
        """See `Motion.at`."""
        return JointState(*(part[:, self.arm.joint_index] for part in self.coordinates(times)))

    @public_call
    def coordinates(self, times: FloatArray) -> list[FloatArray]:
        """Return q, qd and qdd of the bent arm, (T, dof) each, at times (T,)."""
        times = check_times("times", times).reshape(-1)
        parts = [self._averages(times[k : k + _CHUNK]) for k in range(0, len(times), _CHUNK)]
        if not parts:
            return [np.zeros((0, self.arm.dof))] * 3
        whole = [np.concatenate(part) for part in zip(*parts, strict=True)]
        for array, rigid in zip(whole, self.motion.at(times), strict=True):
            array[:, self.arm.joint_index] += rigid
        return whole

    def _averages(self, times: FloatArray) -> list[FloatArray]:
        """Return the averaged bending and its two derivatives, those of the window; (C.15)."""
        half = 0.5 * self.smoothing
        ages, shares = window_points(times, self._moving.breaks, (-half, half), _POINTS)
        bent = self._bent(times[:, None] - ages)
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
        return [np.einsum("tk,tkd->td", shares * window, bent) for window in windows]

    def _bent(self, times: FloatArray) -> FloatArray:
        """Return the unaveraged corrections of the rigid q, (T, k, dof), at times (T, k)."""
        breaks = np.array(self._moving.breaks)
        inside = np.clip(times, breaks[0], breaks[-1])
        piece = np.searchsorted(breaks, times, side="right")
        bent = np.empty((*times.shape, self.arm.dof))
        for k in np.unique(piece):
            bent[piece == k] = self._bends[k](inside[piece == k])
        return bent


@dataclass(frozen=True, eq=False)
class QuasiStaticTorque:
    """Torque of the bent arm along a quasi-static reference; callable with the time."""

    #: Whether the torque accepts an array of times, for ``simulate``.
    vectorized: ClassVar[bool] = True

    motion: QuasiStaticReference

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) where the torque or a derivative of it may jump."""
        return self.motion.breaks

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.motion.joints

    @public_call
    def __call__(self, t: ArrayLike) -> FloatArray:
        """Return the joint torques (n,) at a time (s), or (T, n) at times (T,); N m."""
        times = check_times("t", t)
        arm = self.motion.arm
        force = arm.inverse_dynamics_many(*self.motion.coordinates(times.reshape(-1)))
        return force[:, arm.joint_index].reshape(*times.shape, self.joints)


@public_call
def quasi_static_reference(
    arm: Arm, motion: Motion, *, smoothing: float | None = None, order: int = 1
) -> QuasiStaticReference:
    """Compute joint angles and torques that keep the tip of a flexible arm on a motion.

    The links bend statically under inertia and gravity: their vibration is neglected. Order 1
    neglects that the bending is itself accelerated. Order 2 includes this acceleration, with the
    bending of order 1: the integral manifold of second order, to which smooth motions are closer.

    Args:
        arm: the arm, with links that bend.
        motion: motion of the rigid arm from rest to rest, whose tip is followed. With three joints
            or more, all joints except the two that move the tip best follow the motion. With a
            single link, the tip keeps the direction of the rigid link.
        smoothing: s, window over which the bending is averaged, by default a quarter of the slowest
            period with locked joints. Averaging is necessary because bending follows the
            accelerations, which may have jumps or corners. The reference starts half a window
            before the motion and ends half a window after it, for order 2 a whole window.
        order: 1 or 2.

    Raises:
        InputError: if ``motion`` is not a motion of this arm, the arm is rigid, the joints cannot
            move the tip in every direction somewhere along the motion, the window is not positive,
            or the order is neither 1 nor 2.
        SimulationError: if Newton's method does not converge.

    (C.13) to (C.15). These are the first terms of the solution that `tip_inversion` computes in
    full, at a small fraction of the cost.

    References:
        M. W. Spong, K. Khorasani and P. V. Kokotovic, IEEE J. Robotics and Automation 3 (1987)
        291-300: integral manifolds of elastic joints.
        M. Moallem, K. Khorasani and R. V. Patel, IEEE Trans. Robotics and Automation 13 (1997)
        823-837: of elastic links, and the position of the tip.
    """
    order = check_count("order", order, most=2)
    arm = check_kind("arm", arm, Arm)
    motion = check_motion(motion, arm)
    if arm.dof == arm.joints:
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
    pieces = [_piece(constraint, moving, a, b) for a, b in pairwise(moving.breaks)]
    span = moving.end_time - moving.start_time
    ends = (moving.start_time - span, moving.end_time + span)
    before, after = (_rest(constraint, moving, t) for t in ends)
    bends = (before, *pieces, after)
    fields = (window, order, moving, _WINDOWS[order], bends)
    return QuasiStaticReference(constraint.motion, constraint.arm, *fields)


def _piece(constraint: TipConstraint, moving: Motion, a: float, b: float) -> BSpline:
    from scipy.interpolate import make_interp_spline

    # Chebyshev-Lobatto spacing is dense at the ends, where the bending changes abruptly.
    times = a + (b - a) * 0.5 * (1.0 - np.cos(np.pi * np.linspace(0.0, 1.0, _INSTANTS)))
    times[0], times[-1] = a, np.nextafter(b, -np.inf)
    return make_interp_spline(times, _bending(constraint, moving, times), k=5)


def _rest(constraint: TipConstraint, moving: Motion, t: float) -> BSpline:
    from scipy.interpolate import BSpline

    value = _bending(constraint, moving, np.array([t]))
    return BSpline(np.array([t, t + 1.0]), value, 0, extrapolate=True)


def _bending(constraint: TipConstraint, moving: Motion, times: FloatArray) -> FloatArray:
    """Solve (C.13) by Newton's method at each instant; return the corrections of q, (T, dof).

    Rates and accelerations are those of ``moving``, which is rigid or already bent.
    """
    arm, motion = constraint.arm, constraint.motion
    elastic: NDArray[np.intp] = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
    rigid = np.zeros((3, times.size, arm.dof))
    rigid[:, :, arm.joint_index] = np.stack(motion.at(times))
    _, qd, qdd = rigid if moving is motion else moving.coordinates(times)  # type: ignore[attr-defined]
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
    worst = float(times[int(np.argmax(np.nan_to_num(size, nan=np.inf)))])
    reason = "links bend too far for a quasi-static reference."
    raise SimulationError(worst, reason, "Move more slowly, or make the links stiffer.")
