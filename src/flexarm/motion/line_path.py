"""Joint paths q(s) that move the tip of a rigid arm along a straight line, dp/ds = end - start.

Two links have a closed-form solution. For longer, redundant arms the path solves

    dq/ds = J^+(q) e,    e = end - start,

the least-norm rates (with the pseudo-inverse of the tip Jacobian J). It is integrated once, and
Newton steps correct its tip position at each evaluation. Both compute derivatives from the posture,
so tip and joints agree to rounding:

    dq/ds   = J^+ e
    d2q/ds2 = -J^+ J' dq/ds + (I - J^+ J) J'^T J^+^T dq/ds,    J' = dJ/ds

The last term is the part of dJ^+/ds in the null space of J. Without it, J^+ (a - J' q') would not
be the derivative of the least-norm rate. It vanishes for two links.

References:
    G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432, for the derivative of J^+.
    D. E. Whitney, IEEE Trans. Man-Mach. Syst. 10 (1969) 47-53, for resolved rates.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from flexarm.motion.inverse_kinematics import elbow_angle, shoulder_offset
from flexarm.motion.kinematics import tip_jacobian, tip_jacobian_rate, tip_position

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.integrate import OdeSolution

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
    """The least-norm path reaches a posture in which the tip cannot follow the line."""

    def __init__(self, s: float, posture: Floats) -> None:
        super().__init__(s, posture)
        self.s = s
        self.posture = posture


def path_derivatives(lengths: Floats, angles: Floats, way: Floats) -> tuple[Floats, Floats]:
    """Return dq/ds and d2q/ds2, each (T, n), at postures `angles` (T, n) for dp/ds = `way` (2,)."""
    jacobian = tip_jacobian(lengths, angles)
    inverse = _pseudo_inverse(jacobian)
    slope: Floats = inverse @ way
    turning = tip_jacobian_rate(lengths, angles, slope)
    idle = _times(_transposed(turning), _times(_transposed(inverse), slope))
    idle -= _times(inverse, _times(jacobian, idle))
    return slope, idle - _times(inverse, _times(turning, slope))


def two_link_path(lengths: Floats, start: Floats, way: Floats, elbow: str) -> Posture:
    """Return q(s) -> (T, 2) of a two-link arm, continuous also if the tip passes behind the base.

    The direction of the tip is measured from that at the start. A line that does not pass through
    the base changes it by less than pi, so no angle jumps by a full turn.
    """
    return partial(_two_link_posture, lengths, start, way, elbow)


def _two_link_posture(lengths: Floats, start: Floats, way: Floats, elbow: str, s: Floats) -> Floats:
    point = start + s[:, None] * way
    across = start[0] * point[:, 1] - start[1] * point[:, 0]
    turn = np.arctan2(start[1], start[0]) + np.arctan2(across, point @ start)
    bend = elbow_angle(lengths, np.hypot(point[:, 0], point[:, 1]), elbow)
    return np.stack([turn - shoulder_offset(lengths, bend), bend], axis=-1)


def least_norm_path(lengths: Floats, start: Floats, way: Floats, first: Floats) -> Posture:
    """Return q(s) -> (T, n) along the least-norm path from posture `first` (n,) at `start`.

    Raises:
        SingularPathError: if the path reaches a posture in which all links are nearly in one line.
    """
    from scipy.integrate import solve_ivp  # slow import, not required for two links

    limit = SMALLEST_STRETCH * float(np.sum(lengths))

    def slope(_s: float, angles: Floats) -> Floats:
        rates: Floats = _pseudo_inverse(tip_jacobian(lengths, angles)) @ way
        return rates

    def clearance(_s: float, angles: Floats) -> float:
        smallest = np.linalg.svd(tip_jacobian(lengths, angles), compute_uv=False)[-1]
        return float(smallest) - limit

    clearance.terminal = True  # type: ignore[attr-defined]
    if clearance(0.0, first) <= 0.0:
        raise SingularPathError(0.0, first)
    solution = solve_ivp(
        slope,
        (0.0, 1.0),
        first,
        method="DOP853",
        rtol=ODE_TOLERANCE,
        atol=ODE_TOLERANCE,
        max_step=LONGEST_STEP,
        dense_output=True,
        events=clearance,
    )
    if solution.status != 0:
        raise SingularPathError(float(solution.t[-1]), solution.y[:, -1])

    return partial(_least_norm_posture, lengths, start, way, solution.sol)


def _least_norm_posture(
    lengths: Floats, start: Floats, way: Floats, near: OdeSolution, s: Floats
) -> Floats:
    """Return the postures at path fractions s, with the tip corrected onto the line."""
    point = start + s[:, None] * way
    angles: Floats = near(s).T
    for _ in range(2):  # quadratic: from 1e-11 to 1e-22, below rounding
        inverse = _pseudo_inverse(tip_jacobian(lengths, angles))
        angles = angles + _times(inverse, point - tip_position(lengths, angles))
    return angles


def _pseudo_inverse(matrices: Floats) -> Floats:
    if matrices.shape[-1] == matrices.shape[-2]:  # far from singular, because lines keep a margin
        return np.asarray(np.linalg.inv(matrices), dtype=np.float64)
    return np.asarray(np.linalg.pinv(matrices), dtype=np.float64)


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """Multiply matrices (T, a, b) with vectors (T, b)."""
    product: Floats = np.matmul(matrices, vectors[:, :, None])[:, :, 0]
    return product


def _transposed(matrices: Floats) -> Floats:
    return np.swapaxes(matrices, -1, -2)
