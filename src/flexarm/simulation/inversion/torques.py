"""Torques for a given motion: exact ones of the joints, and corrected ones of an inversion.

With the tip constrained, the links can still move: the zero dynamics. For torques at the joints and
a tip at the other end of flexible links it has modes that grow as fast as others decay, so neither
forward nor backward integration in time is stable. Their rates determine how long torques must act
before the tip moves and after it has stopped; (D.10), (D.11)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.base.arguments import check_positive
from flexarm.base.errors import (
    InputError,
    LargeDeflectionWarning,
    Problem,
    public_call,
    without_warnings,
)
from flexarm.base.late import interpolate, linalg
from flexarm.linear import modes
from flexarm.model.quantities import Positive
from flexarm.motion import Motion
from flexarm.motion.dynamics.dynamics_along import (
    MotionTorque,
    RigidTorque,
    driven_of,
    dynamics_along,
)
from flexarm.motion.motion import check_motion
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.run.settings import DEFAULTS, replaced

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm.motion.dynamics.dynamics_along import TipConstraint

#: Samples per radian of the fastest mode; the error of splines of order 6 is then below 1e-6.
_SAMPLES = 2.0
_FEWEST, _MOST = 200, 40_000


@dataclass(frozen=True, eq=False)
class FlexibleTorque(MotionTorque):
    """Torque that makes the joints of a flexible arm follow a motion, as a function of time.

    After ``end`` the torque is constant, and links that still vibrate are not controlled.

    Attributes:
        arm, motion: the arm, and the motion of its joints.
        end: end of the computed torque, s.
        initial: initial q (dof,) at time zero.
    """

    arm: Arm
    motion: Motion
    end: float
    initial: FloatArray
    _splines: tuple[interpolate.BSpline, ...]  # one between each two breaks
    _edges: tuple[float, ...]

    def __repr__(self) -> str:
        return f"<flexarm.FlexibleTorque: {self.joints} joints, up to {self.end:g} s>"

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) at which the torque or one of its derivatives may jump."""
        return self._edges

    def _at(self, times: FloatArray) -> FloatArray:
        flat = np.clip(times, 0.0, self.end)
        torque = np.empty((flat.size, self.joints))
        last = len(self._splines) - 1
        piece = np.clip(np.searchsorted(self._edges, flat, side="right") - 1, 0, last)
        for k, spline in enumerate(self._splines):
            torque[piece == k] = spline(flat[piece == k])
        return torque


@public_call
def flexible_torque(
    arm: Arm,
    motion: Motion,
    duration: float | None = None,
    *,
    initial: ArrayLike | None = None,
    rtol: Positive = 1e-8,
) -> FlexibleTorque:
    """Return the torque that makes the joints of a flexible arm follow a motion exactly.

    Args:
        arm: the arm.
        motion: motion of the joints or of the rigid model's tip; the flexible arm's tip vibrates.
            Of a mechanism with closures one from `joint_motion` with ``driven``: these joints
            follow it exactly, and the others as the flexible links permit.
        duration: s from time zero to the end of the torque; by default to the end of the motion.
        initial: q (dof,) at time zero; straight links by default.
        rtol: error allowed per step of the integration.

    Raises:
        InputError: if an argument has the wrong shape or value.
        SimulationError: if the integration of the links' motion fails.

    With prescribed joints, the equations of the links are integrated forward in time; (D.8).
    """
    motion = check_motion(motion, arm)
    until = check_positive("duration", motion.end_time if duration is None else duration)
    numbers = driven_of(motion) or arm.joint_numbers
    locked = modes(arm, motion.joint_angle(0.0)).frequency_hz
    fastest = 2.0 * np.pi * float(np.max(locked, initial=0.0))
    count = int(np.clip(np.ceil(_SAMPLES * fastest * until), _FEWEST, _MOST))
    with without_warnings(LargeDeflectionWarning):  # the user's run warns
        prescribed = {int(number): motion for number in numbers}
        initial = arm.rest(motion.joint_angle(0.0)) if initial is None else initial
        settings = replaced(DEFAULTS, rate=count / until, rtol=rtol, progress=False)
        result = simulate(arm, until, prescribed=prescribed, initial=initial, settings=settings)
    inner = [t for t in motion.breaks if 0.0 < t < until]
    edges = (0.0, *inner, until)
    samples = result.time.values, result.torque.values
    splines = tuple(_spline(*samples, a, b) for a, b in pairwise(edges))
    return FlexibleTorque(arm, motion, until, result.q.values[0], splines, edges)


