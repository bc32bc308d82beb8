"""Motions of the tip from rest to rest: along a line, by via points, on a spline, on a circle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm.base.arguments import warn_of_degrees
from flexarm.base.errors import public_call
from flexarm.motion.tip.tip_motion import TipMotion, tip_motion
from flexarm.motion.tip.tip_paths import arc_path, line_path, polygon_path, spline_path

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flexarm.arm.arm import Arm
    from flexarm.motion.timing import TimingLaw


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
            nearest ones, and `elbow` is not used.

    Raises:
        InputError: if a point of the line is out of reach, or so close to the boundary of the reach
            or to another singular posture that the joints cannot follow, or if an argument has the
            wrong shape or value. A start or an end with the arm fully extended is not permitted
            either: although the tip is at rest there, the elbow angle varies like the square root
            of the distance to this point. Its acceleration is infinite with the quintic law, and
            its rate jumps with the trapezoidal law.
    """
    path = line_path(start, end)
    return tip_motion(arm, path, duration, profile, elbow, start_time, posture)


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
    path = spline_path(points)
    return tip_motion(arm, path, duration, profile, elbow, start_time, posture)


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
