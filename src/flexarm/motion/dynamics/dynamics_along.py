"""Inverse dynamics and tip motion along a motion of all coordinates, with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.base.errors import public_call
from flexarm.kernels.derivatives.inverse_sensitivity import inverse_jacobian_many
from flexarm.motion.geometry.chain import check_arm
from flexarm.motion.motion import check_motion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm.arm.arm import Arm

    Floats = NDArray[np.float64]
    from numpy.typing import ArrayLike, NDArray

    from flexarm.motion.motion import Motion


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
    kernels.call(
        inverse_jacobian_many,
        arm.padded(np.stack([q, qd], axis=1)).astype(complex),
        arm.padded(qdd).astype(complex),
        kernels.loads,
        kernels.work,
        *kernels.pose_arrays(),
        np.zeros(6, dtype=complex),
        forces,
        tips,
        force_by,
        tip_by,
    )
    by_force = force_by.reshape(count, 3, n * width, n * width)[:, :, kept][..., kept]
    by_tip = tip_by.reshape(count, 3, n * width, 6)[:, :, kept]
    return DynamicsAlong(
        force=arm.unpadded(forces),
        tip=tips,
        force_by=by_force.transpose(0, 3, 1, 2),
        tip_by=by_tip.transpose(0, 3, 1, 2),
    )


@dataclass(frozen=True, eq=False)
class RigidTorque:
    """Torque of the rigid model along a motion; callable with the time.

    Before and after the motion it is the static torque of the rigid model: zero without gravity.

    Attributes:
        twin: the rigid model of the arm.
        motion: the motion.
    """

    #: Whether the torque accepts an array of times, for ``simulate``.
    vectorized: ClassVar[bool] = True

    rigid_counterpart: Arm
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
        state = self.motion.state(t)
        flat = [part.reshape(-1, self.joints) for part in state]
        torque: Floats = self.rigid_counterpart.inverse_dynamics_many(*flat)
        return torque.reshape(state.angle.shape)


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
    return RigidTorque(arm.rigid(), check_motion(motion, arm))
