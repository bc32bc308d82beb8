"""Joint springs and dampers that keep an arm near a motion during the search for its torques.

An arm that falls amplifies every error of a torque exponentially with time, so that no correction
of the torque alone converges. Feedback from the joints prevents this. Joint springs and dampers are
a feedback without sample time, part of the arm's own equations; the last run gives the torque
without them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.linear import modes
from flexarm.motion import Motion
from flexarm.simulation.inversion.correction import CorrectedTorque
from flexarm.simulation.inversion.zero_dynamics import RestEnd

#: Bandwidth, as a fraction of the slowest vibration with locked joints, and damping ratio.
_BANDWIDTH, _DAMPING_RATIO = 0.5, 0.7


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
