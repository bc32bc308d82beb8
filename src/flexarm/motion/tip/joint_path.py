"""Joint paths q(s) that move the tip of a rigid arm along a path p(s).

Two links have a closed-form solution. For longer, redundant arms the path solves

    dq/ds = J^+(q) p',    p' = dp/ds,

the least-norm rates (with the pseudo-inverse of the tip Jacobian J). It is integrated once, and
Newton steps correct its tip position at each evaluation. Both compute derivatives from the posture,
so tip and joints agree to rounding:

    dq/ds   = J^+ p'
    d2q/ds2 = J^+ (p'' - J' dq/ds) + (I - J^+ J) J'^T J^+^T dq/ds,    J' = dJ/ds

The last term is the part of dJ^+/ds in the null space of J. Without it, J^+ (p'' - J' q') would not
be the derivative of the least-norm rate. It vanishes for two links.

References:
    G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432, for the derivative of J^+.
    D. E. Whitney, IEEE Trans. Man-Mach. Syst. 10 (1969) 47-53, for resolved rates.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from flexarm.motion.geometry.inverse_kinematics import elbow_angle, shoulder_offset
from flexarm.motion.geometry.kinematics import tip_jacobian, tip_jacobian_rate, tip_position

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.integrate import OdeSolution

    from flexarm.motion.geometry.chain import RigidChain
    from flexarm.motion.tip.tip_paths import TipPath

    Floats = NDArray[np.float64]
    Posture = Callable[[Floats], Floats]

SMALLEST_STRETCH = 1e-4
"""Smallest singular value of J, as a fraction of the reach, at which a posture is still used. A
straight arm a millionth of its reach short of the boundary has about a thousandth."""
ODE_TOLERANCE = 1e-12
"""Of the least-norm path, far below the 1e-9 to which its rates should agree with it."""
LONGEST_STEP = 1.0 / 64.0
"""The solver's interpolant has order 7: with this step its error stays below its tolerance."""


class SingularPathError(Exception):
    """The least-norm path reaches a posture in which the tip cannot follow the path."""

    def __init__(self, s: float, posture: Floats) -> None:
        super().__init__(s, posture)
        self.s = s
        self.posture = posture


def path_derivatives(
    lengths: Floats, angles: Floats, way: Floats, bend: Floats
) -> tuple[Floats, Floats]:
    """Return dq/ds and d2q/ds2, each (T, n), at postures `angles` (T, n).

    Args:
        way, bend: dp/ds and d2p/ds2 there, (T, 2).
    """
    jacobian = tip_jacobian(lengths, angles)
    inverse = _pseudo_inverse(jacobian)
    slope = _times(inverse, way)
    turning = tip_jacobian_rate(lengths, angles, slope)
    idle = _times(_transposed(turning), _times(_transposed(inverse), slope))
    idle -= _times(inverse, _times(jacobian, idle))
    return slope, idle + _times(inverse, bend - _times(turning, slope))


def two_link_path(chain: RigidChain, path: TipPath, elbow: str) -> Posture:
    """Return q(s) -> (T, 2) of a two-link arm, continuous also if the tip circles the base.

    The direction of the tip is measured from that at the latest of several s, between which it
    changes by less than pi/2: the way to the next is half of the distance from the base.
    """
    nodes = [0.0]
    while path.fastest > 0.0:
        (point,) = path.at(np.array(nodes[-1:])).point - chain.base
        s = nodes[-1] + 0.5 * float(np.hypot(*point)) / path.fastest
        if s >= 1.0:
            break
        nodes.append(s)
    at = path.at(np.array(nodes)).point - chain.base
    turns = _turned(at[:-1], at[1:])
    directions = np.arctan2(at[0, 1], at[0, 0]) + np.concatenate([[0.0], np.cumsum(turns)])
    return partial(_two_link_posture, chain, path, elbow, np.array(nodes), at, directions)


