"""The problem of an optimal motion: arm, rest at both ends, objective, limits; its plans."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_limits, check_nonnegative, check_numbers
from flexarm.base.errors import InputError, Problem, problems_of, public_call, raise_any, shown
from flexarm.integrate.implicit.gauss import gauss_coefficients
from flexarm.linear import Equilibrium, equilibrium, modes
from flexarm.model import RoundWall, Wall
from flexarm.simulation.histories.piecewise import PiecewiseCubic

#: Objectives: minimal duration, integral of squared torques, integral of the kinetic energy of
#: bending.
OBJECTIVES = ("time", "energy", "vibration")


@dataclass(frozen=True, eq=False)
class Task:
    """Problem of an optimal motion."""

    arm: Arm  # the arm
    start: Equilibrium  # equilibria between which the arm moves
    end: Equilibrium  # equilibria between which the arm moves
    objective: str  # one of `OBJECTIVES`
    duration: float | None  # s; None if it is free
    torque: FloatArray  # largest magnitudes (joints,), N m and N m/s; infinite without a limit
    torque_rate: FloatArray  # largest magnitudes (joints,), N m and N m/s; infinite without a limit
    bounds: tuple[Bound, ...]  # bounds of the other quantities
    modes: int | None  # number of the lowest vibrations that are at rest at the end; None for all

    @property
    def continuous(self) -> bool:
        """Whether the torque is continuous: with a limit of its rate."""
        return bool(np.any(np.isfinite(self.torque_rate)))

    @property
    def elastic(self) -> NDArray[np.intp]:
        """Indices of the coordinates that are not angles of the motors."""
        return np.setdiff1d(np.arange(self.arm.dof), self.arm.joint_index)

    def slack(self, bound: Bound) -> FloatArray:
        """Return how far the start and the end are within a bound, (k,), at least zero."""
        ends = [bound.excess(_at_rest(self.arm, rest, bound)) for rest in (self.start, self.end)]
        return np.asarray(np.maximum(-np.max(ends, axis=0), 0.0))

    @property
    def vibrations(self) -> FloatArray:
        """Largest angular frequencies of vibrations with free joints at both ends, rad/s."""
        arm = self.arm
        if not len(self.elastic):
            return np.zeros(0)
        ends = [modes(arm, q=rest.q, joints="free").frequency_hz for rest in (self.start, self.end)]
        return np.asarray(2.0 * np.pi * np.max(ends, axis=0)[arm.n_joints :])

    def resting_modes(self) -> FloatArray | None:
        """Return rows (m, dof) that are zero, times q minus its end and times qd, at the end.

        They are amplitudes of modes with free joints: the motions of the rigid arm, without which
        it would drift after the end although its joints rest, and the lowest vibrations. None if
        these and the joints are all coordinates.
        """
        arm = self.arm
        if self.modes is None or 2 * arm.n_joints + self.modes >= arm.dof:
            return None
        shapes = modes(arm, q=self.end.q, joints="free").shapes[: arm.n_joints + self.modes]
        return np.asarray(shapes @ arm.mass_matrix(self.end.q))


def task_of(
    arm: Arm,
    start: FloatArray,
    end: FloatArray,
    objective: str,
    limits: MotionLimits,
    duration: float | None,
    count: int | None,
) -> Task:
    """Return the problem between two postures, which are equilibria (joints,), rad."""
    torque, torque_rate = torque_limits(limits, arm)
    bounds = bounds_of(limits, arm)
    ends = equilibrium(arm, start), equilibrium(arm, end)
    problems = []
    if np.array_equal(start, end):
        problems.append(Problem("end", "differ from start", shown(end.tolist())))
    if (duration is None) != (objective == "time"):
        word = "free" if objective == "time" else "required"
        rule = f"is {word} for the objective {objective!r}"
        problems.append(Problem("duration", rule))
    if objective == "time" and not np.all(np.isfinite(torque)):
        hint = "Without it the motion takes no time."
        rule = "is required for every joint by the objective 'time'"
        problems.append(Problem("limits.torque", rule, hint=hint))
    if objective == "vibration" and arm.dof == arm.n_joints:
        problems.append(Problem("arm", "is rigid, so nothing vibrates"))
    for name, rest in zip(("start", "end"), ends, strict=True):
        if np.any(np.abs(rest.torque) > torque):
            rule = f"be at least the torque that holds the arm at the {name}, "
            rule += f"{_listed(rest.torque)} N m"
            problems.append(Problem("limits.torque", rule, _listed(torque)))
        for bound in bounds:
            value = _at_rest(arm, rest, bound)
            if bound.name == "clearance":
                problems += _inside(name, value[:, 0])
            elif np.any(bound.excess(value) > 0.0):
                where = f"{bound.name} is {_listed(value[:, 0])}{UNITS[bound.name]}"
                permitted = f"{_listed(bound.lower)} to {_listed(bound.upper)}"
                rule = f"permit the {name}, where {where}"
                problems.append(Problem(f"limits.{bound.name}", rule, permitted))
    problems += _too_short(end - start, duration, bounds)
    raise_any(problems)
    return Task(arm, *ends, objective, duration, torque, torque_rate, bounds, count)


def _inside(name: str, distances: FloatArray) -> list[Problem]:
    """Return the obstacles that contain the tip at rest, from its distances (obstacles,)."""
    hint = "The normal of a Wall points out of the solid; a RoundWall is solid unless inside=True."
    rule = f"contains the tip at the {name}, clearance included"
    return [
        Problem(f"limits.obstacles[{i}]", rule, hint=hint) for i in np.flatnonzero(distances < 0.0)
    ]


def _at_rest(arm: Arm, rest: Equilibrium, bound: Bound) -> FloatArray:
    """Return the quantity of a bound at rest, (k, 1)."""
    angle, q = arm.joint_angles(rest.q), rest.q
    still = Quantities(angle, np.zeros(arm.n_joints), arm.strain(q), arm.tip(q))
    return np.array(bound.value(still), dtype=np.float64)[:, None]


def _too_short(
    change: FloatArray, duration: float | None, bounds: tuple[Bound, ...]
) -> list[Problem]:
    """Return a problem if a joint cannot reach the end in time at its largest rate."""
    if duration is None:
        return []
    needed = max(
        (float(np.max(np.abs(change) / b.upper)) for b in bounds if b.name == "joint_rate"),
        default=0.0,
    )
    if duration > needed:
        return []
    rule = f"be greater than {needed:.6g} s, the time at the largest joint rates"
    return [Problem("duration", rule, shown(duration))]


def _listed(values: FloatArray) -> str:
    """Format numbers, one without brackets."""
    text = ", ".join(f"{value:.6g}" for value in values)
    return text if len(values) == 1 else f"[{text}]"


#: Gauss collocation with three stages in each interval, order 6.
GAUSS = gauss_coefficients(3)
STAGES = len(GAUSS.c)


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion over N intervals of equal length.

    Time is a fraction s = t / T of the duration T, so that the duration is one variable of the
    search among others: rates are dq/ds, accelerations d2q/ds2.
    """

    duration: float  # T, s
    q: FloatArray  # (N + 1, dof) coordinates at the nodes
    slope: FloatArray  # (N + 1, dof) dq/ds at the nodes
    curve: FloatArray  # (N, 3, dof) d2q/ds2 at the stages
    #: (N, 2, joints) N m at the start and at the end of each interval, linear in between
    torque: FloatArray

    @property
    def intervals(self) -> int:
        """Number of intervals N."""
        return len(self.curve)

    @property
    def times(self) -> FloatArray:
        """Times of the nodes (N + 1,), s."""
        return np.linspace(0.0, self.duration, self.intervals + 1)

    @property
    def rate(self) -> FloatArray:
        """Rates (N + 1, dof) at the nodes."""
        return self.slope / self.duration

    def refined(self, intervals: int, continuous: bool) -> Plan:
        """Return the motion over other intervals, with continuous torques or constant ones."""
        nodes = np.linspace(0.0, 1.0, intervals + 1)
        stages = (nodes[:-1, None] + GAUSS.c / intervals).ravel()
        q, slope, _ = self._at(nodes)
        curve = self._at(stages)[2].reshape(intervals, STAGES, -1)
        if continuous:
            known = np.concatenate([self.torque[:, 0], self.torque[-1:, 1]])
            ends = np.array([np.interp(nodes, self.times / self.duration, u) for u in known.T]).T
            torque = np.stack([ends[:-1], ends[1:]], axis=1)
        else:
            middle = 0.5 * (nodes[1:] + nodes[:-1])
            torque = self.torque[(middle * self.intervals).astype(int)]
        return Plan(self.duration, q, slope, curve, torque)

    def _at(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, dq/ds and d2q/ds2 at fractions s (k,) of the duration, each (k, dof)."""
        h, powers = 1.0 / self.intervals, np.arange(STAGES)
        piece = np.minimum((s * self.intervals).astype(int), self.intervals - 1)
        x = (s * self.intervals - piece)[:, None]
        # Coefficients of the polynomials through the stages, by powers of x.
        c = np.linalg.inv(GAUSS.c[:, None] ** powers) @ self.curve[piece]
        once = x ** (powers + 1) / (powers + 1)
        twice = x ** (powers + 2) / ((powers + 1) * (powers + 2))
        parts = (np.einsum("kp,kpd->kd", basis, c) for basis in (x**powers, once, twice))
        curve, slope, q = parts
        first = self.slope[piece]
        return self.q[piece] + h * x * first + h * h * q, first + h * slope, curve

    def torque_history(self, before: FloatArray, after: FloatArray) -> PiecewiseCubic:
        """Return the torques over time, with constant ones (joints,) before and after, N m."""
        times, (first, last) = self.times, self.torque.swapaxes(0, 1)
        coefficients = np.zeros((self.intervals + 2, 4, first.shape[1]))
        coefficients[[0, -1], 0] = before, after
        coefficients[1:-1, 0] = first
        coefficients[1:-1, 1] = (last - first) / np.diff(times)[:, None]
        breaks = np.concatenate([[-self.duration], times, [2.0 * self.duration]])
        return PiecewiseCubic(breaks, coefficients, times[1:])


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
        for wall in () if problems else self.obstacles:
            if isinstance(wall, RoundWall) and wall.inside and wall.radius <= self.clearance:
                rule = f"be less than the radius of the circle around the arm, {wall.radius:.6g} m"
                problems = [Problem("clearance", rule, shown(self.clearance))]
                break
        raise_any(problems)


def _angle_range(given: Any) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest joint angles, each () or (joints,), rad."""
    rule = "be a pair: the lowest angle and a higher one, or lists of them"
    array = isinstance(given, np.ndarray) and given.ndim > 0
    if not (array or isinstance(given, list | tuple)) or len(given) != 2:
        raise InputError(Problem("joint_angle", rule, shown(given)))
    lower, upper = (check_numbers("joint_angle", part, rule) for part in given)
    alike = max(lower.ndim, upper.ndim) < 2 and len({1, lower.size, upper.size}) < 3
    if not (alike and np.all(lower < upper)):
        raise InputError(Problem("joint_angle", rule, shown(given)))
    return lower, upper


class Quantities(NamedTuple):
    """Quantities of a state that limits are about: numbers, arrays or CasADi expressions.

    Arrays over time have it as their last axis.
    """

    joint_angle: Any  # (joints,) rad
    joint_rate: Any  # (joints,) rad/s
    strain: Any  # (gauges,)
    tip: Any  # x, y, m


class Bound(NamedTuple):
    """Bounds of one quantity along a motion."""

    name: str  # name of the limit
    value: Callable[[Quantities], Any]  # function of `Quantities` that returns (k,) values
    lower: FloatArray  # (k,), infinite for no bound
    upper: FloatArray  # (k,), infinite for no bound

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
        rate = _each("joint_rate", limits.joint_rate, arm.n_joints)
        found.append(Bound("joint_rate", attrgetter("joint_rate"), -rate, rate))
    if limits.joint_angle is not None:
        pair = _angle_range(limits.joint_angle)
        lower, upper = (_each("joint_angle", part, arm.n_joints) for part in pair)
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
        np.full(arm.n_joints, np.inf) if given is None else _each(name, given, arm.n_joints)
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
