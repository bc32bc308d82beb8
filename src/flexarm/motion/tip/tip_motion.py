"""Motions of the tip along a path p(s), validated over the whole path in advance.

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
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.base.arguments import warn_of_degrees
from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.base.late import scipy
from flexarm.motion.geometry.inverse_kinematics import (
    RigidChain,
    check_elbow,
    check_reach,
    elbow_angle,
    posture_at,
    reach_limits,
    rigid_chain,
    shoulder_offset,
    tip_jacobian,
    tip_jacobian_rate,
    tip_position,
)
from flexarm.motion.geometry.mechanism_path import Given, mechanism_path
from flexarm.motion.motion import Floats, JointState, PathMotion, checked_times
from flexarm.motion.timing import TimingLaw, timing_law
from flexarm.motion.tip.tip_paths import TipPath, arc_path, line_path, polygon_path, spline_path

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flexarm.arm.arm import Arm

    Posture = Callable[[Floats], Floats]


MARGIN = 1e-6
"""Distance a path keeps from the boundary of the reach, as a fraction of the reach. On the boundary
joint accelerations are infinite, at rest too; here rates are a thousand times those of mid-reach,
which the user may want to see, and the closed form still has ten digits."""


@dataclass(frozen=True, eq=False, repr=False)
class TipMotion(PathMotion):
    """Motion of the rigid arm's tip along a path p(s).

    Attributes:
        tip_path: the path of the tip.
        posture: angles between the bars as a function of s: (T,) -> (T, n), rad.
    """

    chain: RigidChain
    tip_path: TipPath
    duration: float
    law: TimingLaw
    start_time: float
    posture: Posture

    def _about(self) -> str:
        return f"{self.tip_path.title}, {super()._about()}"

    @property
    def start(self) -> Floats:
        """World point at which the path starts (2,), m."""
        return np.asarray(self.tip_path.at(np.zeros(1)).point[0])

    @property
    def end(self) -> Floats:
        """World point at which the path ends (2,), m."""
        return np.asarray(self.tip_path.at(np.ones(1)).point[0])

    @property
    def path_breaks(self) -> tuple[float, ...]:
        return self.tip_path.breaks

    def path(self, s: Floats) -> JointState:
        """Return the postures along the path and their derivatives."""
        angles = self.posture(s)
        tip = self.tip_path.at(s)
        jacobian = tip_jacobian(self.chain.lengths, angles)
        inverse = _pseudo_inverse(jacobian)
        slope = _times(inverse, tip.slope)
        turning = tip_jacobian_rate(self.chain.lengths, angles, slope)
        idle = _times(turning.mT, _times(inverse.mT, slope))
        idle -= _times(inverse, _times(jacobian, idle))
        curve = idle + _times(inverse, tip.curve - _times(turning, slope))
        return JointState(angles - self.chain.offset, slope, curve)


class _MechanismTip(TipMotion):
    """Motion of the tip of a mechanism, whose posture is a piecewise polynomial."""

    def path(self, s: Floats) -> JointState:
        """Return the postures along the path and their derivatives."""
        table: Any = self.posture
        return JointState(*(table(s, order) for order in range(3)))


_NO_JOINTS = np.zeros(0, dtype=np.intp)


def _nothing(s: float) -> Given:
    return Given(*np.zeros((3, 0)))


def _point(path: TipPath, s: float) -> Given:
    return Given(*(part[0] for part in path.at(np.array([s]))))


def tip_motion(
    arm: Arm,
    path: TipPath,
    duration: float,
    profile: str | TimingLaw,
    elbow: str,
    start_time: float,
    posture: ArrayLike | None,
) -> TipMotion:
    """Return a motion of the tip along a path in world axes, as `line_motion` along a line."""
    duration, start_time = checked_times(duration, start_time)
    law = timing_law(profile)
    chain = rigid_chain(arm)
    check_elbow(elbow)
    if not arm.spec.is_serial:
        table = mechanism_path(
            arm, posture, _NO_JOINTS, _nothing, partial(_point, path), path.breaks
        )
        return _MechanismTip(chain, path, duration, law, start_time, table)
    if len(chain.lengths) == 1:
        rule = "has one link, which cannot follow a path of the tip"
        raise InputError(Problem("arm", rule, hint="Its tip moves on a circle: use joint_motion."))
    _check_margins(chain, path)
    first = posture_at(chain, path.at(np.zeros(1)).point[0], elbow, posture) + chain.offset
    if len(chain.lengths) == 2:
        return TipMotion(chain, path, duration, law, start_time, _two_link_path(chain, path, elbow))
    try:
        along = least_norm_path(chain, path, first)
    except SingularPathError as singular:
        (point,) = path.at(np.array([singular.s])).point
        angles = [round(angle, 4) for angle in (singular.posture - chain.offset).tolist()]
        problem = Problem(
            path.title,
            f"has a singular posture at ({point[0]:.6g}, {point[1]:.6g}): all links lie in one "
            f"line with the joint angles {shown(angles)} rad",
            hint="Try another posture, the other elbow, or a path farther from the boundary.",
        )
        raise InputError(problem) from None
    return TipMotion(chain, path, duration, law, start_time, along)


def _check_margins(chain: RigidChain, path: TipPath) -> None:
    """Raise if a path reaches the outer boundary of the reach or enters the hole inside it."""
    for name, s in path.marks.items():
        check_reach(name, chain, path.at(np.array([s])).point[0])
    inner, outer = reach_limits(chain.lengths)
    margin = MARGIN * outer
    extremes = path.extremes(chain.base)
    points = path.at(extremes).point
    distances = np.hypot(*(points - chain.base).T)
    far, near = int(np.argmax(distances)), int(np.argmin(distances))
    if distances[far] > outer - margin:
        named = [name for name, s in path.marks.items() if s == extremes[far]]
        if named:
            rule = f"be less than {outer - margin:.9g} m from the base"
            value = _place(points[far], distances[far])
        else:
            rule = f"stay less than {outer - margin:.9g} m from the base"
            value = f"a farthest point of {_place(points[far], distances[far])}"
        hint = "There the arm is straight and cannot follow a path."
        raise InputError(Problem([*named, path.title][0], rule, value, hint))
    # Without a hole, three links or more can pass the base; only their posture may be singular.
    if (inner == 0.0 and len(chain.lengths) > 2) or distances[near] >= inner + margin:
        return
    if inner == 0.0:
        rule = f"stay at least {margin:.3g} m away from the base"
        hint = "There the arm is folded, and its first joint would have to jump."
    else:
        rule = f"stay more than {inner + margin:.9g} m from the base"
        hint = "Closer points cannot be reached, and the folded arm cannot follow a path."
    value = f"a nearest point of {_place(points[near], distances[near])}"
    raise InputError(Problem(path.title, rule, value, hint))


def _place(point: Floats, distance: float) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g}), {distance:.9g} m from it"


_SMALLEST_STRETCH = 1e-4
"""Smallest singular value of J, as a fraction of the reach, at which a posture is still used. A
straight arm a millionth of its reach short of the boundary has about a thousandth."""
_ODE_TOLERANCE = 1e-12
"""Of the least-norm path, far below the 1e-9 to which its rates should agree with it."""
_LONGEST_STEP = 1.0 / 64.0
"""The solver's interpolant has order 7: with this step its error stays below its tolerance."""


