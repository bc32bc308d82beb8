"""Inverse kinematics of a rigid chain: relative joint angles for a position of the tip.

Two links have a closed-form solution with two elbow branches. Longer arms are redundant: damped
least squares starts from a given posture, and without one a posture is constructed link by link in
closed form. A point out of reach raises an error with the reach and the distance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.motion.kinematics import tip_jacobian, tip_position

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

REACH_TOLERANCE = 1e-9
"""Points this fraction of the reach outside count as on the boundary: a nanometre per metre."""
POINT_TOLERANCE = 1e-13
"""Distance to the point, as a fraction of the reach, at which the iteration has arrived: a few
hundred times the rounding of one tip position."""
STUCK_DAMPING = 1e9
"""Damping, relative to the reach squared, at which a step is too short to change the tip."""
MAX_ITERATIONS = 500
"""Damped least squares needs 5 to 30 steps, a few hundred close to a boundary."""
ELBOWS = ("up", "down")


def reach_limits(lengths: Floats) -> tuple[float, float]:
    """Return the smallest and largest distance (m) of the tip from the base.

    The smallest is zero unless one link is longer than all the others together.
    """
    total = float(np.sum(lengths))
    return max(0.0, 2.0 * float(np.max(lengths)) - total), total


def inverse_kinematics(
    lengths: ArrayLike,
    point: ArrayLike,
    elbow: str = "up",
    posture: ArrayLike | None = None,
    where: str = "inverse_kinematics",
) -> Floats:
    """Return relative joint angles (n,) (rad) that place the tip of a rigid chain at `point`.

    Args:
        lengths: link lengths (n,), m.
        point: world (x, y), m.
        elbow: for two links, `"up"` is the branch with theta_2 <= 0 and `"down"` its mirror image
            with theta_2 >= 0. For more links without a posture, the side of the line from base to
            point on which the arm is: `"up"` is the left side in the direction of the point.
        posture: for three links or more, relative joint angles (n,) at which the search starts; the
            solution is near it and `elbow` is not used.
        where: name of the calling function, for messages.

    Returns:
        The angles, each in [-pi, pi], except that a search from a posture keeps its full turns.

    Raises:
        InputError: if the point is out of reach, an argument has the wrong shape or is not finite,
            or the search from `posture` does not converge.
    """
    lengths = check_array(where, "lengths", lengths, (-1,))
    if len(lengths) == 0 or np.min(lengths) <= 0.0:
        raise InputError(Problem(where, "lengths", "be greater than 0", shown(lengths.tolist())))
    point = check_array(where, "point", point, (2,))
    check_elbow(where, elbow)
    check_reach(where, "point", lengths, point)
    if posture is not None:
        return _from_posture(where, lengths, point, posture)
    return _wrapped(built_posture(lengths, point, elbow))


def check_elbow(where: str, elbow: str) -> None:
    """Raise if an elbow is neither up nor down."""
    if not isinstance(elbow, str) or elbow not in ELBOWS:
        raise InputError(Problem(where, "elbow", "be 'up' or 'down'", shown(elbow)))


def check_reach(where: str, name: str, lengths: Floats, point: Floats) -> None:
    """Raise if a point (2,) is outside the ring (for one link the circle) of reachable points."""
    inner, outer = reach_limits(lengths)
    distance = float(np.hypot(*point))
    slack = REACH_TOLERANCE * outer
    value = f"({point[0]:.6g}, {point[1]:.6g}), {distance:.6g} m from it"
    if len(lengths) == 1 and abs(distance - outer) > slack:
        rule = f"lie on the circle of radius {outer:.6g} m about the base"
        hint = "The tip of a one-link arm stays on that circle."
        raise InputError(Problem(where, name, rule, value, hint))
    if distance > outer + slack:
        rule = f"lie within the reach of {outer:.6g} m from the base"
        raise InputError(Problem(where, name, rule, value, "The straight arm is too short."))
    if distance < inner - slack:
        rule = f"lie at least {inner:.6g} m from the base"
        hint = "One link is longer than all the others together."
        raise InputError(Problem(where, name, rule, value, hint))


def elbow_angle(lengths: Floats, distance: Floats | float, elbow: str) -> Floats:
    """Return theta_2 of a two-link arm whose tip is `distance` (any shape, m) from the base.

    The half-angle form tan^2(theta_2 / 2) = (R^2 - r^2) / (r^2 - h^2), with R and h the outer and
    inner reach, keeps all its digits near the straight and the folded posture, where the cosine
    rule loses half of them.
    """
    inner, outer = abs(float(lengths[0] - lengths[1])), float(lengths[0] + lengths[1])
    to_outer = np.maximum((outer - distance) * (outer + distance), 0.0)
    to_inner = np.maximum((distance - inner) * (distance + inner), 0.0)
    bend: Floats = 2.0 * np.arctan2(np.sqrt(to_outer), np.sqrt(to_inner))
    return -bend if elbow == "up" else bend


def shoulder_offset(lengths: Floats, bend: Floats) -> Floats:
    """Return the direction of the tip relative to link 1 for theta_2 = `bend`, in [-pi, pi]."""
    first, second = lengths
    direction: Floats = np.arctan2(second * np.sin(bend), first + second * np.cos(bend))
    return direction


def built_posture(lengths: Floats, point: Floats, elbow: str) -> Floats:
    """Return a posture (n,) for a point within reach, constructed link by link in closed form.

    Each link is rotated so that the remaining distance to the point is the same fraction of the
    remaining reach, or as near to that as the triangle permits with a margin. At the limits of the
    triangle the link would be in line with the others, and the arm nearer to a singular posture.
    """
    side = 1.0 if elbow == "up" else -1.0
    absolute: list[float] = []
    left = np.array(point)
    for i in range(len(lengths) - 2):
        inner, outer = reach_limits(lengths[i + 1 :])
        distance = float(np.hypot(*left))
        low = max(inner, abs(distance - lengths[i]))
        high = min(outer, distance + lengths[i])
        room = 0.1 * (high - low)
        share = distance * outer / (outer + lengths[i])
        rest = float(np.clip(share, low + room, high - room)) if room > 0.0 else low
        triangle = np.array([lengths[i], rest])
        bend = elbow_angle(triangle, distance, elbow)
        turn = side * abs(float(shoulder_offset(triangle, bend)))
        absolute.append(float(np.arctan2(left[1], left[0])) + turn)
        left -= lengths[i] * np.array([np.cos(absolute[-1]), np.sin(absolute[-1])])
    last = float(np.arctan2(left[1], left[0]))
    if len(lengths) == 1:
        return np.array([last])
    bend = elbow_angle(lengths[-2:], np.hypot(*left), elbow)
    absolute.append(last - float(shoulder_offset(lengths[-2:], bend)))
    return np.array([absolute[0], *np.diff(absolute), bend])


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


def _from_posture(where: str, lengths: Floats, point: Floats, posture: ArrayLike) -> Floats:
    seed = check_array(where, "posture", posture, (len(lengths),))
    if len(lengths) < 3:
        rule = "is not supported for an arm of one or two links"
        hint = "Choose the posture with elbow='up' or 'down'."
        raise InputError(Problem(where, "posture", rule, hint=hint))
    if _on_boundary(lengths, point):
        # The only posture is straight or folded, and the search would converge slowly to it.
        return _wrapped(built_posture(lengths, point, "up"))
    angles, miss = damped_least_squares(lengths, point, seed)
    if miss > REACH_TOLERANCE * float(np.sum(lengths)):
        rule = f"be one from which the search reaches ({point[0]:.6g}, {point[1]:.6g})"
        hint = f"The search stopped {miss:.3g} m away: bend the posture, or leave it out."
        raise InputError(Problem(where, "posture", rule, shown(seed.tolist()), hint))
    return angles


def _on_boundary(lengths: Floats, point: Floats) -> bool:
    inner, outer = reach_limits(lengths)
    distance = float(np.hypot(*point))
    slack = REACH_TOLERANCE * outer
    return distance > outer - slack or (inner > 0.0 and distance < inner + slack)


def _wrapped(angles: Floats) -> Floats:
    """Return the angles in [-pi, pi]; those already in this interval are returned unchanged."""
    inside = np.abs(angles) <= np.pi
    return np.where(inside, angles, np.pi - np.mod(np.pi - angles, 2.0 * np.pi))
