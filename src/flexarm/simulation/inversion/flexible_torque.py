"""Torques that make the joints of a flexible arm follow a motion exactly."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_positive
from flexarm.base.errors import LargeDeflectionWarning, public_call
from flexarm.linear import modes
from flexarm.motion import Motion
from flexarm.motion.dynamics.dynamics_along import MotionTorque
from flexarm.motion.motion import check_motion
from flexarm.simulation.calls.run import simulate

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

#: Samples per radian of the fastest mode; the error of splines of order 6 is then below 1e-6.
_SAMPLES = 2.0
_FEWEST, _MOST = 200, 40_000


@dataclass(frozen=True, eq=False)
class FlexibleTorque(MotionTorque):
    """Torque that makes the joints of a flexible arm follow a motion, as a function of time.

    After ``end`` the torque is constant, and links that still vibrate are not controlled.

    Attributes:
        arm, motion: the arm, and the motion of its joints.
        end: end of the computed torque, s.
        initial: initial q (dof,) at time zero.
    """

    arm: Arm
    motion: Motion
    end: float
    initial: FloatArray
    _splines: tuple[BSpline, ...]  # one between each two breaks
    _edges: tuple[float, ...]

    def __repr__(self) -> str:
        return f"<flexarm.FlexibleTorque: {self.joints} joints, up to {self.end:g} s>"

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) at which the torque or one of its derivatives may jump."""
        return self._edges

    def _at(self, times: FloatArray) -> FloatArray:
        flat = np.clip(times, 0.0, self.end)
        torque = np.empty((flat.size, self.joints))
        last = len(self._splines) - 1
        piece = np.clip(np.searchsorted(self._edges, flat, side="right") - 1, 0, last)
        for k, spline in enumerate(self._splines):
            torque[piece == k] = spline(flat[piece == k])
        return torque


@public_call
def flexible_torque(
    arm: Arm,
    motion: Motion,
    duration: float | None = None,
    *,
    initial: ArrayLike | None = None,
    rtol: float = 1e-8,
) -> FlexibleTorque:
    """Return the torque that makes the joints of a flexible arm follow a motion exactly.

    Args:
        arm: the arm.
        motion: motion of the joints or of the rigid model's tip; the flexible arm's tip vibrates.
        duration: s from time zero to the end of the torque; by default to the end of the motion.
        initial: q (dof,) at time zero; straight links by default.
        rtol: error allowed per step of the integration.

    Raises:
        InputError: if an argument has the wrong shape or value.
        SimulationError: if the integration of the links' motion fails.

    With prescribed joints, the equations of the links are integrated forward in time; (D.8).
    """
    motion = check_motion(motion, arm)
    until = check_positive("duration", motion.end_time if duration is None else duration)
    rtol = check_positive("rtol", rtol)
    locked = modes(arm, motion.joint_angle(0.0)).frequency_hz
    fastest = 2.0 * np.pi * float(np.max(locked, initial=0.0))
    count = int(np.clip(np.ceil(_SAMPLES * fastest * until), _FEWEST, _MOST))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LargeDeflectionWarning)  # the user's run warns
        result = simulate(
            arm,
            until,
            prescribed={int(number): motion for number in arm.joint_numbers},
            initial=arm.rest(motion.joint_angle(0.0)) if initial is None else initial,
            rate=count / until,
            rtol=rtol,
            progress=False,
        )
    inner = [t for t in motion.breaks if 0.0 < t < until]
    edges = (0.0, *inner, until)
    samples = result.time.values, result.torque.values
    splines = tuple(_spline(*samples, a, b) for a, b in pairwise(edges))
    return FlexibleTorque(arm, motion, until, result.q.values[0], splines, edges)


def _spline(times: FloatArray, values: FloatArray, a: float, b: float) -> BSpline:
    """Interpolate the samples between two breaks, excluding those on the breaks."""
    from scipy.interpolate import make_interp_spline

    own = (times > a) & (times < b) if a > 0.0 else times < b
    return make_interp_spline(times[own], values[own], k=min(5, np.count_nonzero(own) - 1))
