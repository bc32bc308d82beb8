"""Dynamics and tip along a motion, rigid torques, and constraints that keep the tip on a path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.arm.closed import gap_bias, held_joints, refuse_open, row_sizes
from flexarm.base.arguments import check_times
from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.kernels.derivatives.inverse_sensitivity import inverse_jacobian_many
from flexarm.model.arm.spec import serial_only
from flexarm.motion.dynamics.base_motion import BaseMotion, base_motion
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


class Actuation:
    """Motions of a rigid mechanism that its actuated joints drive.

    Theory page "mechanisms", (M.24). With the motions ``Z`` that keep the loops closed and its
    rows ``Z_a`` of the actuated joints, ``P = Z pinv(Z_a)``: the torques ``P' f`` of least norm do
    the work of the forces f of all joints.
    """

    def __init__(self, arm: Arm, actuated: Sequence[int] | None) -> None:
        self.arm = arm
        self._actuated = np.arange(arm.n_joints)
        if actuated is not None:
            self._actuated = np.unique(held_joints(arm, actuated, "actuated"))
        if self._actuated.size < arm.n_joints - arm.closure_rows:
            raise self._too_few(arm.n_joints - arm.closure_rows)
        self._sizes, self._rows = coordinate_sizes(arm), row_sizes(arm)

    def _too_few(self, motions: int) -> InputError:
        """Return the error that the actuated joints cannot drive a number of motions."""
        numbers = self.arm.joint_numbers[self._actuated].tolist()
        rule = f"drive all {motions} independent motions of the mechanism"
        return InputError(Problem("actuated", rule, shown(numbers)))

    def motions(self, q: Floats) -> Floats:
        """Return P (joints, joints) at q (joints,); columns of passive joints are zero.

        Raises:
            InputError: if the actuated joints do not move the mechanism in all its motions.
        """
        J = self.arm.closure_jacobian(q) * self._sizes / self._rows[:, None]
        _, values, right = np.linalg.svd(J)
        Z = right[np.count_nonzero(values > _DEPENDENT) :].T
        left, values, right = np.linalg.svd(Z[self._actuated], full_matrices=False)
        if len(values) < Z.shape[1] or np.any(values < _SMALLEST):
            raise self._too_few(Z.shape[1])
        P = np.zeros(2 * (self.arm.n_joints,))
        P[:, self._actuated] = Z @ (right.T / values) @ left.T
        return np.asarray(self._sizes[:, None] * P / self._sizes)

    def completed(self, q: Floats, qd: Floats, qdd: Floats, P: Floats) -> Floats:
        """Return accelerations (joints,) that keep the loops closed, near those of actuated joints.

        They follow the accelerations of the actuated joints as far as these are independent.
        """
        scale = self._sizes / self._rows[:, None]
        J = self.arm.closure_jacobian(q) * scale
        bias = gap_bias(self.arm, q, qd) / self._rows
        least = -self._sizes * (np.linalg.pinv(J, rcond=_DEPENDENT) @ bias)
        return np.asarray(least + P @ (qdd - least))


@dataclass(frozen=True, eq=False, repr=False)
class RigidTorque(MotionTorque):
    """Torque of the rigid model along a motion; callable with the time.

    Before and after the motion it is the static torque of the rigid model: zero without gravity. A
    base that moves is at rest before the motion, and may move on after it.

    Attributes:
        rigid_counterpart: the rigid model of the arm.
        motion: the motion.
        actuation: the actuated joints of a mechanism; None if all joints are.
        base_motion: motion of a base that moves; None for a fixed base.
    """

    rigid_counterpart: Arm
    motion: Motion
    actuation: Actuation | None = None
    base_motion: BaseMotion | None = None

    def __repr__(self) -> str:
        return f"<flexarm.RigidTorque: {self.joints} joints, of a {type(self.motion).__name__}>"

    @public_call
    def base_position(self, t: ArrayLike) -> Floats:
        """Return x, y (m) and angle (rad) of the base, (3,) or (T, 3), at a time (s) or times."""
        times = check_times("t", t)
        positions = np.zeros((times.size, 3))
        if self.base_motion is not None:
            q = self.base_motion.states(times.reshape(-1)).q
            for coordinate in self.rigid_counterpart.assembly.base:
                k = ("x", "y", "angle").index(coordinate.name)
                positions[:, k] = q[:, coordinate.place]
        return positions.reshape(*times.shape, 3)

    def _at(self, times: Floats) -> Floats:
        state = self.motion.at(times)
        if self.base_motion is not None:
            whole = self.rigid_counterpart.inverse_dynamics_many(*self.base_motion.states(times))
            forces = np.asarray(whole)[:, self.rigid_counterpart.joint_index]
        else:
            forces = np.asarray(self.rigid_counterpart.inverse_dynamics_many(*state))
        if self.actuation is not None:
            pairs = zip(state.angle, forces, strict=True)
            forces = np.array([self.actuation.motions(q).T @ force for q, force in pairs])
        return forces.reshape(len(times), self.joints)


#: Instants at which a motion is compared with the closures.
_CHECKS = 17


@public_call
def rigid_torque(arm: Arm, motion: Motion, *, actuated: Sequence[int] | None = None) -> RigidTorque:
    """Return the rigid inverse dynamics of an arm along a motion as a function of time.

    A base that moves follows the joints, from its equilibrium at the start of the motion: a free
    one keeps its momentum zero.

    Args:
        arm: flexible or rigid. Masses, hubs, payload and gravity have an effect; flexibility has
            none.
        motion: a motion with the same number of joints; of a mechanism with closures, one that
            keeps the loops closed, from `joint_motion` with ``driven`` or a motion of the tip.
        actuated: numbers of the joints with a motor, whose torques are returned; those of the
            other joints are zero. By default the joints ``driven`` of the motion, or else all
            joints. If they are more than the mechanism needs, the torques have the least norm.

    Raises:
        InputError: if the numbers of joints differ, the motion does not keep the loops closed, the
            actuated joints cannot drive the mechanism, a base that moves has no equilibrium at the
            start, or closures connect it with the ground.
    """
    arm = check_arm(arm)
    rigid, motion = arm.rigid(), check_motion(motion, arm)
    base = base_motion(rigid, motion) if rigid.assembly.base else None
    fixed = rigid if base is None else base.following.fixed
    if actuated is None:
        actuated = driven_of(motion)
        if actuated is None and "closures" not in rigid.spec.features:
            return RigidTorque(rigid, motion, None, base)
    actuation = Actuation(fixed, actuated)
    for q in motion.joint_angle(np.linspace(motion.start_time, motion.end_time, _CHECKS)):
        refuse_open(fixed, "motion", q, "fa.joint_motion(arm, ..., driven=[...]) does.")
        actuation.motions(q)
    return RigidTorque(rigid, motion, actuation, base)


def driven_of(motion: object) -> tuple[int, ...] | None:
    """Return the numbers of the joints that drive a motion of a mechanism, None for all."""
    return getattr(motion, "driven", None) or None


#: Singular value of the Jacobian of closures, in sizes, below which rows depend on each other.
_DEPENDENT = 1e-8
#: Lower bound of the smallest singular value of the tip Jacobian along the path, as a fraction of
#: the reach, for the joints that control the tip; and of the motions of actuated joints.
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
        self.count = arm.n_joints
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
