"""Equilibrium with a given tip position, and the zero dynamics of the links about it.

With the tip constrained, the links can still move: the zero dynamics. For torques at the joints and
a tip at the other end of flexible links it has modes that grow as fast as others decay, so neither
forward nor backward integration in time is stable. Their rates determine how long torques must act
before the tip moves and after it has stopped; (D.10), (D.11).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.base.errors import InputError, Problem
from flexarm.motion.dynamics.dynamics_along import dynamics_along

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm.motion.dynamics.dynamics_along import TipConstraint

    Floats = NDArray[np.float64]

#: Eigenvalues with a real part below this fraction of their magnitude are vibrations that neither
#: grow nor decay during a motion: undamped, or lightly damped links. Damping of 0.5 % gives real
#: parts of 0.003 of the magnitude; they would start the torques seconds earlier, without benefit.
_NEUTRAL = 0.1
#: Zeros faster than the fastest vibration by this factor count as infinite. Those that rounding
#: makes finite were at least 20 times as fast, on coarse meshes 1e4 times.
_INFINITE = 10.0
_NEWTON_STEPS = 30


class RestEnd(NamedTuple):
    """Equilibrium at one end of a motion, with the tip in place.

    Attributes:
        q: (dof,) coordinates; links sag under gravity.
        torque: (joints,) N m in equilibrium.
        zeros: eigenvalues of the zero dynamics, 1/s, slowest first.
    """

    q: Floats
    torque: Floats
    zeros: NDArray[np.complex128]

    @property
    def growth(self) -> float:
        """Slowest growth rate of the zero dynamics, 1/s; infinite if no mode grows."""
        return float(np.min(self._real[self._real > 0.0], initial=np.inf))

    @property
    def decay(self) -> float:
        """Slowest decay rate of the zero dynamics, 1/s; infinite if no mode decays."""
        return float(np.min(-self._real[self._real < 0.0], initial=np.inf))

    @property
    def _real(self) -> Floats:
        real = self.zeros.real
        return np.where(np.abs(real) > _NEUTRAL * np.abs(self.zeros), real, 0.0)


def rest_end(constraint: TipConstraint, t: float) -> RestEnd:
    """Compute the equilibrium at a time at which the motion is at rest.

    Raises:
        InputError: if there is no equilibrium with the tip in place.
    """
    from scipy.linalg import eigh, null_space

    arm = constraint.arm
    elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
    q = _rest(constraint, t, elastic)
    still = np.zeros((1, arm.dof))
    along = dynamics_along(arm, q[None], still, still)
    free = null_space(constraint.misses(np.array([t]), q[None], along)[1][0])
    rows = along.force_by[0, elastic]
    K, D, M = (rows[:, level] @ free for level in range(3))
    squared = eigh(rows[:, 0, elastic], rows[:, 2, elastic], eigvals_only=True)
    zeros = finite_eigenvalues(M, D, K, float(np.sqrt(squared[-1])))
    return RestEnd(q, along.force[0, arm.joint_index], zeros)


def finite_eigenvalues(M: Floats, D: Floats, K: Floats, fastest: float) -> NDArray[np.complex128]:
    """Return the finite s of det(M s^2 + D s + K) = 0, slowest first; M may be singular.

    If a torque does not act on the tip directly, as through the spring of an elastic joint, M is
    singular and some s are infinite. Rounding makes them finite, but much faster than anything in
    the arm that the matrices describe, which identifies them.

    Args:
        fastest: rad/s, highest frequency of the arm with its joints locked.
    """
    from scipy.linalg import eigvals

    # Scale time by the fastest vibration, so that the blocks have similar magnitudes.
    none, one = np.zeros_like(M), np.eye(len(M))
    stiffness, damping = K / fastest**2, D / fastest
    left = np.block([[none, one], [-stiffness, -damping]])
    above, below = eigvals(left, np.block([[one, none], [none, M]]), homogeneous_eigvals=True)
    finite = np.abs(above) < _INFINITE * np.abs(below)
    values = fastest * above[finite] / below[finite]
    return np.asarray(values[np.argsort(np.abs(values))])


def _rest(constraint: TipConstraint, t: float, elastic: NDArray[np.intp]) -> Floats:
    """Solve for equilibrium of the links with the tip in place by Newton's method."""
    arm, motion = constraint.arm, constraint.motion
    q = arm.rest(motion.joint_angle(t))
    still, unit = np.zeros((1, arm.dof)), coordinate_sizes(arm)
    for _ in range(_NEWTON_STEPS):
        along = dynamics_along(arm, q[None], still, still)
        value, by = constraint.misses(np.array([t]), q[None], along)
        missing = np.concatenate([along.force[0, elastic], value[0]])
        matrix = np.concatenate([along.force_by[0, elastic, 0], by[0]])
        step = np.linalg.solve(matrix, -missing)
        q = q + step
        if np.max(np.abs(step / unit)) < 1e-11 * (1.0 + np.max(np.abs(q / unit))):
            return q
    rule = f"has no equilibrium with the tip in place at t = {t:.6g} s"
    raise InputError(Problem("motion", rule))
