"""Motion of the base of a rigid mechanism along a motion of its joints."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.base.errors import InputError, Problem
from flexarm.base.late import scipy
from flexarm.motion.dynamics.following_base import FollowingBase
from flexarm.motion.motion import Floats, Motion

#: Relative and absolute errors of the base, in m and rad of an arm with the reach of one metre.
_RTOL, _ATOL = 1e-10, 1e-12
#: Least part of the path that is computed at once, in durations of the motion.
_PART = 1.0


class BaseStates(NamedTuple):
    """Coordinates, rates and accelerations of a rigid mechanism at T times, (T, dof) each."""

    q: Floats
    qd: Floats
    qdd: Floats


class BaseMotion:
    """Motion of the base along a motion of the joints, from rest at ``start`` (k,) before it."""

    def __init__(self, following: FollowingBase, motion: Motion, start: Floats) -> None:
        self.following, self.motion = following, motion
        self._start = np.concatenate([start, np.zeros(start.size)])
        self._end, self._state = motion.start_time, self._start
        self._paths: list[Any] = []

    def states(self, times: NDArray[Any]) -> BaseStates:
        """Return coordinates, rates and accelerations (T, dof) at times (T,)."""
        self._extend(float(np.max(times, initial=self._end)))
        base, motion = self._at(times), self.motion.state(times)
        k, following = self._start.size // 2, self.following
        q, qd, qdd = whole = np.zeros((3, times.size, following.arm.dof))
        whole[:, :, following.arm.joint_index] = motion
        q[:, following.places], qd[:, following.places] = base[:, :k], base[:, k:]
        qdd = following.accelerated_many(q, qd, qdd)
        qdd[times < self.motion.start_time] = 0.0
        return BaseStates(q, qd, qdd)

    def _at(self, times: NDArray[Any]) -> Floats:
        """Return the base and its rates (T, 2 k) at times within the computed path."""
        values = np.tile(self._start, (times.size, 1))
        for path in self._paths:
            inside = (times >= path.t_min) & (times <= path.t_max)
            if np.any(inside):
                values[inside] = path(times[inside]).T
        return values

    def _extend(self, until: float) -> None:
        """Integrate the base up to a time, s."""
        if until <= self._end:
            return
        until = max(until, self._end + _PART * self.motion.duration)
        breaks = [t for t in self.motion.breaks if self._end < t < until]
        sizes = coordinate_sizes(self.following.arm)[self.following.places]
        for a, b in pairwise([self._end, *breaks, until]):
            # A break belongs to the interval before it here, with its limit from below.
            inside = np.nextafter(a, b), np.nextafter(b, a)

            def slope(t: float, state: Floats, inside: tuple[float, float] = inside) -> Floats:
                return self._slope(min(max(t, inside[0]), inside[1]), state)

            path = scipy.integrate.solve_ivp(
                slope,
                (a, b),
                self._state,
                method="DOP853",
                rtol=_RTOL,
                atol=_ATOL * np.tile(sizes, 2),
                dense_output=True,
                max_step=self.motion.duration / 8.0,
            )
            if not path.success:
                rule = f"cannot be followed beyond t = {path.t[-1]:.4g} s: {path.message}"
                raise InputError(Problem("the motion of the base", rule))
            self._paths.append(path.sol)
            self._state, self._end = path.y[:, -1], b

    def _slope(self, t: float, state: Floats) -> Floats:
        k, following = state.size // 2, self.following
        angle, rate, acceleration = self.motion.state(t)
        q, qd = following.placed(angle, state[:k]), following.placed(rate, state[k:])
        return np.append(state[k:], following.accelerated(q, qd, acceleration)[following.places])


def base_motion(rigid: Arm, motion: Motion) -> BaseMotion:
    """Return the motion of the base of a rigid mechanism along a motion of its joints."""
    following = FollowingBase(rigid)
    return BaseMotion(following, motion, following.rest(motion.joint_angle(motion.start_time)))
