"""Rigid chains of arms and their inverse kinematics.

Links with fixed joints between them form one bar, from the root of the first to the next joint that
turns or to the tip. Its length is the sum of theirs if they are in line. Otherwise it is the
straight line between both ends, at an angle to the root tangent.

The functions of the tip accept leading axes, so that one call evaluates a whole motion:

| symbol | meaning | shape | unit | frame |
| --- | --- | --- | --- | --- |
| lengths | L_i, link lengths | (n,) | m | |
| angles | theta_i, relative joint angles | (..., n) | rad | joint 1 from world x |
| psi_i | theta_1 + ... + theta_i | (..., n) | rad | world |
| tip | sum of L_i (cos psi_i, sin psi_i) | (..., 2) | m | world |
| J | d tip / d theta | (..., 2, n) | m | world |

Two links have a closed-form solution with two elbow branches. Longer arms are redundant: a posture
is constructed link by link in closed form, or the nearest to a given posture is found. A point out
of reach raises an error with the reach and the distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.observe import tips_of
from flexarm.base.arguments import check_posture
from flexarm.base.errors import InputError, Problem, check_array, public_call, shown
from flexarm.model.arm.spec import serial_only
from flexarm.motion.geometry.mechanism_path import posture_near

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flexarm.arm.arm import Arm


@dataclass(frozen=True, eq=False)
class RigidChain:
    """Straight bars between the joints that turn."""

    lengths: FloatArray  # lengths of the bars (n,), m
    #: Angles between bars minus joint angles (n,), rad; zero unless a fixed joint has a rest angle
    offset: FloatArray
    base: FloatArray  # position of the first joint that turns (2,), world axes, m

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.lengths)

    def tip(self, joint_angles: FloatArray) -> FloatArray:
        """Return the tip position (..., 2) in world axes, m, at joint angles (..., n)."""
        return self.base + tip_position(self.lengths, joint_angles + self.offset)


class RigidTree(RigidChain):
    """Rigid links of an arm that is not a chain of bars: it has a tip, but no bars.

    A base that moves is at the origin.
    """

    def __init__(self, arm: Arm) -> None:
        object.__setattr__(self, "_arm", arm.rigid())

    def __getattr__(self, name: str) -> Any:
        if name in ("lengths", "offset", "base"):
            serial_only(self._arm.spec, "inverse kinematics of the tip")
        raise AttributeError(name)

    @property
    def joints(self) -> int:
        return int(self._arm.n_joints)

    def tip(self, joint_angles: FloatArray) -> FloatArray:
        arm = self._arm
        q = np.zeros((*joint_angles.shape[:-1], 2, arm.dof))
        q[..., 0, arm.joint_index] = joint_angles
        tips = tips_of(arm, arm.padded(q).reshape(-1, 2, *arm.padded(q).shape[-2:]))
        return tips[:, :2].reshape(*joint_angles.shape[:-1], 2)


def check_arm(arm: Arm) -> Arm:
    """Return an object that has the joints and links of an arm, or raise InputError."""
    parts = ("n_joints", "n_links", "lengths", "spec", "assembly")
    if isinstance(arm, type) or not all(hasattr(arm, name) for name in parts):
        given = f"the class {arm.__name__}" if isinstance(arm, type) else shown(arm)
        raise InputError(Problem("arm", "be an Arm", given))
    return arm


def rigid_chain(arm: Arm) -> RigidChain:
    """Return the rigid chain of an arm; InputError without joints, or if two of them coincide.

    An arm that is not serial has a tip, and no bars: their attributes raise InputError.
    """
    if check_arm(arm).n_joints == 0:
        raise InputError(Problem("arm", "has no joint that is not fixed"))
    if not arm.spec.is_serial:
        return RigidTree(arm)
    turning = [seat.link for seat in arm.assembly.seats]
    base, before = _walk(arm, 0, turning[0])
    lengths, offset = [], []
    for first, end in zip(turning, [*turning[1:], arm.n_links], strict=True):
        bar, turned = _walk(arm, first, end)
        length, direction = float(np.hypot(*bar)), float(np.arctan2(bar[1], bar[0]))
        if length <= 1e-12 * arm.reach:
            rule = f"has two joints at one place: its fixed links return to joint {first + 1}"
            raise InputError(Problem("arm", rule))
        lengths.append(length)
        offset.append(before + direction)
        before = turned - direction
    return RigidChain(np.array(lengths), np.array(offset), base)


def _walk(arm: Arm, first: int, end: int) -> tuple[FloatArray, float]:
    """Return position (2,) and angle from the root of a link, in its axes, to another or tip."""
    at, angle = np.zeros(2), 0.0
    for i in range(first, end):
        joint = arm.spec.joints[i]
        if joint.fixed:
            angle += joint.rest_angle
        at = at + arm.lengths[i] * np.array([np.cos(angle), np.sin(angle)])
    return at, angle


def tip_position(lengths: FloatArray, angles: FloatArray) -> FloatArray:
    """Return the tip (..., 2) in world axes (m)."""
    psi = np.cumsum(angles, axis=-1)
    return np.stack([np.cos(psi) @ lengths, np.sin(psi) @ lengths], axis=-1)


def tip_jacobian(lengths: FloatArray, angles: FloatArray) -> FloatArray:
    """Return J (..., 2, n); column j is the rotation about joint j of the links outboard of it."""
    psi = np.cumsum(angles, axis=-1)
    links = np.stack([-lengths * np.sin(psi), lengths * np.cos(psi)], axis=-2)
    return _outboard_sum(links)


def tip_jacobian_rate(lengths: FloatArray, angles: FloatArray, rates: FloatArray) -> FloatArray:
    """Return dJ/dt (..., 2, n) when the joints turn at `rates` (..., n), rad/s."""
    psi = np.cumsum(angles, axis=-1)
    spin = lengths * np.cumsum(rates, axis=-1)
    links = np.stack([-spin * np.cos(psi), -spin * np.sin(psi)], axis=-2)
    return _outboard_sum(links)


def _outboard_sum(links: FloatArray) -> FloatArray:
    """Return the sum over links j, j+1, ..., n in column j."""
    return np.flip(np.cumsum(np.flip(links, axis=-1), axis=-1), axis=-1)


REACH_TOLERANCE = 1e-9
"""Points this fraction of the reach outside count as on the boundary: a nanometre per metre."""
ELBOWS = ("up", "down")


def reach_limits(lengths: FloatArray) -> tuple[float, float]:
    """Return the smallest and largest distance (m) of the tip from the base."""
    total = float(np.sum(lengths))
    return max(0.0, 2.0 * float(np.max(lengths)) - total), total


@public_call
def inverse_kinematics(
    arm: Arm, point: ArrayLike, elbow: str = "up", posture: ArrayLike | None = None
) -> FloatArray:
    """Return relative joint angles (n,) (rad) that place the tip of the rigid arm at a point.

    Args:
        arm: only its link lengths are used, so it may be flexible or rigid.
        point: world (x, y), m.
        elbow: for two links, `"up"` is the branch with theta_2 <= 0 and `"down"` its mirror image
            with theta_2 >= 0. For more links without a posture, the side of the line from base to
            point on which the arm is: `"up"` is the left side in the direction of the point.
        posture: for three links or more, relative joint angles (n,) rad; the result is then the
            nearest solution, with the smallest sum of squared angle differences among the minima
            found from this posture and from those of both elbows. `elbow` is not used. Required for
            a mechanism, such as one with closures or sliding joints: the search starts there.

    Returns:
        The angles, each in [-pi, pi]; with a posture, near its angles, including full turns.

    Raises:
        InputError: if the point is out of reach, or an argument has the wrong shape or is not
            finite.
    """
    target = check_array("point", point, (2,))
    check_elbow(elbow)
    if not check_arm(arm).spec.is_serial:
        return posture_near(arm, target, posture)
    chain = rigid_chain(arm)
    check_reach("point", chain, target)
    return posture_at(chain, target, elbow, posture)


def posture_at(
    chain: RigidChain, point: FloatArray, elbow: str, posture: ArrayLike | None
) -> FloatArray:
    """Return joint angles (n,) of a rigid chain for a point (2,); see `inverse_kinematics`."""
    lengths, target = chain.lengths, point - chain.base
    if posture is None:
        angles = built_posture(lengths, target, elbow) - chain.offset
        inside = np.abs(angles) <= np.pi
        return np.where(inside, angles, np.pi - np.mod(np.pi - angles, 2.0 * np.pi))
    seed = check_posture("posture", posture, len(lengths))
    if len(lengths) < 3:
        rule = "is not supported for an arm of one or two links"
        hint = "Choose the posture with elbow='up' or 'down'."
        raise InputError(Problem("posture", rule, hint=hint))
    bars = seed + chain.offset
    built = [built_posture(lengths, target, elbow) for elbow in ELBOWS]
    full = 2.0 * np.pi
    starts = [angles + full * np.round((bars - angles) / full) for angles in built]
    inner, outer = reach_limits(lengths)
    distance = float(np.hypot(*target))
    slack = REACH_TOLERANCE * outer
    if distance > outer - slack or (inner > 0.0 and distance < inner + slack):
        # The only posture is straight or folded, and a search would converge slowly to it.
        return starts[0] - chain.offset
    return nearest_posture(lengths, target, bars, starts) - chain.offset


def check_elbow(elbow: str) -> None:
    """Raise if an elbow is neither up nor down."""
    if not isinstance(elbow, str) or elbow not in ELBOWS:
        raise InputError(Problem("elbow", "be 'up' or 'down'", shown(elbow)))


def check_reach(name: str, chain: RigidChain, point: FloatArray) -> None:
    """Raise if a point (2,) is outside the ring (for one link the circle) of reachable points."""
    inner, outer = reach_limits(chain.lengths)
    distance = float(np.hypot(*(point - chain.base)))
    slack = REACH_TOLERANCE * outer
    value = f"({point[0]:.6g}, {point[1]:.6g}), {distance:.6g} m from it"
    if len(chain.lengths) == 1 and abs(distance - outer) > slack:
        rule = f"lie on the circle of radius {outer:.6g} m about the base"
        hint = "The tip of a one-link arm stays on that circle."
        raise InputError(Problem(name, rule, value, hint))
    if distance > outer + slack:
        rule = f"lie within the reach of {outer:.6g} m from the base"
        raise InputError(Problem(name, rule, value, "The straight arm is too short."))
    if distance < inner - slack:
        rule = f"lie at least {inner:.6g} m from the base"
        hint = "One link is longer than all the others together."
        raise InputError(Problem(name, rule, value, hint))


def elbow_angle(lengths: FloatArray, distance: FloatArray | float, elbow: str) -> FloatArray:
    """Return theta_2 of a two-link arm whose tip is `distance` (any shape, m) from the base.

    The half-angle form tan^2(theta_2 / 2) = (R^2 - r^2) / (r^2 - h^2), with R and h the outer and
    inner reach, keeps all its digits near the straight and the folded posture, where the cosine
    rule loses half of them.
    """
    inner, outer = abs(float(lengths[0] - lengths[1])), float(lengths[0] + lengths[1])
    to_outer = np.maximum((outer - distance) * (outer + distance), 0.0)
    to_inner = np.maximum((distance - inner) * (distance + inner), 0.0)
    bend: FloatArray = 2.0 * np.arctan2(np.sqrt(to_outer), np.sqrt(to_inner))
    return -bend if elbow == "up" else bend


def shoulder_offset(lengths: FloatArray, bend: FloatArray) -> FloatArray:
    """Return the direction of the tip relative to link 1 for theta_2 = `bend`, in [-pi, pi]."""
    first, second = lengths
    return np.asarray(np.arctan2(second * np.sin(bend), first + second * np.cos(bend)))


def built_posture(lengths: FloatArray, point: FloatArray, elbow: str) -> FloatArray:
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


_POINT_TOLERANCE = 1e-13
"""Distance to the point, as a fraction of the reach, at which the iteration has arrived: a few
hundred times the rounding of one tip position."""
_STUCK_DAMPING = 1e9
"""Damping, relative to the reach squared, at which a step is too short to change the tip."""
MAX_ITERATIONS = 500
"""Damped least squares needs 5 to 30 steps, a few hundred close to a boundary."""
_NEAREST = 1e-9
"""Gradient at a minimum along the postures with the tip at the point, relative to 1 + |q - q0|: far
above rounding, and Newton's next step would be its square."""
_ARRIVED = 1e-12
"""Distance to the point, as a fraction of the reach, of postures that count as solutions: sums over
hundreds of links have that rounding error."""
_LEAST_CURVATURE = 1e-2
"""Bound from below of the curvature in a step, of which the distance alone gives 1."""
_MAX_STEPS = 60
"""Newton's method needs 3 to 10 steps."""


