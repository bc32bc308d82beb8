"""Constraints that keep the tip of a flexible arm on the path of a rigid motion; (D.9).

There are as many constraints as joints.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from flexarm.base.errors import InputError, Problem
from flexarm.motion.geometry.chain import tip_jacobian

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm.arm.arm import Arm
    from flexarm.motion.dynamics.dynamics_along import DynamicsAlong
    from flexarm.motion.motion import Motion

    Floats = NDArray[np.float64]

#: Lower bound of the smallest singular value of the tip Jacobian along the path, as a fraction of
#: the reach, for the joints that control the tip.
_SMALLEST = 1e-3


class TipConstraint:
    """Constraints on the tip and the joints of an arm that follows a rigid motion.

    Two joints: the tip coincides with that of the rigid arm. More joints: it does, and all joints
    except the two that move the tip best follow the rigid motion. One joint: the direction of the
    tip from the joint is that of the rigid arm.
    """

    def __init__(self, arm: Arm, motion: Motion) -> None:
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