class SingularPathError(Exception):
    """The least-norm path reaches a posture in which the tip cannot follow the path."""

    def __init__(self, s: float, posture: Floats) -> None:
        super().__init__(s, posture)
        self.s = s
        self.posture = posture


def _two_link_path(chain: RigidChain, path: TipPath, elbow: str) -> Posture:
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
    return np.asarray(np.arctan2(across, np.sum(old * new, axis=-1)))


def _two_link_posture(
    chain: RigidChain,
    path: TipPath,
    elbow: str,
    nodes: Floats,
    at: Floats,
    directions: Floats,
    s: Floats,
) -> Floats:
    """Return the postures (T, 2) at s, with tip ``at`` (k, 2) m in ``directions`` at ``nodes``."""
    point = path.at(s).point - chain.base
    k = np.searchsorted(nodes, s, side="right") - 1
    turn = directions[k] + _turned(at[k], point)
    bend = elbow_angle(chain.lengths, np.hypot(point[:, 0], point[:, 1]), elbow)
    return np.stack([turn - shoulder_offset(chain.lengths, bend), bend], axis=-1)


def least_norm_path(chain: RigidChain, path: TipPath, first: Floats) -> Posture:
    """Return q(s) -> (T, n) along the least-norm path from posture `first` (n,) at its start."""
    lengths = chain.lengths
    limit = _SMALLEST_STRETCH * float(np.sum(lengths))

    def slope(s: float, angles: Floats) -> Floats:
        (way,) = path.at(np.array([s])).slope
        return np.asarray(_pseudo_inverse(tip_jacobian(lengths, angles)) @ way)

    def clearance(_s: float, angles: Floats) -> float:
        smallest = np.linalg.svd(tip_jacobian(lengths, angles), compute_uv=False)[-1]
        return float(smallest) - limit

    clearance.terminal = True  # type: ignore[attr-defined]
    if clearance(0.0, first) <= 0.0:
        raise SingularPathError(0.0, first)
    times, steps, angles = [0.0], [], first
    for piece in pairwise((0.0, *path.breaks, 1.0)):
        tolerances = {"rtol": _ODE_TOLERANCE, "atol": _ODE_TOLERANCE, "max_step": _LONGEST_STEP}
        method = {"method": "DOP853", "dense_output": True, "events": clearance}
        solution = scipy.integrate.solve_ivp(slope, piece, angles, **method, **tolerances)
        angles = solution.y[:, -1]
        if solution.status != 0:
            raise SingularPathError(float(solution.t[-1]), angles)
        times += solution.t[1:].tolist()
        steps += solution.sol.interpolants
    return partial(_least_norm_posture, chain, path, scipy.integrate.OdeSolution(times, steps))