def _spline(times: FloatArray, values: FloatArray, a: float, b: float) -> interpolate.BSpline:
    """Interpolate the samples between two breaks, excluding those on the breaks."""
    own = (times > a) & (times < b) if a > 0.0 else times < b
    return interpolate.make_interp_spline(
        times[own], values[own], k=min(5, np.count_nonzero(own) - 1)
    )


#: Eigenvalues with a real part below this fraction of their magnitude are vibrations that neither
#: grow nor decay during a motion: undamped, or lightly damped links. Damping of 0.5 % gives real
#: parts of 0.003 of the magnitude; they would start the torques seconds earlier, without benefit.
_NEUTRAL = 0.1
#: Zeros faster than the fastest vibration by this factor count as infinite. Those that rounding
#: makes finite were at least 20 times as fast, on coarse meshes 1e4 times.
_INFINITE = 10.0
_NEWTON_STEPS = 30


class RestEnd(NamedTuple):
    """Equilibrium at one end of a motion, with the tip in place."""

    q: FloatArray  # (dof,) coordinates; links sag under gravity
    torque: FloatArray  # (joints,) N m in equilibrium
    zeros: NDArray[np.complex128]  # eigenvalues of the zero dynamics, 1/s, slowest first

    @property
    def growth(self) -> float:
        """Slowest growth rate of the zero dynamics, 1/s; infinite if no mode grows."""
        return float(np.min(self._real[self._real > 0.0], initial=np.inf))

    @property
    def decay(self) -> float:
        """Slowest decay rate of the zero dynamics, 1/s; infinite if no mode decays."""
        return float(np.min(-self._real[self._real < 0.0], initial=np.inf))

    @property
    def _real(self) -> FloatArray:
        real = self.zeros.real
        return np.where(np.abs(real) > _NEUTRAL * np.abs(self.zeros), real, 0.0)


def rest_end(constraint: TipConstraint, t: float) -> RestEnd:
    """Compute the equilibrium at a time at which the motion is at rest."""
    arm = constraint.arm
    elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
    q = _rest(constraint, t, elastic)
    still = np.zeros((1, arm.dof))
    along = dynamics_along(arm, q[None], still, still)
    free = linalg.null_space(constraint.misses(np.array([t]), q[None], along)[1][0])
    rows = along.force_by[0, elastic]
    K, D, M = (rows[:, level] @ free for level in range(3))
    squared = linalg.eigh(rows[:, 0, elastic], rows[:, 2, elastic], eigvals_only=True)
    zeros = finite_eigenvalues(M, D, K, float(np.sqrt(squared[-1])))
    return RestEnd(q, along.force[0, arm.joint_index], zeros)


def finite_eigenvalues(
    M: FloatArray, D: FloatArray, K: FloatArray, fastest: float
) -> NDArray[np.complex128]:
    """Return the finite s of det(M s^2 + D s + K) = 0, slowest first; M may be singular.

    If a torque does not act on the tip directly, as through the spring of an elastic joint, M is
    singular and some s are infinite. Rounding makes them finite, but much faster than anything in
    the arm that the matrices describe, which identifies them.
    """
    # Scale time by the fastest vibration, so that the blocks have similar magnitudes.
    none, one = np.zeros_like(M), np.eye(len(M))
    stiffness, damping = K / fastest**2, D / fastest
    left = np.block([[none, one], [-stiffness, -damping]])
    above, below = linalg.eigvals(
        left, np.block([[one, none], [none, M]]), homogeneous_eigvals=True
    )
    finite = np.abs(above) < _INFINITE * np.abs(below)
    values = fastest * above[finite] / below[finite]
    return np.asarray(values[np.argsort(np.abs(values))])