def nearest_posture(
    lengths: FloatArray, point: FloatArray, posture: FloatArray, starts: Sequence[FloatArray]
) -> FloatArray:
    """Return the angles (n,), n > 2, nearest to a posture among those with the tip at a point.

    The nearest of the minima found by descents from the posture and from ``starts``, postures
    (n,) with the tip at the point (2,) m from the base.

    It minimises |q - q0|^2 / 2 subject to tip(q) = p. At a solution q - q0 = J^T mu. With a basis Z
    of the null space of J, Newton's step in the postures with the tip at the point is Z y with
    (Z^T H Z) y = -Z^T (q - q0) and H = 1 - mu . d2tip/dq2, after which damped least squares return
    the tip to the point. J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., Springer
    2006, sections 15.3 and 18.1.
    """
    pulled, miss = damped_least_squares(lengths, point, posture)
    arrived = miss <= _ARRIVED * float(np.sum(lengths))
    starts = [pulled, *starts] if arrived else starts
    minima = [_descent(lengths, point, posture, q) for q in starts]
    return min(minima, key=lambda q: float(np.sum((q - posture) ** 2)))


def _descent(
    lengths: FloatArray, point: FloatArray, posture: FloatArray, q: FloatArray
) -> FloatArray:
    """Return the minimum of the distance from `posture` to which the descent from q (n,) leads."""
    scale = float(np.sum(lengths))
    for _ in range(_MAX_STEPS):
        away = q - posture
        jacobian = tip_jacobian(lengths, q)
        idle = np.linalg.svd(jacobian)[2][2:].T
        gradient = idle.T @ away
        if np.linalg.norm(gradient) <= _NEAREST * (1.0 + np.linalg.norm(away)):
            break
        hessian = idle.T @ _hessian(lengths, q, np.linalg.pinv(jacobian.T) @ away) @ idle
        values, vectors = np.linalg.eigh(hessian)
        bounded = np.maximum(np.abs(values), _LEAST_CURVATURE)
        step = -idle @ (vectors @ ((vectors.T @ gradient) / bounded))
        slope, length = float(step @ away), 1.0
        while length > 1e-6:
            trial, miss = damped_least_squares(lengths, point, q + length * step)
            gain = 0.5 * float(away @ away - (trial - posture) @ (trial - posture))
            if miss <= _ARRIVED * scale and gain >= -1e-4 * length * slope:
                break
            length *= 0.5
        else:
            break  # rounding permits no further decrease
        q = trial
    return q


def _hessian(lengths: FloatArray, angles: FloatArray, factors: FloatArray) -> FloatArray:
    """Return 1 - factors . d2tip/dq2 (n, n); d2tip / dq_i dq_j is joint max(i, j) minus the tip."""
    down, right = tip_jacobian(lengths, angles)  # of the tip seen from each joint: -y and x
    latest = np.maximum.outer(np.arange(len(angles)), np.arange(len(angles)))
    return np.asarray(np.eye(len(angles)) + (factors[0] * right - factors[1] * down)[latest])


def damped_least_squares(
    lengths: FloatArray, point: FloatArray, posture: FloatArray
) -> tuple[FloatArray, float]:
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
        if miss <= _POINT_TOLERANCE * scale or damping > _STUCK_DAMPING:
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