def _least_norm_posture(
    chain: RigidChain, path: TipPath, near: scipy.integrate.OdeSolution, s: Floats
) -> Floats:
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
    return np.asarray(np.matmul(matrices, vectors[:, :, None])[:, :, 0])


@public_call
def line_motion(
    arm: Arm,
    start: ArrayLike,
    end: ArrayLike,
    duration: float,
    profile: str | TimingLaw = "quintic",
    elbow: str = "up",
    start_time: float = 0.0,
    posture: ArrayLike | None = None,
) -> TipMotion:
    """Return a motion of the rigid arm's tip along a straight line, from rest to rest.

    An arm of three links or more moves its joints with the least-norm rates.

    Args:
        arm: only its link lengths are used, so it may be flexible or rigid.
        start: world (x, y), m.
        end: world (x, y), m.
        duration: s.
        profile: `"quintic"`, `"trapezoidal"` or a `TimingLaw`.
        elbow: `"up"` (for two links: relative elbow angle <= 0) or `"down"` (>= 0).
        start_time: start of the motion, s.
        posture: for three links or more, relative joint angles (n,); the motion starts with the
            nearest ones, and `elbow` is not used. Required for a mechanism, such as one with
            closures or sliding joints, whose joints the position of the tip must determine.

    Raises:
        InputError: if a point of the line is out of reach, or so close to the boundary of the reach
            or to another singular posture that the joints cannot follow, or if an argument has the
            wrong shape or value. A start or an end with the arm fully extended is not permitted
            either: although the tip is at rest there, the elbow angle varies like the square root
            of the distance to this point. Its acceleration is infinite with the quintic law, and
            its rate jumps with the trapezoidal law.
    """
    return tip_motion(arm, line_path(start, end), duration, profile, elbow, start_time, posture)


@public_call
def via_point_motion(
    arm: Arm,
    points: ArrayLike,
    duration: float,
    profile: str | TimingLaw = "quintic",
    elbow: str = "up",
    start_time: float = 0.0,
    posture: ArrayLike | None = None,
    blend: float | None = None,
) -> TipMotion:
    """Return a motion of the rigid arm's tip along straight lines between points.

    The tip stops at the first and at the last point only. It rounds the corners at the others: it
    slows down there, and its acceleration is continuous.

    Args:
        arm, duration, profile, elbow, start_time, posture: see `line_motion`.
        points: world (x, y), (k, 2), m; two or more.
        blend: distance (m) from each corner at which the tip leaves the lines, at most half of the
            shorter line; by default a quarter of it. Where the path turns by an angle a, the tip
            passes the corner at a distance of `0.375 blend sin(a/2)`.

    Raises:
        InputError: under the conditions of `line_motion`, if a point equals the one before it, or
            the corners do not fit on the lines.
    """
    path = polygon_path(points, blend)
    return tip_motion(arm, path, duration, profile, elbow, start_time, posture)


@public_call
def spline_motion(
    arm: Arm,
    points: ArrayLike,
    duration: float,
    profile: str | TimingLaw = "quintic",
    elbow: str = "up",
    start_time: float = 0.0,
    posture: ArrayLike | None = None,
) -> TipMotion:
    """Return a motion of the rigid arm's tip on a cubic spline through points.

    The tip passes through every point without a stop, and its acceleration is continuous. The path
    is parametrised by the lengths of the chords, so the tip follows the timing law nearly as along
    a line of the same length. A last point equal to the first closes the spline without a corner.

    Args:
        arm, duration, profile, elbow, start_time, posture: see `line_motion`.
        points: world (x, y), (k, 2), m; two or more.

    Raises:
        InputError: under the conditions of `line_motion`, or if a point equals the one before it.
    """
    return tip_motion(arm, spline_path(points), duration, profile, elbow, start_time, posture)


@public_call
def circle_motion(
    arm: Arm,
    center: ArrayLike,
    start: ArrayLike,
    angle: float,
    duration: float,
    profile: str | TimingLaw = "quintic",
    elbow: str = "up",
    start_time: float = 0.0,
    posture: ArrayLike | None = None,
) -> TipMotion:
    """Return a motion of the rigid arm's tip on a circle.

    Args:
        arm, duration, profile, elbow, start_time, posture: see `line_motion`.
        center: world (x, y) of the centre, m.
        start: world (x, y) of the tip at the start, m.
        angle: rad, by which the tip turns about the centre; positive is counter-clockwise, and
            `2 * numpy.pi` is a full circle.

    Raises:
        InputError: under the conditions of `line_motion`, if the start is the centre, or the angle
            is zero.
    """
    path = arc_path(center, start, angle)
    warn_of_degrees(angle=(angle,))
    return tip_motion(arm, path, duration, profile, elbow, start_time, posture)
