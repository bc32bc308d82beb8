"""Joint torques of the rigid twin along a motion: the usual feedforward of a flexible arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from flexarm.motion.chain import check_arm
from flexarm.motion.motion import check_motion

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexarm.arm import Arm
    from flexarm.motion.motion import Motion

    Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RigidTorque:
    """The torque that makes the rigid arm follow a motion exactly; call it with the time.

    Before and after the motion it holds the arm where it rests: zero, unless there is gravity.

    Attributes:
        twin: the rigid arm.
        motion: what it follows.
    """

    #: ``simulate`` may ask for many times in one call.
    vectorized: ClassVar[bool] = True

    twin: Arm
    motion: Motion

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.motion.joints

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) where the torque or a derivative of it may jump: those of the motion."""
        return self.motion.breaks

    def __call__(self, t: ArrayLike) -> Floats:
        """Return the joint torques (n,) at a time (s), or (T, n) at times (T,); N m.

        At a break the torque belongs to what follows, as the motion's acceleration does.
        """
        state = self.motion.state(t)
        flat = [part.reshape(-1, self.joints) for part in state]
        torque: Floats = self.twin.inverse_dynamics_many(*flat)
        return torque.reshape(state.angle.shape)


def rigid_torque(arm: Arm, motion: Motion) -> RigidTorque:
    """Return the rigid inverse dynamics of `arm` along `motion` as a function of time.

    Args:
        arm: flexible or rigid; its masses, hubs, payload and gravity count, its flexibility not.
        motion: made for an arm with as many joints.

    Raises:
        InputError: the numbers of joints differ.
    """
    arm = check_arm("rigid_torque", arm)
    return RigidTorque(arm.rigid(), check_motion("rigid_torque", motion, arm))
