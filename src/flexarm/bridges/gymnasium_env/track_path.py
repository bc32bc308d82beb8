"""Environment with the task to follow a straight line with the tip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from flexarm.base.errors import InputError, Problem
from flexarm.bridges.gymnasium_env.base import ArmEnv
from flexarm.bridges.gymnasium_env.observation import FloatArray, Part
from flexarm.bridges.gymnasium_env.reach import joint_range
from flexarm.motion import line_motion
from flexarm.motion.tip.tip_motion import TipMotion

#: Bounds of a line's length (fraction of the reach) and of the mean speed (reaches per second).
_LENGTH, _SPEED = (0.15, 0.4), (0.2, 0.4)
#: Largest joint rates (rad/s); a line with larger ones is too close to a singular posture.
_FASTEST = 3.0
_TRIES = 200
#: Success: largest distance from the end of the line, as a fraction of the reach.
_NEAR = 0.01


class TrackPathEnv(ArmEnv):
    """Follow a point that moves along a random line, and come to rest at its end.

    The line begins at a random posture and has a length of 0.15 to 0.4 of the reach, a random
    direction, and a mean speed of 0.2 to 0.4 reaches per second, from rest to rest. The task adds
    to the observation: ``wanted_tip`` (2,) m and ``wanted_velocity`` (2,) m/s of the point,
    ``line_end`` (2,) m, and ``time_left`` (1,) s until the end. The reward is half of its maximum
    at a distance of a fiftieth of the reach from the point. ``is_success``: the line has ended and
    the tip is within a hundredth of the reach of its end.

    ``reset(options={"start": ..., "end": ..., "duration": ...})`` accepts world points (2,) m, and
    s, all three together. ``motion`` is the ``line_motion`` of the point. See ``ArmEnv`` for
    everything else.
    """

    scale: ClassVar[float] = 0.02
    option_names: ClassVar[tuple[str, ...]] = ("start", "end", "duration")
    motion: TipMotion

    def task_parts(self) -> Sequence[Part]:
        """See ``ArmEnv``."""
        reach = self.reach
        return [
            Part("wanted_tip", "m", 2, reach, axes=True),
            Part("wanted_velocity", "m/s", 2, 10.0 * reach, axes=True),
            Part("line_end", "m", 2, reach, axes=True),
            Part("time_left", "s", 1, self.ticks * self.plant.sample_time),
        ]

    def begin(self, options: dict[str, Any]) -> FloatArray:
        """See ``ArmEnv``."""
        missing = [name for name in self.option_names if name not in options]
        if not options:
            self.motion = self._drawn()
        elif missing:
            rule = "have no " + " and no ".join(map(repr, missing))
            raise InputError(Problem("the options", rule))
        else:
            self.motion = line_motion(self.arm, **options)
        motion, times = self.motion, np.arange(self.ticks + 1) * self.plant.sample_time
        along = motion.law(np.minimum(times / motion.duration, 1.0))
        way = motion.end - motion.start
        self.task_table = np.column_stack(
            [
                motion.start + np.outer(along.s, way),
                np.outer(along.ds / motion.duration, way),
                np.tile(motion.end, (len(times), 1)),
                np.maximum(motion.duration - times, 0.0),
            ]
        )
        return motion.joint_angle(0.0)

    def _drawn(self) -> TipMotion:
        """Draw a random line that the arm can follow at its speed."""
        rng, reach = self.np_random, self.reach
        for _ in range(_TRIES):
            start = self.arm.tip(self.arm.rest(rng.uniform(*joint_range(self))))[:2]
            direction = rng.uniform(-np.pi, np.pi)
            length, speed = reach * rng.uniform(*_LENGTH), reach * rng.uniform(*_SPEED)
            end = start + length * np.array([np.cos(direction), np.sin(direction)])
            try:
                motion = line_motion(self.arm, start, end, length / speed)
            except InputError:
                continue
            rates = motion.joint_rate(np.linspace(0.0, motion.duration, 33))
            if np.abs(rates).max() < _FASTEST:
                return motion
        raise InputError(Problem("the arm", f"cannot follow any of {_TRIES} random lines"))

    def succeeded(self, values: FloatArray, info: Mapping[str, Any]) -> Any:
        """See ``ArmEnv``."""
        return (values[..., 6] == 0.0) & (info["distance"] < _NEAR * self.reach)
