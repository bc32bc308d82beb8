"""Limits of optimal motions, and the same limits as bounds of quantities along a motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_limits, check_nonnegative, check_numbers
from flexarm.base.errors import InputError, Problem, problems_of, public_call, shown
from flexarm.model import RoundWall, Wall

#: Limits of magnitudes, one number or one per joint; those of strains have one per gauge.
_MAGNITUDES = ("torque", "torque_rate", "joint_rate", "strain")
#: Units of the limited quantities; a strain has none.
UNITS = {
    "torque": " N m",
    "torque_rate": " N m/s",
    "joint_rate": " rad/s",
    "joint_angle": " rad",
    "strain": "",
    "clearance": " m",
}


@dataclass(frozen=True)
class MotionLimits:
    """Limits of an optimal motion; None for no limit.

    A limit of a magnitude is a positive number, or one for each joint or gauge.

    Attributes:
        torque: N m.
        torque_rate: N m/s. The torque is then continuous and starts and ends with the torque that
            holds the arm; without this limit it may jump.
        joint_rate: rad/s.
        joint_angle: lowest and highest angle, rad: a pair of numbers, or of lists with one number
            for each joint.
        strain: of the gauges of the arm.
        obstacles: surfaces that the tip must not enter: `Wall`, a half-plane, or `RoundWall`, a
            disk or, with ``inside=True``, all points outside a circle.
        clearance: least distance of the tip from obstacles, m.

    Raises:
        InputError: if a limit is not positive, the lowest angle is not below the highest, or an
            obstacle is not a `Wall` or a `RoundWall`.
    """

    torque: ArrayLike | None = None
    torque_rate: ArrayLike | None = None
    joint_rate: ArrayLike | None = None
    joint_angle: tuple[ArrayLike, ArrayLike] | None = None
    strain: ArrayLike | None = None
    obstacles: Sequence[Wall | RoundWall] = ()
    clearance: float = 0.0

    @public_call
    def __post_init__(self) -> None:
        problems: list[Problem] = []
        for name in _MAGNITUDES:
            if getattr(self, name) is not None:
                problems += problems_of(check_limits, name, getattr(self, name))
        if self.joint_angle is not None:
            problems += problems_of(_angle_range, self.joint_angle)
        if not isinstance(self.obstacles, list | tuple):
            problems.append(Problem("obstacles", "be a list of surfaces", shown(self.obstacles)))
        else:
            for i, one in enumerate(self.obstacles):
                if not isinstance(one, Wall | RoundWall):
                    problem = Problem(f"obstacles[{i}]", "be a Wall or a RoundWall", shown(one))
                    problems.append(problem)
        problems += problems_of(check_nonnegative, "clearance", self.clearance)
        if problems or (problems := self._no_room()):
            raise InputError(*problems)

    def _no_room(self) -> list[Problem]:
        """Return a problem if the clearance fills a circle with the arm inside."""
        for one in self.obstacles:
            if isinstance(one, RoundWall) and one.inside and one.radius <= self.clearance:
                rule = f"be less than the radius of the circle around the arm, {one.radius:.6g} m"
                return [Problem("clearance", rule, shown(self.clearance))]
        return []


def _angle_range(given: Any) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest joint angles, each () or (joints,), rad."""
    rule = "be a pair: the lowest angle and a higher one, or lists of them"
    if not isinstance(given, list | tuple | np.ndarray) or len(given) != 2:
        raise InputError(Problem("joint_angle", rule, shown(given)))
    lower, upper = (check_numbers("joint_angle", part, rule) for part in given)
    if max(lower.ndim, upper.ndim) > 1 or not _less(lower, upper):
        raise InputError(Problem("joint_angle", rule, shown(given)))
    return lower, upper


def _less(lower: FloatArray, upper: FloatArray) -> bool:
    try:
        return bool(np.all(lower < upper))
    except ValueError:  # lists of different lengths
        return False


class Quantities(NamedTuple):
    """Quantities of a state that limits are about: numbers, arrays or CasADi expressions.

    Arrays over time have it as their last axis.
    """

    joint_angle: Any  # (joints,) rad
    joint_rate: Any  # (joints,) rad/s
    strain: Any  # (gauges,)
    tip: Any  # x, y, m