def _rest(constraint: TipConstraint, t: float, elastic: NDArray[np.intp]) -> FloatArray:
    """Solve for equilibrium of the links with the tip in place by Newton's method."""
    arm, motion = constraint.arm, constraint.motion
    q = arm.rest(motion.joint_angle(t))
    still, unit = np.zeros((1, arm.dof)), coordinate_sizes(arm)
    for _ in range(_NEWTON_STEPS):
        along = dynamics_along(arm, q[None], still, still)
        value, by = constraint.misses(np.array([t]), q[None], along)
        missing = np.concatenate([along.force[0, elastic], value[0]])
        matrix = np.concatenate([along.force_by[0, elastic, 0], by[0]])
        step = np.linalg.solve(matrix, -missing)
        q = q + step
        if np.max(np.abs(step / unit)) < 1e-11 * (1.0 + np.max(np.abs(q / unit))):
            return q
    rule = f"has no equilibrium with the tip in place at t = {t:.6g} s"
    raise InputError(Problem("motion", rule))


DEGREE = 3
#: Coefficients at each end that stay fixed, so that value and slope are continuous there.
_HELD = 2
#: Bandwidth, as a fraction of the slowest vibration with locked joints, and damping ratio.
_BANDWIDTH, _DAMPING_RATIO = 0.5, 0.7


@dataclass(frozen=True, eq=False)
class CorrectedTorque(MotionTorque):
    """Rigid torque of a motion plus a cubic spline, as a function of time.

    Attributes:
        rigid: torque of the rigid model.
        knots: (N + 7,) s; each end has three additional knots.
        coefficients: (N + 3, joints) N m; before and after the knots the spline is constant.
    """

    rigid: RigidTorque
    knots: FloatArray
    coefficients: FloatArray

    def __repr__(self) -> str:
        return (
            f"<flexarm.CorrectedTorque: {self.joints} joints, rigid torque and a spline of "
            f"{len(self.coefficients)} coefficients each>"
        )

    @property
    def motion(self) -> Motion:  # type: ignore[override]
        """The reference motion."""
        return self.rigid.motion

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) at which the torque or its slope may jump, and the ends of the spline."""
        return tuple(sorted({*self.rigid.breaks, float(self.knots[0]), float(self.knots[-1])}))

    def _at(self, times: FloatArray) -> FloatArray:
        inside = np.clip(times, self.knots[0], self.knots[-1])
        added: FloatArray = interpolate.BSpline(self.knots, self.coefficients, DEGREE)(inside)
        return self.rigid(times) + added


def spline_knots(start: float, end: float, spacing: float) -> FloatArray:
    """Return evenly spaced knots, with three additional ones at each end."""
    count = max(int(np.ceil((end - start) / spacing)), 2 * _HELD)
    inner = np.linspace(start, end, count + 1)
    return np.concatenate([[start] * DEGREE, inner, [end] * DEGREE])


def spline_values(knots: FloatArray, t: FloatArray) -> FloatArray:
    """Return the values (T, N + 3) of all B-splines at times (T,)."""
    inside = np.clip(t, knots[0], knots[-1])
    return np.asarray(interpolate.BSpline.design_matrix(inside, knots, DEGREE).toarray())


def free_coefficients(knots: FloatArray) -> slice:
    """Return the coefficients that can change without changing value and slope at the ends."""
    return slice(_HELD, len(knots) - DEGREE - 1 - _HELD)


@dataclass(frozen=True, eq=False)
class JointSupport:
    """Feedback ``stiffness (angle - joint_angle) + damping (rate - joint_rate)`` as an arm."""

    bare: Arm  # the arm without them
    motion: Motion  # of the rigid model
    stiffness: FloatArray  # (joints,) N m/rad
    damping: FloatArray  # (joints,) N m s/rad
    #: (2, joints) rad, offset of the joints from the motion in equilibrium at both ends, due to
    #: the sag of the links
    offset: FloatArray
    start: float  # s, interval in which the offset changes from the first to the second
    end: float  # likewise

    @property
    def arm(self) -> Arm:
        """A new arm with springs and dampers beside the motors, which no key of a joint has.

        A spring and the inertia of a rotor are an elastic joint.
        """
        supported = Arm(self.bare.spec)
        constants, motors = supported.assembly.constants, supported.assembly.joint_body
        constants.joint_stiffness[motors] += self.stiffness
        constants.joint_damping[motors] += self.damping
        return supported

    @property
    def rest(self) -> FloatArray:
        """Rest angles (joints,) rad of the springs."""
        angles: FloatArray = self.bare.assembly.constants.joint_rest[self.bare.assembly.joint_body]
        return angles

    def feedback(self, t: FloatArray, angle: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the torque (T, joints) of springs and dampers, N m, at joint angles and rates."""
        u = np.clip((t - self.start) / (self.end - self.start), 0.0, 1.0)[..., None]
        ease = u**3 * (10.0 + u * (-15.0 + 6.0 * u))
        ease_rate = 30.0 * u**2 * (1.0 - u) ** 2 / (self.end - self.start)
        first, last = self.offset
        state = self.motion.state(t)
        desired = state.angle + first + ease * (last - first)
        speed = state.rate + ease_rate * (last - first)
        return np.asarray(self.stiffness * (desired - angle) + self.damping * (speed - rate))