def _turned(old: Floats, new: Floats) -> Floats:
    """Return the angles (T,) from vectors to others, (T, 2) each, in [-pi, pi]."""
    across = old[:, 0] * new[:, 1] - old[:, 1] * new[:, 0]
    turned: Floats = np.arctan2(across, np.sum(old * new, axis=-1))
    return turned


def _two_link_posture(
    chain: RigidChain,
    path: TipPath,
    elbow: str,
    nodes: Floats,
    at: Floats,
    directions: Floats,
    s: Floats,
) -> Floats:
    """Return the postures (T, 2) at path fractions s.

    Args:
        nodes: increasing s (k,) from 0; at: the tip there from the base (k, 2), m; directions: its
            direction there without jumps (k,), rad.
    """
    point = path.at(s).point - chain.base
    k = np.searchsorted(nodes, s, side="right") - 1
    turn = directions[k] + _turned(at[k], point)
    bend = elbow_angle(chain.lengths, np.hypot(point[:, 0], point[:, 1]), elbow)
    return np.stack([turn - shoulder_offset(chain.lengths, bend), bend], axis=-1)


def least_norm_path(chain: RigidChain, path: TipPath, first: Floats) -> Posture:
    """Return q(s) -> (T, n) along the least-norm path from posture `first` (n,) at its start.

    Raises:
        SingularPathError: if the path reaches a posture in which all links are nearly in one line.
    """
    from scipy.integrate import OdeSolution, solve_ivp  # slow, not required for two links

    lengths = chain.lengths
    limit = SMALLEST_STRETCH * float(np.sum(lengths))

    def slope(s: float, angles: Floats) -> Floats:
        (way,) = path.at(np.array([s])).slope
        rates: Floats = _pseudo_inverse(tip_jacobian(lengths, angles)) @ way
        return rates

    def clearance(_s: float, angles: Floats) -> float:
        smallest = np.linalg.svd(tip_jacobian(lengths, angles), compute_uv=False)[-1]
        return float(smallest) - limit

    clearance.terminal = True  # type: ignore[attr-defined]
    if clearance(0.0, first) <= 0.0:
        raise SingularPathError(0.0, first)
    times, steps, angles = [0.0], [], first
    for piece in pairwise((0.0, *path.breaks, 1.0)):
        solution = solve_ivp(
            slope,
            piece,
            angles,
            method="DOP853",
            rtol=ODE_TOLERANCE,
            atol=ODE_TOLERANCE,
            max_step=LONGEST_STEP,
            dense_output=True,
            events=clearance,
        )
        angles = solution.y[:, -1]
        if solution.status != 0:
            raise SingularPathError(float(solution.t[-1]), angles)
        times += solution.t[1:].tolist()
        steps += solution.sol.interpolants
    return partial(_least_norm_posture, chain, path, OdeSolution(times, steps))


def _least_norm_posture(chain: RigidChain, path: TipPath, near: OdeSolution, s: Floats) -> Floats:
    """Return the postures at path fractions s, with the tip corrected onto the path."""
    point = path.at(s).point - chain.base
    angles: Floats = near(s).T
    for _ in range(2):  # errors are squared: from 1e-11 to 1e-22, below rounding
        inverse = _pseudo_inverse(tip_jacobian(chain.lengths, angles))
        angles = angles + _times(inverse, point - tip_position(chain.lengths, angles))
    return angles


def _pseudo_inverse(matrices: Floats) -> Floats:
    if matrices.shape[-1] == matrices.shape[-2]:  # far from singular, because paths keep a margin
        return np.asarray(np.linalg.inv(matrices), dtype=np.float64)
    return np.asarray(np.linalg.pinv(matrices), dtype=np.float64)


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """Multiply matrices (T, a, b) with vectors (T, b)."""
    product: Floats = np.matmul(matrices, vectors[:, :, None])[:, :, 0]
    return product


def _transposed(matrices: Floats) -> Floats:
    return np.swapaxes(matrices, -1, -2)
