"""Motions of the tip along a path, validated over the whole path in advance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from flexarm.base.errors import InputError, Problem, shown
from flexarm.motion.geometry.chain import RigidChain, rigid_chain
from flexarm.motion.geometry.inverse_kinematics import (
    check_elbow,
    check_reach,
    posture_at,
    reach_limits,
)
from flexarm.motion.motion import JointState, PathMotion, checked_times
from flexarm.motion.timing import TimingLaw, timing_law
from flexarm.motion.tip.joint_path import (
    SingularPathError,
    least_norm_path,
    path_derivatives,
    two_link_path,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexarm.arm.arm import Arm
    from flexarm.motion.tip.joint_path import Posture
    from flexarm.motion.tip.tip_paths import TipPath

    Floats = NDArray[np.float64]

MARGIN = 1e-6
"""Distance a path keeps from the boundary of the reach, as a fraction of the reach. On the boundary
joint accelerations are infinite, at rest too; here rates are a thousand times those of mid-reach,
which the user may want to see, and the closed form still has ten digits."""


@dataclass(frozen=True, eq=False)
class TipMotion(PathMotion):
    """Motion of the rigid arm's tip along a path p(s).

    Attributes:
        tip_path: the path of the tip.
        posture: angles between the bars as a function of s: (T,) -> (T, n), rad.
    """

    chain: RigidChain = field(repr=False)
    tip_path: TipPath
    duration: float
    law: TimingLaw
    start_time: float
    posture: Posture = field(repr=False)

    @property
    def start(self) -> Floats:
        """World point at which the path starts (2,), m."""
        point: Floats = self.tip_path.at(np.zeros(1)).point[0]
        return point

    @property
    def end(self) -> Floats:
        """World point at which the path ends (2,), m."""
        point: Floats = self.tip_path.at(np.ones(1)).point[0]
        return point

    @property
    def path_breaks(self) -> tuple[float, ...]:
        """See `PathMotion.path_breaks`."""
        return self.tip_path.breaks

    def path(self, s: Floats) -> JointState:
        """Return the postures along the path and their derivatives."""
        angles = self.posture(s)
        tip = self.tip_path.at(s)
        slope, curve = path_derivatives(self.chain.lengths, angles, tip.slope, tip.curve)
        return JointState(angles - self.chain.offset, slope, curve)


def tip_motion(
    arm: Arm,
    path: TipPath,
    duration: float,
    profile: str | TimingLaw,
    elbow: str,
    start_time: float,
    posture: ArrayLike | None,
) -> TipMotion:
    """Return a motion of the rigid arm's tip along a path, from rest to rest.

    Args:
        arm, duration, profile, elbow, start_time, posture: see `line_motion`.
        path: path in world axes.

    Raises:
        InputError: under the conditions of `line_motion`.
    """
    duration, start_time = checked_times(duration, start_time)
    law = timing_law(profile)
    chain = rigid_chain(arm)
    check_elbow(elbow)
    if len(chain.lengths) == 1:
        rule = "has one link, which cannot follow a path of the tip"
        raise InputError(Problem("arm", rule, hint="Its tip moves on a circle: use joint_motion."))
    _check_margins(chain, path)
    first = posture_at(chain, path.at(np.zeros(1)).point[0], elbow, posture) + chain.offset
    if len(chain.lengths) == 2:
        return TipMotion(chain, path, duration, law, start_time, two_link_path(chain, path, elbow))
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
