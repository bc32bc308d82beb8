"""Straight-line motions of the tip, validated over the whole line in advance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.motion.chain import RigidChain, rigid_chain
from flexarm.motion.inverse_kinematics import (
    check_elbow,
    check_reach,
    inverse_kinematics,
    reach_limits,
)
from flexarm.motion.line_path import (
    SingularPathError,
    least_norm_path,
    path_derivatives,
    two_link_path,
)
from flexarm.motion.motion import JointState, PathMotion, checked_times
from flexarm.motion.timing import TimingLaw, timing_law

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexarm.arm import Arm
    from flexarm.motion.line_path import Posture

    Floats = NDArray[np.float64]

MARGIN = 1e-6
"""Distance a line keeps from the boundary of the reach, as a fraction of the reach. On the boundary
joint accelerations are infinite, at rest too; here rates are a thousand times those of mid-reach,
which the user may want to see, and the closed form still has ten digits."""


@dataclass(frozen=True, eq=False)
class LineMotion(PathMotion):
    """Motion of the rigid arm's tip along a straight line, start + s (end - start).

    Attributes:
        start, end: world points (2,), m.
        posture: angles between the bars as a function of s: (T,) -> (T, n), rad.
    """

    chain: RigidChain = field(repr=False)
    start: Floats
    end: Floats
    duration: float
    law: TimingLaw
    start_time: float
    posture: Posture = field(repr=False)

    def path(self, s: Floats) -> JointState:
        """Return the postures along the line and their derivatives."""
        angles = self.posture(s)
        way = self.end - self.start
        slope, curve = path_derivatives(self.chain.lengths, angles, way)
        return JointState(angles - self.chain.offset, slope, curve)


def line_motion(
    arm: Arm,
    start: ArrayLike,
    end: ArrayLike,
    duration: float,
    profile: str | TimingLaw = "quintic",
    elbow: str = "up",
    start_time: float = 0.0,
    posture: ArrayLike | None = None,
) -> LineMotion:
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
        posture: for three links or more, relative joint angles (n,) near those at the start; then
            `elbow` is not used.

    Raises:
        InputError: if a point of the line is out of reach, or so close to the boundary of the reach
            or to another singular posture that the joints cannot follow, or if an argument has the
            wrong shape or value. A start or an end with the arm fully extended is not permitted
            either: although the tip is at rest there, the elbow angle varies like the square root
            of the distance to this point. Its acceleration is infinite with the quintic law, and
            its rate jumps with the trapezoidal law.
    """
    where = "line_motion"
    duration, start_time = checked_times(where, duration, start_time)
    law = timing_law(where, profile)
    chain = rigid_chain(where, arm)
    lengths = chain.lengths
    start = check_array(where, "start", start, (2,)) - chain.base
    end = check_array(where, "end", end, (2,)) - chain.base
    check_elbow(where, elbow)
    if len(lengths) == 1:
        rule = "has one link, which cannot follow a line"
        hint = "Its tip moves on a circle: use joint_motion."
        raise InputError(Problem(where, "arm", rule, hint=hint))
    check_reach(where, "start", lengths, start)
    check_reach(where, "end", lengths, end)
    _check_margins(where, lengths, start, end)
    if posture is not None:
        posture = check_array(where, "posture", posture, (len(lengths),)) + chain.offset
    first = inverse_kinematics(lengths, start, elbow, posture, where)
    if len(lengths) == 2:
        path = two_link_path(lengths, start, end - start, elbow)
    else:
        path = _redundant_path(where, lengths, start, end, first)
    ends = start + chain.base, end + chain.base
    return LineMotion(chain, *ends, duration, law, start_time, path)


def _check_margins(where: str, lengths: Floats, start: Floats, end: Floats) -> None:
    """Raise if a line reaches the outer boundary of the reach or enters the hole inside it."""
    inner, outer = reach_limits(lengths)
    margin = MARGIN * outer
    for name, point in (("start", start), ("end", end)):  # the farthest point of a line is an end
        distance = float(np.hypot(*point))
        if distance > outer - margin:
            rule = f"be less than {outer - margin:.9g} m from the base"
            hint = "The straight arm cannot follow a line."
            raise InputError(Problem(where, name, rule, _place(point, distance), hint))
    # Without a hole, three links or more can pass the base; only their posture may be singular.
    if inner == 0.0 and len(lengths) > 2:
        return
    nearest = _nearest_to_base(start, end)
    distance = float(np.hypot(*nearest))
    if distance >= inner + margin:
        return
    if inner == 0.0:
        rule = f"stay at least {margin:.3g} m away from the base"
        hint = "There the arm is folded, and its first joint would have to jump."
    else:
        rule = f"stay more than {inner + margin:.9g} m from the base"
        hint = "Closer points cannot be reached, and the folded arm cannot follow a line."
    value = f"a nearest point of {_place(nearest, distance)}"
    raise InputError(Problem(where, "line from start to end", rule, value, hint))


def _nearest_to_base(start: Floats, end: Floats) -> Floats:
    """Return the point (2,) of the line that is nearest to the base."""
    way = end - start
    square = float(way @ way)
    s = float(np.clip(-(start @ way) / square, 0.0, 1.0)) if square > 0.0 else 0.0
    return start + s * way


def _place(point: Floats, distance: float) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g}), {distance:.9g} m from it"


def _redundant_path(
    where: str, lengths: Floats, start: Floats, end: Floats, first: Floats
) -> Posture:
    try:
        return least_norm_path(lengths, start, end - start, first)
    except SingularPathError as singular:
        point = start + singular.s * (end - start)
        problem = Problem(
            where,
            "line from start to end",
            "avoid postures in which all links lie in one line",
            f"in one at ({point[0]:.6g}, {point[1]:.6g}): joint angles "
            f"{shown([round(angle, 4) for angle in singular.posture.tolist()])} rad",
            "Try another posture, the other elbow, or a line farther from the boundary.",
        )
        raise InputError(problem) from None
