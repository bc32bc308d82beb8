"""Torques of an inversion: splines that are corrected, and joint springs that support the arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.linear import modes
from flexarm.motion import Motion
from flexarm.motion.dynamics.dynamics_along import RigidTorque
from flexarm.simulation.inversion.zero_dynamics import RestEnd

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexarm.motion.motion import Motion

    Floats = NDArray[np.float64]

DEGREE = 3
#: Coefficients at each end that stay fixed, so that value and slope are continuous there.
_HELD = 2
#: Bandwidth, as a fraction of the slowest vibration with locked joints, and damping ratio.
_BANDWIDTH, _DAMPING_RATIO = 0.5, 0.7


@dataclass(frozen=True, eq=False)
class CorrectedTorque:
    """Rigid torque of a motion plus a cubic spline, as a function of time.

    Attributes:
        rigid: torque of the rigid model.
        knots: (N + 7,) s; each end has three additional knots.
        coefficients: (N + 3, joints) N m; before and after the knots the spline is constant.
    """

    #: Whether the torque accepts an array of times, for ``simulate``.
    vectorized: ClassVar[bool] = True

    rigid: RigidTorque
    knots: Floats
    coefficients: Floats

    def __repr__(self) -> str:
        return (
            f"<flexarm.CorrectedTorque: {self.joints} joints, rigid torque and a spline of "
            f"{len(self.coefficients)} coefficients each>"
        )

    @property
    def motion(self) -> Motion:
        """The reference motion."""
        return self.rigid.motion

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.rigid.joints

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) at which the torque or its slope may jump, and the ends of the spline."""
        return tuple(sorted({*self.rigid.breaks, float(self.knots[0]), float(self.knots[-1])}))

    def __call__(self, t: ArrayLike) -> Floats:
        """Return the joint torques (n,) at a time (s), or (T, n) at times (T,); N m."""
        from scipy.interpolate import BSpline

        inside = np.clip(np.asarray(t, dtype=np.float64), self.knots[0], self.knots[-1])
        added: Floats = BSpline(self.knots, self.coefficients, DEGREE)(inside)
        return self.rigid(t) + added


def spline_knots(start: float, end: float, spacing: float) -> Floats:
    """Return evenly spaced knots, with three additional ones at each end."""
    count = max(int(np.ceil((end - start) / spacing)), 2 * _HELD)
    inner = np.linspace(start, end, count + 1)
    return np.concatenate([[start] * DEGREE, inner, [end] * DEGREE])


def spline_values(knots: Floats, t: Floats) -> Floats:
    """Return the values (T, N + 3) of all B-splines at times (T,)."""
    from scipy.interpolate import BSpline

    inside = np.clip(t, knots[0], knots[-1])
    values: Floats = BSpline.design_matrix(inside, knots, DEGREE).toarray()
    return values


def free_coefficients(knots: Floats) -> slice:
    """Return the coefficients that can change without changing value and slope at the ends."""
    return slice(_HELD, len(knots) - DEGREE - 1 - _HELD)


@dataclass(frozen=True, eq=False)
class JointSupport:
    """Feedback ``stiffness (angle - joint_angle) + damping (rate - joint_rate)`` as an arm.

    Attributes:
        arm: the arm with the springs and dampers.
        motion: of the rigid model.
        stiffness, damping: (joints,) N m/rad and N m s/rad.
        rest: (joints,) rad, rest angles of the springs.
        offset: (2, joints) rad, offset of the joints from the motion in equilibrium at both ends,
            due to the sag of the links.
        start, end: s, interval in which the offset changes from the first to the second.
    """

    arm: Arm
    motion: Motion
    stiffness: FloatArray
    damping: FloatArray
    rest: FloatArray
    offset: FloatArray
    start: float
    end: float

    def _desired(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the reference angles and rates (..., joints) of the feedback."""
        u = np.clip((t - self.start) / (self.end - self.start), 0.0, 1.0)[..., None]
        ease = u**3 * (10.0 + u * (-15.0 + 6.0 * u))
        ease_rate = 30.0 * u**2 * (1.0 - u) ** 2 / (self.end - self.start)
        first, last = self.offset
        state = self.motion.state(t)
        angle = state.angle + first + ease * (last - first)
        return angle, state.rate + ease_rate * (last - first)

    def feedback(self, t: FloatArray, angle: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the torque (T, joints) of springs and dampers, N m, at joint angles and rates."""
        desired, speed = self._desired(t)
        torque: FloatArray = self.stiffness * (desired - angle) + self.damping * (speed - rate)
        return torque


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


def joint_support(
    arm: Arm, motion: Motion, ends: tuple[RestEnd, RestEnd], start: float, end: float
) -> JointSupport | None:
    """Return a support for an arm under gravity; None without gravity or with elastic joints.

    The springs of elastic joints act between motor and link, so they cannot act beside the motor.
    """
    turning = [arm.spec.joints[seat.link] for seat in arm.assembly.seats]
    if not any(arm.spec.gravity) or any(joint.elastic for joint in turning):
        return None
    angles = motion.joint_angle(np.array([motion.start_time, motion.end_time]))
    slowest = 2.0 * np.pi * float(np.min(modes(arm, angles[0], joints="locked").frequency_hz))
    rigid = arm.rigid()
    inertia = np.max([np.diag(rigid.mass_matrix(rigid.rest(a))) for a in angles], axis=0)
    bandwidth = _BANDWIDTH * slowest
    stiffness, damping = inertia * bandwidth**2, 2.0 * _DAMPING_RATIO * inertia * bandwidth
    joints = list(arm.spec.joints)
    for seat, k, c in zip(arm.assembly.seats, stiffness, damping, strict=True):
        joint = joints[seat.link]
        changed = {"stiffness": joint.stiffness + float(k), "damping": joint.damping + float(c)}
        joints[seat.link] = joint.replace(**changed)
    return JointSupport(
        Arm(arm.spec.replace(joints=joints)),
        motion,
        stiffness,
        damping,
        np.array([joint.rest_angle for joint in turning]),
        np.stack([rest.q[arm.joint_index] for rest in ends]) - angles,
        start,
        end,
    )