class Bound(NamedTuple):
    """Bounds of one quantity along a motion.

    Attributes:
        name: name of the limit.
        value: function of `Quantities` that returns (k,) values.
        lower, upper: (k,), infinite for no bound.
    """

    name: str
    value: Callable[[Quantities], Any]
    lower: FloatArray
    upper: FloatArray

    @property
    def size(self) -> FloatArray:
        """Size of the values (k,): the larger magnitude of finite bounds; 1 if that is zero."""
        finite = [np.where(np.isfinite(b), np.abs(b), 0.0) for b in (self.lower, self.upper)]
        largest = np.maximum(*finite)
        return np.asarray(np.where(largest > 0.0, largest, 1.0))

    def excess(self, values: FloatArray) -> FloatArray:
        """Return the largest excess (k,) of values (k, T) over the bounds; negative within them."""
        below, above = self.lower - values.min(axis=1), values.max(axis=1) - self.upper
        return np.asarray(np.maximum(below, above))

    def within(self, margin: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the bounds, narrower by a margin (k,)."""
        return self.lower + margin, self.upper - margin


def bounds_of(limits: MotionLimits, arm: Arm) -> tuple[Bound, ...]:
    """Return the bounds of quantities of the state; for torques there is `torque_limits`."""
    found = []
    if limits.joint_rate is not None:
        rate = _each("joint_rate", limits.joint_rate, arm.joints)
        found.append(Bound("joint_rate", attrgetter("joint_rate"), -rate, rate))
    if limits.joint_angle is not None:
        pair = _angle_range(limits.joint_angle)
        lower, upper = (_each("joint_angle", part, arm.joints) for part in pair)
        found.append(Bound("joint_angle", attrgetter("joint_angle"), lower, upper))
    if limits.strain is not None:
        gauges = sum(len(link.gauges) for link in arm.spec.links)
        if gauges == 0:
            hint = "Give its links gauges: fa.Link(..., gauges=[fa.Gauge(...)])."
            raise InputError(Problem("arm", "has no gauges, so strain has no limit", hint=hint))
        strain = _each("strain", limits.strain, gauges)
        found.append(Bound("strain", attrgetter("strain"), -strain, strain))
    if limits.obstacles:
        obstacles = tuple(limits.obstacles)
        distances = _Distances(obstacles, float(limits.clearance))
        zero, none = np.zeros(len(obstacles)), np.full(len(obstacles), np.inf)
        found.append(Bound("clearance", distances, zero, none))
    return tuple(found)


def torque_limits(limits: MotionLimits, arm: Arm) -> tuple[FloatArray, FloatArray]:
    """Return the largest torques and torque rates (joints,); infinite without a limit."""
    torque, rate = (
        np.full(arm.joints, np.inf) if given is None else _each(name, given, arm.joints)
        for name, given in (("torque", limits.torque), ("torque_rate", limits.torque_rate))
    )
    return torque, rate


def _each(name: str, given: ArrayLike, count: int) -> FloatArray:
    """Return one number for each joint or gauge."""
    numbers = np.asarray(given, dtype=np.float64)
    if numbers.ndim and numbers.size != count:
        rule = f"be one number, or a list of {count}"
        raise InputError(Problem(f"limits.{name}", rule, f"{numbers.size} numbers"))
    return np.array(np.broadcast_to(numbers, (count,)))


@dataclass(frozen=True)
class _Distances:
    """Distances of the tip from obstacles minus a clearance, m; negative where it is too near.

    Those from circles are (r^2 - R^2) / (2 R), where R includes the clearance. This is smooth at
    the centre, and equals the distance r - R near the circle.
    """

    obstacles: tuple[Wall | RoundWall, ...]
    clearance: float

    def __call__(self, state: Quantities) -> list[Any]:
        x, y = state.tip[0], state.tip[1]
        return [_distance(one, self.clearance, x, y) for one in self.obstacles]


def _distance(one: Wall | RoundWall, clearance: float, x: Any, y: Any) -> Any:
    if isinstance(one, Wall):
        length = math.hypot(*one.normal)
        nx, ny = one.normal[0] / length, one.normal[1] / length
        return nx * (x - one.point[0]) + ny * (y - one.point[1]) - clearance
    R = one.radius - clearance if one.inside else one.radius + clearance
    x, y = x - one.center[0], y - one.center[1]
    outside = (x * x + y * y - R * R) / (2.0 * R)
    return -outside if one.inside else outside
