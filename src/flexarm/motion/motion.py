"""Motions: joint angles, rates and accelerations as functions of time, from rest to rest.

Most motions are a path q(s), with s from 0 to 1, and a timing law s(u) of the time fraction u. This
module has their interface and the chain rule, so that such a motion only defines its path.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.assembly.coordinates import turning_joints
from flexarm.arm.closed import held_joints
from flexarm.base.arguments import check_number, check_positive, check_times, warn_of_degrees
from flexarm.base.errors import InputError, Problem, check_array, public_call, shown
from flexarm.base.late import interpolate
from flexarm.base.notebook import html_table
from flexarm.motion.geometry.inverse_kinematics import RigidChain, rigid_chain
from flexarm.motion.geometry.mechanism_path import Given, mechanism_path, quintic_table
from flexarm.motion.timing import TimingLaw, timing_law

if TYPE_CHECKING:
    from flexarm.arm.arm import Arm

Floats = NDArray[np.float64]

#: Breaks closer together than this fraction of the duration are merged.
_SAME_TIME = 1e-9


class JointState(NamedTuple):
    """Relative joint angles (rad), rates (rad/s) and accelerations (rad/s^2), shapes (..., n)."""

    angle: Floats
    rate: Floats
    acceleration: Floats


class Motion(ABC):
    """A motion of the joints from rest to rest.

    1. `t` is a time (s) or an array of times (T,); results are (n,) or (T, n), respectively. NaN
       raises an error.
    2. Before `start_time` the arm is at rest in the first posture, and from `end_time` on in the
       last: rates and accelerations are exactly zero there.
    3. Rates and accelerations are the derivatives of the angles, computed analytically and never by
       finite differences.
    4. Between two neighbouring `breaks` all functions are smooth. At a break angles and rates are
       continuous and accelerations may jump. At the break itself they have the value after the
       jump; `np.nextafter(t, -np.inf)` evaluates them before it.

    A subclass sets the three attributes and defines `breaks` and `at`.

    Attributes:
        chain: the rigid chain, n bars.
        duration: time from start to end, s.
        start_time: start of the motion, s.
    """

    #: Whether arrays of times are accepted, rule 1; all references declare it with this name.
    vectorized: ClassVar[bool] = True

    chain: RigidChain
    duration: float
    start_time: float

    @property
    @abstractmethod
    def breaks(self) -> tuple[float, ...]:
        """Increasing times (s), including start and end, at which the motion is not smooth."""

    @abstractmethod
    def at(self, times: Floats) -> JointState:
        """Return angles, rates and accelerations, each (T, n), at `times` (T,), none NaN."""

    def __repr__(self) -> str:
        span = f"{self.start_time:.5g} to {self.end_time:.5g} s"
        return f"<flexarm.{type(self).__name__}: {self._about()}{self.joints} joints, {span}>"

    def _about(self) -> str:
        """Return words for the description of this kind of motion, with a comma; none here."""
        return ""

    def _repr_html_(self) -> str:
        numbers = range(1, self.joints + 1)
        heads = ("", "time (s)", *(f"joint {k}" for k in numbers), "tip x (m)", "tip y (m)")
        times = [self.start_time, self.end_time]
        ends = zip(times, self._state(times).angle.tolist(), self.tip(times).tolist(), strict=True)
        rows = [[time, *angles, *tip] for time, angles, tip in ends]
        title = repr(self).strip("<>")
        return html_table(title, heads, [["start", *rows[0]], ["end", *rows[1]]])

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.chain.joints

    @property
    def end_time(self) -> float:
        """End of the motion, s; the arm is at rest from then on."""
        return self.start_time + self.duration

    @public_call
    def state(self, t: ArrayLike) -> JointState:
        """Return angles, rates and accelerations at `t` together, which is faster than singly."""
        return self._state(t)

    def _state(self, t: ArrayLike) -> JointState:
        times = check_times("t", t)
        shape = (*times.shape, self.joints)
        return JointState(*(part.reshape(shape) for part in self.at(times.reshape(-1))))

    @public_call
    def joint_angle(self, t: ArrayLike) -> Floats:
        """Return the relative joint angles (n,) or (T, n), rad."""
        return self._state(t).angle

    @public_call
    def joint_rate(self, t: ArrayLike) -> Floats:
        """Return the joint rates (n,) or (T, n), rad/s."""
        return self._state(t).rate

    @public_call
    def joint_acceleration(self, t: ArrayLike) -> Floats:
        """Return the joint accelerations (n,) or (T, n), rad/s^2."""
        return self._state(t).acceleration

    @public_call
    def tip(self, t: ArrayLike) -> Floats:
        """Return the tip (2,) or (T, 2) of the rigid arm in world axes, m."""
        return self.chain.tip(self._state(t).angle)

    @public_call
    def sampled(self, rate: float) -> SampledMotion:
        """Tabulate this motion for your own control loop, where one call then takes microseconds.

        Args:
            rate: samples per second, Hz; independent of that of the loop. Between samples the error
                is proportional to the sixth power of the interval; the table reports it.

        Raises:
            InputError: if the rate is not positive, or would require more than a million samples.
        """
        return _sampled_motion(self, rate)


class PathMotion(Motion):
    """A path through joint space with a timing law.

    A subclass sets the attributes and defines `path`, and `path_breaks` if it has any. The path is
    twice continuously differentiable.
    """

    law: TimingLaw  # timing law

    def _about(self) -> str:
        return f"{self.law.name}, "

    @abstractmethod
    def path(self, s: Floats) -> JointState:
        """Return q, dq/ds and d2q/ds2, each (T, n), at path fractions `s` (T,) in [0, 1]."""

    @property
    def path_breaks(self) -> tuple[float, ...]:
        """Increasing s between 0 and 1 at which a third derivative of the path may jump."""
        return ()

    @property
    def breaks(self) -> tuple[float, ...]:
        """Start, end, and the times between them at which law or path is not smooth, s."""
        return self._breaks

    @cached_property
    def _breaks(self) -> tuple[float, ...]:
        own = self._edges
        if not self.path_breaks:
            return tuple(own.tolist())
        passed = self.start_time + self.duration * self.law.inverse(np.array(self.path_breaks))
        # A break of law and path at the same time is one break, in spite of rounding.
        apart = np.abs(passed[:, None] - own).min(axis=1) > _SAME_TIME * self.duration
        return tuple(np.sort(np.concatenate([own, passed[apart]])).tolist())

    def at(self, times: Floats) -> JointState:
        """See `Motion.at`; computed by the chain rule."""
        # Pieces are found by comparing times, not fractions, so that rule 4 holds exactly.
        breaks = self._edges
        piece = breaks.searchsorted(times, side="right") - 1
        local = (times - breaks[piece]) / self.duration
        s, ds, dds = self.law.on_pieces(piece, local)
        q, slope, curve = self.path(s)
        ds, dds = ds[:, None], dds[:, None]
        rate = slope * (ds / self.duration)
        # A product of floats overflows to infinity, whereas a power raises OverflowError.
        squared = self.duration * self.duration
        return JointState(q, rate, (curve * ds**2 + slope * dds) / squared)

    @cached_property
    def _edges(self) -> Floats:
        """Breaks of the timing law, s."""
        inner = (self.start_time + self.duration * u for u in self.law.breaks[1:-1])
        return np.array([self.start_time, *inner, self.end_time])


@dataclass(frozen=True, eq=False, repr=False)
class JointMotion(PathMotion):
    """Synchronous motion of all joints between two postures: q(s) = start + s (end - start).

    Attributes:
        start, end: relative joint angles (n,), rad.
    """

    chain: RigidChain
    start: Floats
    end: Floats
    duration: float
    law: TimingLaw
    start_time: float = 0.0

    def path(self, s: Floats) -> JointState:
        """Return the straight line through joint space and its derivatives."""
        s = s[:, None]
        # Interpolate from both ends, so that the last posture is exactly `end`.
        angles = (1.0 - s) * self.start + s * self.end
        straight = np.zeros_like(angles)
        return JointState(angles, straight + (self.end - self.start), straight)


@dataclass(frozen=True, eq=False, repr=False)
class DrivenMotion(JointMotion):
    """Motion of a rigid mechanism in which some joints move synchronously and the others follow.

    Attributes:
        driven: numbers of the joints that move from ``start`` to ``end``.
    """

    driven: tuple[int, ...] = field(kw_only=True)
    _table: interpolate.PPoly = field(kw_only=True)

    def path(self, s: Floats) -> JointState:
        """Return the postures along the path and their derivatives."""
        return JointState(*(self._table(s, order) for order in range(3)))


@dataclass(frozen=True, eq=False, repr=False)
class DerivedMotion(Motion):
    """A motion computed from another one, whose chain it has; derived classes are dataclasses."""

    motion: Motion  # the original motion
    chain: RigidChain = field(init=False)
    duration: float = field(init=False)
    start_time: float = field(init=False)

    def __post_init__(self) -> None:
        start, duration = self._times()
        object.__setattr__(self, "chain", self.motion.chain)
        object.__setattr__(self, "start_time", start)
        object.__setattr__(self, "duration", duration)

    def _about(self) -> str:
        return f"of a {type(self.motion).__name__}, "

    def _times(self) -> tuple[float, float]:
        """Return the start and the duration, s: by default those of the original motion."""
        return self.motion.start_time, self.motion.duration


@public_call
def joint_motion(
    arm: Arm,
    start: ArrayLike,
    end: ArrayLike,
    duration: float,
    profile: str | TimingLaw = "quintic",
    start_time: float = 0.0,
    driven: Sequence[int] | None = None,
) -> JointMotion:
    """Return a synchronous motion of all joints, from rest at `start` to rest at `end`.

    Args:
        arm: only its number of joints and its lengths are used.
        start: relative joint angles (n,), rad.
        end: relative joint angles (n,), rad.
        duration: s.
        profile: `"quintic"`, `"trapezoidal"` or a `TimingLaw`.
        start_time: start of the motion, s.
        driven: numbers of the joints of a mechanism that move in this way. The others close the
            loops: near `start` at the start, and their `end` has no effect. None for all joints.

    Raises:
        InputError: if an argument has the wrong shape or is not finite, the duration is not
            positive, or the profile is unknown; if the joints `driven` do not determine the
            others, or reach a posture in which these cannot follow.

    Warns:
        ImplausibleValueWarning: if the angles look like degrees.
    """
    duration, start_time = checked_times(duration, start_time)
    law = timing_law(profile)
    chain = rigid_chain(arm)
    angles = {k: check_array(k, v, (arm.n_joints,)) for k, v in (("start", start), ("end", end))}
    turning = turning_joints(arm)
    warn_of_degrees(**{name: values[turning] for name, values in angles.items()})
    if driven is not None:
        held = np.unique(held_joints(arm, driven, "driven"))
        places = np.searchsorted(arm.joint_index, held)
        first, last = angles["start"][places], angles["end"][places]
        straight = partial(_straight, first, last - first)
        table = mechanism_path(arm, angles["start"], places, straight)
        first, last = table(np.array([0.0, 1.0]))
        numbers = tuple(arm.joint_numbers[places].tolist())
        return DrivenMotion(
            chain, first, last, duration, law, start_time, driven=numbers, _table=table
        )
    return JointMotion(chain=chain, **angles, duration=duration, law=law, start_time=start_time)


def _straight(start: Floats, slope: Floats, s: float) -> Given:
    return Given(start + s * slope, slope, np.zeros(len(slope)))


def check_motion(motion: object, arm: Arm | None = None) -> Motion:
    """Return a motion; if an arm is given, one with the same number of joints."""
    if not isinstance(motion, Motion):
        hint = "Create one with fa.line_motion or fa.joint_motion."
        raise InputError(Problem("motion", "be a motion", shown(motion), hint))
    if arm is not None and motion.joints != arm.n_joints:
        rule = f"have the number of joints of the arm ({arm.n_joints})"
        raise InputError(Problem("motion", rule, str(motion.joints)))
    return motion


def checked_times(duration: float, start_time: float) -> tuple[float, float]:
    """Return both as floats; raise if the duration is not positive or is lost in rounding."""
    length = check_positive("duration", duration, "s")
    rule = f"be small enough to resolve a motion of {length:.6g} s"
    begin = check_number("start_time", start_time, lambda t: t + 1e-6 * length != t, rule)
    return length, begin


#: Largest number of samples of a table: for two joints it takes 100 MB.
_MOST_SAMPLES = 10**6
#: Fractions of an interval at which the error of the table is largest: for the acceleration the
#: first and the last, for the rate the second, for the angle the middle.
_TESTS = np.array([0.14, 0.28, 0.5, 0.86])


class TabulatedMotion(Motion):
    """A motion whose joint angles are piecewise polynomials of time.

    A subclass sets the table, whose first and last polynomial are constants, for the rest before
    and after the motion.
    """

    _table: interpolate.PPoly

    @public_call
    def joint_angle(self, t: ArrayLike) -> Floats:
        return self._derivative(check_times("t", t), 0)

    @public_call
    def joint_rate(self, t: ArrayLike) -> Floats:
        return self._derivative(check_times("t", t), 1)

    @public_call
    def joint_acceleration(self, t: ArrayLike) -> Floats:
        return self._derivative(check_times("t", t), 2)

    @public_call
    def at(self, times: Floats) -> JointState:
        checked = check_times("times", times)
        return JointState(*(self._derivative(checked, order) for order in range(3)))

    def _derivative(self, times: Floats, order: int) -> Floats:
        ends = self._table.x[0], self._table.x[-1]
        return np.asarray(self._table(np.minimum(np.maximum(times, ends[0]), ends[1]), order))


@dataclass(frozen=True, eq=False, repr=False)
class SampledMotion(TabulatedMotion, DerivedMotion):
    """A motion tabulated at a constant rate, with polynomials of degree 5 between the samples.

    At the samples angles, rates and accelerations are those of the original. In between, rates and
    accelerations are the derivatives of the tabulated angles. The breaks, and the rest before and
    after the motion, are preserved. ``tip`` is that of the original.

    Attributes:
        rate: samples per second, Hz.
        error: largest differences from the original, at four instants between neighbouring samples:
            angle (rad), rate (rad/s) and acceleration (rad/s^2) of each joint, (n,) each.
    """

    rate: float
    error: JointState
    _table: interpolate.PPoly

    @property
    def breaks(self) -> tuple[float, ...]:
        """Breaks of the original, s."""
        return self.motion.breaks

    @property
    def end_time(self) -> float:
        return self.motion.end_time

    def tip(self, t: ArrayLike) -> Floats:
        """Return the tip (2,) or (T, 2) of the original, world axes, m, without tabulation."""
        return self.motion.tip(t)


def _sampled_motion(motion: Motion, rate: float) -> SampledMotion:
    """Tabulate a motion at a rate (Hz), at most a million times; see ``Motion.sampled``."""
    most = _MOST_SAMPLES / motion.duration
    rule = f"be greater than 0 and at most {most:.6g} for a motion of {motion.duration:.6g} s"
    frequency = check_number("rate", rate, lambda hertz: 0.0 < hertz <= most, rule)
    pieces = [_nodes(a, b, frequency) for a, b in pairwise(motion.breaks)]
    starts = np.concatenate([nodes[:-1] for nodes in pieces])
    ends = np.concatenate([nodes[1:] for nodes in pieces])
    # At a break the acceleration has the value after the jump; evaluate just before it instead.
    before = [np.append(nodes[1:-1], np.nextafter(nodes[-1], -np.inf)) for nodes in pieces]
    rests = motion.joint_angle([motion.start_time - 1.0, motion.end_time])
    states = motion.state(starts), motion.state(np.concatenate(before))
    table = quintic_table(np.append(starts, ends[-1]), *states, rests)
    times = (starts[:, None] + (ends - starts)[:, None] * _TESTS).reshape(-1)
    exact = motion.state(times)
    error = (np.abs(table(times, order) - part).max(axis=0) for order, part in enumerate(exact))
    return SampledMotion(motion, frequency, JointState(*error), table)


def _nodes(start: float, end: float, rate: float) -> Floats:
    """Return evenly spaced times from start to end, at least as close as the rate requires."""
    count = max(int(np.ceil((end - start) * rate * (1.0 - 1e-9))), 1)
    return np.linspace(start, end, count + 1)
