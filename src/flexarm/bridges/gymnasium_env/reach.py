"""Environment with the task to move the tip to a point and keep it there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from flexarm.base.errors import check_array
from flexarm.bridges.gymnasium_env.base import ArmEnv
from flexarm.bridges.gymnasium_env.observation import FloatArray, Part

#: Largest initial joint angle (rad), unless a stop is closer.
_RANGE = 2.5
#: Largest joint angle (rad) between the start and the posture whose tip is the goal.
_TURN = 0.6
#: Success: largest distance (fraction of the reach) and speed (reaches per second) of the tip.
_NEAR, _SLOW = 0.01, 0.05


class ReachEnv(ArmEnv):
    """Move the tip to a random goal, and keep it there without vibration.

    The goal is the tip of the arm with straight links after turning each joint by up to 0.6 rad
    from a random posture, which is the start. The task adds to the observation: ``goal`` (2,) m.
    The reward is half of its maximum at a distance of a twentieth of the reach. ``is_success``: the
    tip is within a hundredth of the reach of the goal, and slower than a twentieth of the reach
    per second.

    ``reset(options={"start": ..., "goal": ...})`` accepts joint angles (joints,) rad instead of
    random ones. ``info`` also contains ``goal_joint_angle`` (joints,) rad, the solution of the
    inverse kinematics. See ``ArmEnv`` for everything else.
    """

    scale: ClassVar[float] = 0.05
    option_names: ClassVar[tuple[str, ...]] = ("start", "goal")

    def task_parts(self) -> Sequence[Part]:
        """See ``ArmEnv``."""
        return [Part("goal", "m", 2, self.reach, axes=True)]

    def begin(self, options: dict[str, Any]) -> FloatArray:
        """See ``ArmEnv``."""
        shape = (self.arm.joints,)
        lower, upper = joint_range(self)
        start = self.np_random.uniform(lower, upper)
        if "start" in options:
            start = check_array("start", options["start"], shape)
        turn = self.np_random.uniform(-_TURN, _TURN, shape)
        self.goal_angle = np.clip(start + turn, np.minimum(lower, start), np.maximum(upper, start))
        if "goal" in options:
            self.goal_angle = check_array("goal", options["goal"], shape)
        self.task_table = self.arm.tip(self.arm.rest(self.goal_angle))[None, :2]
        return start

    def task_info(self) -> dict[str, FloatArray]:
        """See ``ArmEnv``."""
        return {"goal_joint_angle": self.goal_angle.copy()}

    def succeeded(self, values: FloatArray, info: Mapping[str, Any]) -> Any:
        """See ``ArmEnv``."""
        near = info["distance"] < _NEAR * self.reach
        return near & (info["speed"] < _SLOW * self.reach)


def joint_range(env: ArmEnv) -> tuple[FloatArray, FloatArray]:
    """Return the bounds (joints,) of initial joint angles, rad."""
    lower = np.full(env.arm.joints, -_RANGE)
    upper = -lower
    for k, number in enumerate(env.arm.joint_numbers):
        limits = env.arm.spec.joints[number - 1].limits
        if limits is not None:
            lower[k], upper[k] = max(lower[k], limits.lower), min(upper[k], limits.upper)
    return lower, upper
