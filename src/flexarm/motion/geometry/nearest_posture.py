"""Posture of a redundant rigid chain that is nearest to a given one, with the tip at a point.

It minimises |q - q0|^2 / 2 subject to tip(q) = p. At a solution q - q0 = J^T mu. With a basis Z of
the null space of J, Newton's step in the postures with the tip at the point is

    Z y,    (Z^T H Z) y = -Z^T (q - q0),    H = 1 - mu . d2tip/dq2,

after which damped least squares return the tip to the point.

References:
    J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., Springer 2006, sections 15.3
    and 18.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexarm.motion.geometry.kinematics import tip_jacobian, tip_position

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

POINT_TOLERANCE = 1e-13
"""Distance to the point, as a fraction of the reach, at which the iteration has arrived: a few
hundred times the rounding of one tip position."""
STUCK_DAMPING = 1e9
"""Damping, relative to the reach squared, at which a step is too short to change the tip."""
MAX_ITERATIONS = 500
"""Damped least squares needs 5 to 30 steps, a few hundred close to a boundary."""
NEAREST = 1e-9
"""Gradient at a minimum along the postures with the tip at the point, relative to 1 + |q - q0|: far
above rounding, and Newton's next step would be its square."""
ARRIVED = 1e-12
"""Distance to the point, as a fraction of the reach, of postures that count as solutions: sums over
hundreds of links have that rounding error."""
LEAST_CURVATURE = 1e-2
"""Bound from below of the curvature in a step, of which the distance alone gives 1."""
MAX_STEPS = 60
"""Newton's method needs 3 to 10 steps."""


def nearest_posture(
    lengths: Floats, point: Floats, posture: Floats, starts: Sequence[Floats]
) -> Floats:
    """Return the angles (n,), n > 2, nearest to a posture among those with the tip at a point.

    The nearest of the minima found by descents from the posture and from other starts.

    Args:
        lengths: (n,) m. point: from the base (2,), m, within reach. posture: (n,) rad.
        starts: postures (n,) with the tip at the point.
    """
    pulled, miss = damped_least_squares(lengths, point, posture)
    arrived = miss <= ARRIVED * float(np.sum(lengths))
    found = [
        _descent(lengths, point, posture, q) for q in ([pulled] if arrived else []) + [*starts]
    ]
    return min(found, key=lambda q: float(np.sum((q - posture) ** 2)))


def _descent(lengths: Floats, point: Floats, posture: Floats, q: Floats) -> Floats:
    """Return the minimum of the distance from `posture` to which the descent from q (n,) leads."""
    scale = float(np.sum(lengths))
    for _ in range(MAX_STEPS):
        away = q - posture
        jacobian = tip_jacobian(lengths, q)
        idle = np.linalg.svd(jacobian)[2][2:].T
        gradient = idle.T @ away
        if np.linalg.norm(gradient) <= NEAREST * (1.0 + np.linalg.norm(away)):
            break
        hessian = idle.T @ _hessian(lengths, q, np.linalg.pinv(jacobian.T) @ away) @ idle
        values, vectors = np.linalg.eigh(hessian)
        bounded = np.maximum(np.abs(values), LEAST_CURVATURE)
        step = -idle @ (vectors @ ((vectors.T @ gradient) / bounded))
        slope, length = float(step @ away), 1.0
        while length > 1e-6:
            trial, miss = damped_least_squares(lengths, point, q + length * step)
            gain = 0.5 * float(away @ away - (trial - posture) @ (trial - posture))
            if miss <= ARRIVED * scale and gain >= -1e-4 * length * slope:
                break
            length *= 0.5
        else:
            break  # rounding permits no further decrease
        q = trial
    return q


def _hessian(lengths: Floats, angles: Floats, factors: Floats) -> Floats:
    """Return 1 - factors . d2tip/dq2 (n, n); d2tip / dq_i dq_j is joint max(i, j) minus the tip."""
    down, right = tip_jacobian(lengths, angles)  # of the tip seen from each joint: -y and x
    latest = np.maximum.outer(np.arange(len(angles)), np.arange(len(angles)))
    hessian: Floats = np.eye(len(angles)) + (factors[0] * right - factors[1] * down)[latest]
    return hessian


def damped_least_squares(lengths: Floats, point: Floats, posture: Floats) -> tuple[Floats, float]:
    """Move the tip of `posture` (n,) to `point` (2,); return the posture and its tip error (m).

    Steps J^T (J J^T + d I)^-1 e. The damping d increases after a step that does not reduce the
    error and decreases otherwise, so the last steps are Newton steps (least norm, quadratic).

    References:
        C. W. Wampler, IEEE Trans. Syst. Man Cybern. 16 (1986) 93-101.
        Y. Nakamura and H. Hanafusa, J. Dyn. Syst. Meas. Control 108 (1986) 163-171.
    """
    scale = float(np.sum(lengths))
    angles = np.array(posture)
    error = point - tip_position(lengths, angles)
    miss = float(np.hypot(*error))
    damping = 1e-2
    for _ in range(MAX_ITERATIONS):
        if miss <= POINT_TOLERANCE * scale or damping > STUCK_DAMPING:
            break
        jacobian = tip_jacobian(lengths, angles)
        weights = jacobian @ jacobian.T + damping * scale**2 * np.eye(2)
        trial = angles + jacobian.T @ np.linalg.solve(weights, error)
        trial_error = point - tip_position(lengths, trial)
        trial_miss = float(np.hypot(*trial_error))
        if trial_miss < miss:
            angles, error, miss = trial, trial_error, trial_miss
            damping = max(damping * 0.1, 1e-18)
        else:
            damping *= 10.0
    return angles, miss
