"""Joint reference for the torques of a tip inversion, for feedback."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import LargeDeflectionWarning
from flexarm.motion import JointState, Motion
from flexarm.motion.geometry.chain import RigidChain
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.inversion.correction import CorrectedTorque
from flexarm.simulation.inversion.joint_support import SupportedTorque

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

#: Samples per knot of the torque's spline; a spline of order 6 through them is exact to 1e-6.
_PER_KNOT = 8.0
#: Coefficients of u^3, u^4 and u^5 in the quintic law that ends the motion of the joints at rest.
_EASE = (10.0, -15.0, 6.0)


@dataclass(frozen=True, eq=False)
class InversionReference(Motion):
    """Joint angles of a flexible arm whose tip follows a motion.

    As a reference for feedback, the joint angles include the effect of bending on the *tip*. The
    reference begins before the motion and ends after it, as the torques do.

    Attributes:
        motion: of the rigid model; the tip follows it.
        torque: function of time: (joints,) N m, consistent with the joint angles.
        initial: (dof,) initial coordinates.
    """

    motion: Motion
    torque: CorrectedTorque
    initial: FloatArray
    start_time: float
    duration: float
    _coordinates: BSpline = field(repr=False)
    _joints: NDArray[np.intp] = field(repr=False)
    chain: RigidChain = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "chain", self.motion.chain)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Start and end, and the breaks of the motion in between, s."""
        inner = (t for t in self.motion.breaks if self.start_time < t < self.end_time)
        return (self.start_time, *inner, self.end_time)

    def tip(self, t: ArrayLike) -> FloatArray:
        """Return the reference position of the tip (2,) or (T, 2), world axes, m."""
        return self.motion.tip(t)

    def at(self, times: FloatArray) -> JointState:
        """See `Motion.at`."""
        return JointState(*(part[:, self._joints] for part in self.coordinates(times)))

    def coordinates(self, times: FloatArray) -> list[FloatArray]:
        """Return q, qd and qdd of the bent arm, (T, dof) each, at times (T,)."""
        inside = np.clip(times, self.start_time, self.end_time)
        moving = ((times >= self.start_time) & (times < self.end_time))[:, None]
        rate, acceleration = (self._coordinates(inside, nu) * moving for nu in (1, 2))
        return [self._coordinates(inside), rate, acceleration]


def inversion_reference(
    arm: Arm,
    torque: CorrectedTorque,
    ends: tuple[float, float],
    initial: FloatArray,
    final: FloatArray,
    supported: SupportedTorque | None = None,
) -> InversionReference:
    """Simulate an arm under the torques of an inversion and return its joint angles.

    Args:
        ends: start and end of the torque's change, s.
        initial, final: (dof,) coordinates at rest before and after.
        supported: the torque of a supported arm, to use instead of ``torque``.
    """
    from scipy.interpolate import make_interp_spline

    start, end = ends
    if supported is not None:
        arm = supported.support.arm
    spacing = float(np.max(np.diff(torque.knots)))
    count = int(np.ceil(_PER_KNOT * (end - start) / spacing))
    rate = count / (end - start)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LargeDeflectionWarning)  # the user's run warns
        result = simulate(
            arm,
            end - start,
            torque=_Later(supported or torque, start),
            initial=initial,
            rate=rate,
            rtol=1e-9,
            progress=False,
        )
    times, angles = result.time.values, result.joint_angle.values
    after = torque.motion.end_time - start
    u = np.clip((times - after) / (times[-1] - after), 0.0, 1.0)
    ease = u**3 * (_EASE[0] + u * (_EASE[1] + u * _EASE[2]))
    q = np.array(result.q.values)
    q[:, arm.joint_index] += np.outer(ease, arm.joint_angles(final) - angles[-1])
    still = [(1, np.zeros(arm.dof)), (2, np.zeros(arm.dof))]
    spline = make_interp_spline(times + start, q, k=5, bc_type=(still, still))
    return InversionReference(
        torque.motion, torque, initial, start, end - start, spline, arm.joint_index
    )


@dataclass(frozen=True)
class _Later:
    """Torque with a shifted time axis."""

    torque: CorrectedTorque | SupportedTorque
    start: float
    vectorized: bool = True

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(t - self.start for t in self.torque.breaks)

    def __call__(self, t: ArrayLike) -> FloatArray:
        return self.torque(np.asarray(t) + self.start)
