"""Dynamics and tip along a motion, rigid torques, and constraints that keep the tip on a path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.base.arguments import check_times
from flexarm.base.errors import InputError, Problem, public_call
from flexarm.kernels.derivatives.inverse_sensitivity import inverse_jacobian_many
from flexarm.model.arm.spec import UNDRIVEN, serial_only
from flexarm.motion.geometry.inverse_kinematics import check_arm, tip_jacobian
from flexarm.motion.motion import Floats, Motion, check_motion

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexarm.arm.arm import Arm


class DynamicsAlong(NamedTuple):
    """Forces and tip motions at T instants, with their derivatives, exact to rounding.

    The axis of length 3 holds derivatives by q, qd and qdd.
    """

    force: Floats  # (T, dof) M qdd + bias
    tip: Floats  # (T, 6) x, y m, their rates m/s and accelerations m/s^2, world axes
    force_by: Floats  # (T, dof, 3, dof)
    tip_by: Floats  # (T, 6, 3, dof)


def dynamics_along(arm: Arm, q: Floats, qd: Floats, qdd: Floats) -> DynamicsAlong:
    """Evaluate inverse dynamics and tip motion along q, qd, qdd, each (T, dof)."""
    kernels, kept = KernelView(arm.assembly.constants, complex), arm.assembly.coordinates
    count, (n, width) = len(q), kernels.shape
    forces, tips = np.zeros((count, n, width)), np.zeros((count, 6))
    force_by = np.zeros((count, 3, n, width, n, width))
    tip_by = np.zeros((count, 3, n, width, 6))
    motion = arm.padded(np.stack([q, qd], axis=1)).astype(complex), arm.padded(qdd).astype(complex)
    work = kernels.loads, kernels.work, *kernels.pose_arrays(), np.zeros(6, dtype=complex)
    kernels.call(inverse_jacobian_many, *motion, *work, forces, tips, force_by, tip_by)
    by_force = force_by.reshape(count, 3, n * width, n * width)[:, :, kept][..., kept]
    by_tip = tip_by.reshape(count, 3, n * width, 6)[:, :, kept]
    slopes = (by.transpose(0, 3, 1, 2) for by in (by_force, by_tip))
    return DynamicsAlong(arm.unpadded(forces), tips, *slopes)


class MotionTorque(ABC):
    """Torque along a motion; callable with the time."""

    #: Whether the torque accepts an array of times, for ``simulate``.
    vectorized: ClassVar[bool] = True

    motion: Motion

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.motion.joints

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) at which the torque or a derivative of it may jump: those of the motion."""
        return self.motion.breaks

    @public_call
    def __call__(self, t: ArrayLike) -> Floats:
        """Return the joint torques (n,) at a time (s), or (T, n) at times (T,); N m.

        At a break the torque has the value after the jump, as the acceleration does.
        """
        times = check_times("t", t)
        return self._at(times.reshape(-1)).reshape(*times.shape, self.joints)

    @abstractmethod
    def _at(self, times: Floats) -> Floats:
        """Return the torques (T, n) at times (T,), N m."""


@dataclass(frozen=True, eq=False)
class RigidTorque(MotionTorque):
    """Torque of the rigid model along a motion; callable with the time.

    Before and after the motion it is the static torque of the rigid model: zero without gravity.

    Attributes:
        rigid_counterpart: the rigid model of the arm.
        motion: the motion.
    """

    rigid_counterpart: Arm
    motion: Motion

    def _at(self, times: Floats) -> Floats:
        return np.asarray(self.rigid_counterpart.inverse_dynamics_many(*self.motion.at(times)))


@public_call
def rigid_torque(arm: Arm, motion: Motion) -> RigidTorque:
    """Return the rigid inverse dynamics of an arm along a motion as a function of time.

    Args:
        arm: flexible or rigid. Masses, hubs, payload and gravity have an effect; flexibility has
            none.
        motion: a motion with the same number of joints.

    Raises:
        InputError: if the numbers of joints differ.
    """
    arm = check_arm(arm)
    serial_only(arm.spec, "the torque of the rigid model", UNDRIVEN)
    return RigidTorque(arm.rigid(), check_motion(motion, arm))


#: Lower bound of the smallest singular value of the tip Jacobian along the path, as a fraction of
#: the reach, for the joints that control the tip.
_SMALLEST = 1e-3


class TipConstraint:
    """Constraints on the tip and the joints of an arm that follows a rigid motion; (D.9).

    Two joints: the tip coincides with that of the rigid arm. More joints: it does, and all joints
    except the two that move the tip best follow the rigid motion. One joint: the direction of the
    tip from the joint is that of the rigid arm. There are as many constraints as joints.
    """

    def __init__(self, arm: Arm, motion: Motion) -> None:
        serial_only(arm.spec, "inverse dynamics of the tip")
        self.arm, self.motion = arm, motion
        self.count = arm.joints
        self._led = self._led_joints() if self.count > 2 else np.zeros(0, dtype=np.intp)

    def _led_joints(self) -> NDArray[np.intp]:
        """Return the joints on the rigid motion: all but the two that move the tip best."""
        chain, motion = self.motion.chain, self.motion
        times = np.linspace(motion.start_time, motion.end_time, 33)
        jacobians = tip_jacobian(chain.lengths, motion.joint_angle(times) + chain.offset)

        def worst(pair: tuple[int, int]) -> float:
            values = np.linalg.svd(jacobians[:, :, list(pair)], compute_uv=False)
            return float(np.min(values[:, -1]))

        best = max(combinations(range(self.count), 2), key=worst)
        return np.setdiff1d(np.arange(self.count), best)

    def check(self) -> None:
        """Raise InputError if the joints cannot move the tip in every direction along the path."""
        if self.count == 1:
            return
        chain, motion = self.motion.chain, self.motion
        times = np.linspace(motion.start_time, motion.end_time, 129)
        angles = motion.joint_angle(times)
        used = np.setdiff1d(np.arange(self.count), self._led)
        jacobians = tip_jacobian(chain.lengths, angles + chain.offset)[:, :, used]
        values = np.linalg.svd(jacobians, compute_uv=False)[:, -1]
        k = int(np.argmin(values))
        if values[k] < _SMALLEST * np.sum(chain.lengths):
            rule = (
                f"is singular at t = {times[k]:.6g} s: with the joint angles "
                f"{np.round(angles[k], 4)} rad the joints cannot move the tip in every direction"
            )
            raise InputError(Problem("motion", rule))

    def misses(self, t: Floats, q: Floats, along: DynamicsAlong) -> tuple[Floats, Floats]:
        """Return the residuals (T, n), m, and their derivatives by q, (T, n, dof)."""
        chain, motion = self.motion.chain, self.motion
        by = along.tip_by[:, :2, 0]
        if self.count == 1:
            angle = motion.joint_angle(t)[:, 0] + chain.offset[0]
            across = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
            value = np.sum(across * (along.tip[:, :2] - chain.base), axis=1)
            return value[:, None], np.einsum("ta,tad->td", across, by)[:, None]
        led = self.arm.joint_index[self._led]
        reach = float(np.sum(chain.lengths))  # scales all rows to lengths
        turned = reach * (q[:, led] - motion.joint_angle(t)[:, self._led])
        rows = np.broadcast_to(reach * np.eye(self.arm.dof)[led], (len(t), led.size, self.arm.dof))
        value = along.tip[:, :2] - motion.tip(t)
        return np.concatenate([value, turned], axis=1), np.concatenate([by, rows], axis=1)