@dataclass(frozen=True, eq=False)
class SupportedTorque:
    """Torque for a supported arm, whose springs and dampers are at rest on the motion."""

    support: JointSupport
    torque: CorrectedTorque
    vectorized: bool = True

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) at which the torque or its slope may jump."""
        return self.torque.breaks

    def __call__(self, t: ArrayLike) -> FloatArray:
        """Return the joint torques (joints,) at a time (s), or (T, joints); N m."""
        support, times = self.support, np.asarray(t, dtype=np.float64)
        moved: FloatArray = support.feedback(times, support.rest, np.zeros_like(support.rest))
        return self.torque(times) + moved


def joint_supports(
    arm: Arm, motion: Motion, ends: tuple[RestEnd, RestEnd], start: float, end: float
) -> Iterator[JointSupport | None]:
    """Yield supports for an arm in the order in which they are tried; None without gravity.

    Elastic joints hold an arm for some time, without feedback, to which open loops are less exact.
    """
    heavy = any(arm.spec.gravity)
    if not heavy or any(joint.elastic for joint in arm.spec.joints):
        yield None
    if heavy:
        yield _joint_support(arm, motion, ends, start, end)


def _joint_support(
    arm: Arm, motion: Motion, ends: tuple[RestEnd, RestEnd], start: float, end: float
) -> JointSupport:
    angles = motion.joint_angle(np.array([motion.start_time, motion.end_time]))
    slowest = 2.0 * np.pi * float(np.min(modes(arm, angles[0], joints="locked").frequency_hz))
    rigid = arm.rigid()
    inertia = np.max([np.diag(rigid.mass_matrix(rigid.rest(a))) for a in angles], axis=0)
    bandwidth = _BANDWIDTH * slowest
    stiffness, damping = inertia * bandwidth**2, 2.0 * _DAMPING_RATIO * inertia * bandwidth
    sag = np.stack([rest.q[arm.joint_index] for rest in ends]) - angles
    return JointSupport(arm, motion, stiffness, damping, sag, start, end)
