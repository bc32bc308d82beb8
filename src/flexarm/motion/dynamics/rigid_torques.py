"""Joint torques of the rigid model along a motion, the usual feedforward of a flexible arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from flexarm.base.errors import public_call
from flexarm.motion.geometry.chain import check_arm
from flexarm.motion.motion import check_motion

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexarm.arm.arm import Arm
    from flexarm.motion.motion import Motion

    Floats = NDArray[np.float64]


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
