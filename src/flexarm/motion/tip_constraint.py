"""What keeps the tip of a flexible arm on the path that a motion gives the rigid one.

As many conditions as joints; (D.9).
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from flexarm.errors import InputError, Problem
from flexarm.motion.kinematics import tip_jacobian

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm.arm import Arm
    from flexarm.motion.dynamics_along import DynamicsAlong
    from flexarm.motion.motion import Motion

    Floats = NDArray[np.float64]

#: Smallest singular value of the tip's Jacobian, as a part of the reach, that the joints which
#: hold the tip may have along the path.
_SMALLEST = 1e-3


class TipConstraint:
    """Conditions on a motion of an arm, from the motion that the rigid arm would follow.

    Two joints: the tip is where the rigid arm's would be. More: so it is, and all joints but the
    two that move the tip best follow the rigid motion. One: the tip is seen from the joint in the
    direction in which the rigid arm's would be.
    """

    def __init__(self, arm: Arm, motion: Motion) -> None:
        self.arm, self.motion = arm, motion
        self.count = arm.joints
        self._led = self._led_joints() if self.count > 2 else np.zeros(0, dtype=np.intp)

    def _led_joints(self) -> NDArray[np.intp]:
        """Joints that follow the rigid motion: those that the tip can best do without."""
        chain, motion = self.motion.chain, self.motion
        times = np.linspace(motion.start_time, motion.end_time, 33)
        jacobians = tip_jacobian(chain.lengths, motion.joint_angle(times) + chain.offset)

        def worst(pair: tuple[int, int]) -> float:
            values = np.linalg.svd(jacobians[:, :, list(pair)], compute_uv=False)
            return float(np.min(values[:, -1]))

        best = max(combinations(range(self.count), 2), key=worst)
        return np.setdiff1d(np.arange(self.count), best)

    def check(self) -> None:
        """Refuse paths along which the joints lose hold of the tip.

        Raises:
            InputError: so it is, at the posture named.
        """
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
            rule = "avoid postures in which the joints cannot move the tip in every direction"
            value = f"in one at t = {times[k]:.6g} s: joint angles {np.round(angles[k], 4)} rad"
            raise InputError(Problem("tip_inversion", "motion", rule, value))

    def misses(self, t: Floats, q: Floats, along: DynamicsAlong) -> tuple[Floats, Floats]:
        """Return by how much states miss, (T, n) m, and the derivatives by q, (T, n, dof)."""
        chain, motion = self.motion.chain, self.motion
        by = along.tip_by[:, :2, 0]
        if self.count == 1:
            angle = motion.joint_angle(t)[:, 0] + chain.offset[0]
            across = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
            value = np.sum(across * (along.tip[:, :2] - chain.base), axis=1)
            return value[:, None], np.einsum("ta,tad->td", across, by)[:, None]
        led = self.arm.joint_index[self._led]
        reach = float(np.sum(chain.lengths))  # so that all rows are lengths
        turned = reach * (q[:, led] - motion.joint_angle(t)[:, self._led])
        rows = np.broadcast_to(reach * np.eye(self.arm.dof)[led], (len(t), led.size, self.arm.dof))
        value = along.tip[:, :2] - motion.tip(t)
        return np.concatenate([value, turned], axis=1), np.concatenate([by, rows], axis=1)
