"""Tasks: reach a point, follow a line, and slide along a wall with a changing contact force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_number
from flexarm.base.errors import InputError, Problem, check_array, public_call, shown
from flexarm.bridges.gymnasium_env.base import MOST_FORCE, ArmEnv, FloatArray, Part, PlantSource
from flexarm.model import Contact, Wall
from flexarm.motion import line_motion
from flexarm.motion.tip.tip_motion import TipMotion

#: Largest initial joint angle (rad), unless a stop is closer.
_RANGE = 2.5
#: Largest joint angle (rad) between the start and the posture whose tip is the goal.
_TURN = 0.6
#: Success: largest distance (fraction of the reach) and speed (reaches per second) of the tip.
_NEAR, _SLOW = 0.01, 0.05


class ReachEnv(ArmEnv):
    """Move the tip to a random goal, and keep it there without vibration.

    The goal is the tip of the arm with straight links after turning each joint by up to 0.6 rad
    from a random posture, which is the start. The task adds to the observation: ``goal`` (2,) m.
    The reward is half of its maximum at a distance of a twentieth of the reach. ``is_success``: the
    tip is within a hundredth of the reach of the goal, and slower than a twentieth of the reach
    per second.

    ``reset(options={"start": ..., "goal": ...})`` accepts joint angles (joints,) rad instead of
    random ones. ``info`` also contains ``goal_joint_angle`` (joints,) rad, the solution of the
    inverse kinematics. See ``ArmEnv`` for everything else.
    """

    scale: ClassVar[float] = 0.05
    option_names: ClassVar[tuple[str, ...]] = ("start", "goal")

    def task_parts(self) -> Sequence[Part]:
        return [Part("goal", "m", 2, self.reach, axes=True)]

    def begin(self, options: dict[str, Any]) -> FloatArray:
        shape = (self.arm.n_joints,)
        lower, upper = _joint_range(self)
        start = self.np_random.uniform(lower, upper)
        if "start" in options:
            start = check_array("start", options["start"], shape)
        turn = self.np_random.uniform(-_TURN, _TURN, shape)
        self.goal_angle = np.clip(start + turn, np.minimum(lower, start), np.maximum(upper, start))
        if "goal" in options:
            self.goal_angle = check_array("goal", options["goal"], shape)
        self.task_table = self.arm.tip(self.arm.rest(self.goal_angle))[None, :2]
        return start

    def task_info(self) -> dict[str, FloatArray]:
        return {"goal_joint_angle": self.goal_angle.copy()}

    def succeeded(self, values: FloatArray, info: Mapping[str, Any]) -> Any:
        near = info["distance"] < _NEAR * self.reach
        return near & (info["speed"] < _SLOW * self.reach)


def _joint_range(env: ArmEnv) -> tuple[FloatArray, FloatArray]:
    """Return the bounds (joints,) of initial joint angles, rad."""
    lower = np.full(env.arm.n_joints, -_RANGE)
    upper = -lower
    for k, number in enumerate(env.arm.joint_numbers):
        limits = env.arm.spec.joints[number - 1].limits
        if limits is not None:
            lower[k], upper[k] = max(lower[k], limits.lower), min(upper[k], limits.upper)
    return lower, upper


#: Bounds of a line's length (fraction of the reach) and of the mean speed (reaches per second).
_LENGTHS, _SPEED = (0.15, 0.4), (0.2, 0.4)
#: Largest joint rates (rad/s); a line with larger ones is too close to a singular posture.
_FASTEST_LINE = 3.0
_LINE_TRIES = 200


class _LineEnv(ArmEnv):
    """Task along a line, the start of both tasks' tables."""

    scale: ClassVar[float] = 0.02
    motion: TipMotion

    def line_parts(self, most_time: float) -> list[Part]:
        """Return the components of the observation that describe the line."""
        return [
            Part("wanted_tip", "m", 2, self.reach, axes=True),
            Part("wanted_velocity", "m/s", 2, 10.0 * self.reach, axes=True),
            Part("line_end", "m", 2, self.reach, axes=True),
            Part("time_left", "s", 1, most_time),
        ]

    def line_columns(self, times: FloatArray) -> list[FloatArray]:
        """Return the values of these components at times (T,), s."""
        motion = self.motion
        along = motion.law(np.clip((times - motion.start_time) / motion.duration, 0.0, 1.0))
        way = motion.end - motion.start
        return [
            motion.start + np.outer(along.s, way),
            np.outer(along.ds / motion.duration, way),
            np.tile(motion.end, (len(times), 1)),
            np.maximum(motion.end_time - times, 0.0),
        ]

    @property
    def times(self) -> FloatArray:
        """Sample times of an episode (ticks + 1,), s."""
        return np.arange(self.ticks + 1, dtype=np.float64) * self.plant.sample_time


class TrackPathEnv(_LineEnv):
    """Follow a point that moves along a random line, and come to rest at its end.

    The line begins at a random posture and has a length of 0.15 to 0.4 of the reach, a random
    direction, and a mean speed of 0.2 to 0.4 reaches per second, from rest to rest. The task adds
    to the observation: ``wanted_tip`` (2,) m and ``wanted_velocity`` (2,) m/s of the point,
    ``line_end`` (2,) m, and ``time_left`` (1,) s until the end. The reward is half of its maximum
    at a distance of a fiftieth of the reach from the point. ``is_success``: the line has ended and
    the tip is within a hundredth of the reach of its end.

    ``reset(options={"start": ..., "end": ..., "duration": ...})`` accepts world points (2,) m, and
    s, all three together. ``motion`` is the ``line_motion`` of the point. See ``ArmEnv`` for
    everything else.
    """

    option_names: ClassVar[tuple[str, ...]] = ("start", "end", "duration")

    def task_parts(self) -> Sequence[Part]:
        return self.line_parts(self.ticks * self.plant.sample_time)

    def begin(self, options: dict[str, Any]) -> FloatArray:
        missing = [name for name in self.option_names if name not in options]
        if not options:
            self.motion = self._drawn()
        elif missing:
            rule = "have no " + " and no ".join(map(repr, missing))
            raise InputError(Problem("the options", rule))
        else:
            self.motion = line_motion(self.arm, **options)
        self.task_table = np.column_stack(self.line_columns(self.times))
        return self.motion.joint_angle(0.0)

    def _drawn(self) -> TipMotion:
        """Draw a random line that the arm can follow at its speed."""
        rng, reach = self.np_random, self.reach
        for _ in range(_LINE_TRIES):
            start = self.arm.tip(self.arm.rest(rng.uniform(*_joint_range(self))))[:2]
            direction = rng.uniform(-np.pi, np.pi)
            length, speed = reach * rng.uniform(*_LENGTHS), reach * rng.uniform(*_SPEED)
            end = start + length * np.array([np.cos(direction), np.sin(direction)])
            try:
                motion = line_motion(self.arm, start, end, length / speed)
            except InputError:
                continue
            rates = motion.joint_rate(np.linspace(0.0, motion.duration, 33))
            if np.abs(rates).max() < _FASTEST_LINE:
                return motion
        raise InputError(Problem("the arm", f"cannot follow any of {_LINE_TRIES} random lines"))

    def succeeded(self, values: FloatArray, info: Mapping[str, Any]) -> Any:
        return (values[..., 6] == 0.0) & (info["distance"] < _NEAR * self.reach)


#: Start time and duration of the sliding motion, s.
_TOUCHDOWN, _SLIDE = 0.5, 2.0
#: Length of the sliding motion, as a fraction of the reach: 0.3 m with the default arm.
_LENGTH = 0.125
#: Initial distance (m) of the tip from the wall.
_GAP = 0.005
#: Largest angle (rad) of a wall's normal to the base direction: the base is then on its free side.
_WALL_TURN = np.pi / 6.0
#: Bounds of the distance of a line from the base, as fractions of the reach. Farther away the arm
#: is almost straight, and too stiff.
_NEAREST, _FARTHEST = 0.5, 0.85
#: Largest joint rates (rad/s) along a line, and largest static torque of the maximum force as a
#: fraction of the torque limits; more would bend the links too far.
_FASTEST, _SHARE = 1.0, 0.4
_TRIES = 500
#: Force error (fraction of the mean force) that halves the reward, and limit on the scaled error.
_FORCE_SCALE, _MOST_MISS = 0.2, 100.0


class TrackForceEnv(_LineEnv):
    """Slide the tip along a random wall and press on it with a changing force.

    The arm starts at rest, with its tip at least 5 mm before the wall. The reference force is
    ``force[0] - force[1] cos(2 pi t / period)`` from the start. From 0.5 s to 2.5 s a point moves
    along the wall by an eighth of the reach (0.3 m), from rest to rest. The wall has a random
    position and faces the base, turned by up to 30 degrees. Only the tip has contact with it.

    The task adds to the observation: ``wanted_tip`` (2,) m and ``wanted_velocity`` (2,) m/s of the
    point, ``line_end`` (2,) m, ``time_left`` (1,) s until the end of the line, ``wall_normal``
    (2,) away from the wall, ``wanted_force`` (1,) N and ``wanted_force_rate`` (1,) N/s. The exact
    instruments include the ``contact_force`` on the arm, (2,) N in world axes; each component of
    an observation is clipped to 100 N.

    The reward of a step is ``1 / (1 + distance / (0.02 reach) + force_error / (0.2 force[0]))``,
    minus the torque penalty; the force term is at most 100. ``is_success``: the line has ended, the
    tip is within a hundredth of the reach of its end, and the force error is below a fifth of the
    mean force.

    ``reset(options={"start": ..., "end": ..., "stiffness": ..., "friction": ..., "place": ...})``
    accepts both ends of the line on the wall, world points (2,) m, together; each of the other
    options replaces a random value. ``info`` also contains ``force``, the contact force of the tip,
    and ``force_error``, N. ``motion`` is the ``line_motion`` along the wall, ``normal`` the wall's.
    See ``ArmEnv`` for everything else.

    Args:
        arm, plant: see ``ArmEnv``.
        force: mean and amplitude of the reference force, N.
        period: of its change, s.
        stiffness: of the wall, N/m; or the bounds of a random value for each episode, with a
            log-uniform distribution.
        friction: coefficient; or the bounds of a random value for each episode.
        damping, exponent: of the wall, see ``flexarm.Contact``.
        place: m, largest random offset of the wall from its nominal position along the normal.
        others: further arguments of ``ArmEnv``.

    Raises:
        InputError: if an argument is not valid.
    """

    option_names: ClassVar[tuple[str, ...]] = ("start", "end", "stiffness", "friction", "place")
    #: Larger than in the other tasks, because pressing requires more torque than moving.
    laboratory_torque: ClassVar[tuple[float, float]] = (20.0, 12.0)
    extra_signals: ClassVar[tuple[str, ...]] = ("contact_force",)
    normal: FloatArray

    @public_call
    def __init__(
        self,
        arm: Arm | None = None,
        plant: PlantSource | None = None,
        force: ArrayLike = (5.0, 2.0),
        period: float = 2.0,
        stiffness: ArrayLike = 1e4,
        friction: ArrayLike = 0.2,
        damping: float = 0.5,
        exponent: float = 1.0,
        place: float = 0.0,
        **others: Any,
    ) -> None:
        self.force = check_array("force", force, (2,))
        mean, amplitude = self.force
        if not (mean > 0.0 and 0.0 <= amplitude <= mean and mean + amplitude <= MOST_FORCE):
            rule = (
                f"be (mean, amplitude) with amplitude <= mean and a sum of at most {MOST_FORCE:g}"
            )
            raise InputError(Problem("force", rule, shown(force)))
        self.period = _checked_number("period", period, positive=True)
        self.stiffness = _checked_range("stiffness", stiffness, positive=True)
        self.friction = _checked_range("friction", friction)
        self.damping = _checked_number("damping", damping)
        self.exponent = _checked_number("exponent", exponent)
        self.place = _checked_number("place", place)
        self._wall: Contact | None = None
        super().__init__(arm, plant, **others)

    def contacts(self) -> Sequence[Contact]:
        """See ``ArmEnv``; before the first episode the wall is out of reach."""
        if self._wall is None:
            away = Wall(point=(3.0 * self.reach, 0.0), normal=(-1.0, 0.0))
            return [self._touching(away, self.stiffness[0], self.friction[0])]
        return [self._wall]

    def _touching(self, wall: Wall, stiffness: float, friction: float) -> Contact:
        law: dict[str, Any] = {"exponent": self.exponent, "damping": self.damping}
        return Contact(surface=wall, stiffness=stiffness, friction=friction, **law)

    def task_parts(self) -> Sequence[Part]:
        most_rate = 2.0 * np.pi * self.force[1] / self.period
        return [
            *self.line_parts(_TOUCHDOWN + _SLIDE),
            Part("wall_normal", "1", 2, 1.0, axes=True),
            Part("wanted_force", "N", 1, MOST_FORCE),
            Part("wanted_force_rate", "N/s", 1, max(most_rate, 1.0)),
        ]

    # An episode -----------------------------------------------------------------------------------

    def begin(self, options: dict[str, Any]) -> FloatArray:
        rng = self.np_random
        if "start" in options and "end" in options:
            ends = [check_array(name, options[name], (2,)) for name in ("start", "end")]
            self.normal = self._facing(*ends)
            self.motion = self._along(*ends)
        elif "start" in options or "end" in options:
            raise InputError(Problem("the options", "need both 'start' and 'end', or neither"))
        else:
            self._draw()
        low, high = np.log(self.stiffness)
        stiffness, friction = np.exp(rng.uniform(low, high)), rng.uniform(*self.friction)
        place = rng.uniform(-self.place, self.place)
        drawn = {"stiffness": stiffness, "friction": friction, "place": place}
        drawn |= {k: check_number(k, options[k]) for k in drawn if k in options}
        point = self.motion.start + drawn["place"] * self.normal
        surface = Wall(point=tuple(point), normal=tuple(self.normal))
        self._wall = self._touching(surface, drawn["stiffness"], drawn["friction"])
        self.task_table = self._table()
        # Start before the actual wall, which may be closer than its nominal position.
        before = (_GAP + max(drawn["place"], 0.0)) * self.normal
        return self._along(self.motion.start + before, self.motion.end + before).joint_angle(0.0)

    def _along(self, start: FloatArray, end: FloatArray) -> TipMotion:
        return line_motion(self.arm, start, end, _SLIDE, start_time=_TOUCHDOWN)

    def _facing(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the normal (2,) of a line that points towards the base."""
        way = (end - start) / max(float(np.hypot(*(end - start))), 1e-300)
        normal = np.array([-way[1], way[0]])
        return -normal if normal @ (self._base() - start) < 0.0 else normal

    def _base(self) -> FloatArray:
        return np.asarray(self.arm.shape(self.arm.rest(np.zeros(self.arm.n_joints)), 2)[0, 0])

    def _draw(self) -> None:
        """Draw a random line on a wall along which the arm can press."""
        rng, length, base = self.np_random, _LENGTH * self.reach, self._base()
        for _ in range(_TRIES):
            start = self.arm.tip(self.arm.rest(rng.uniform(*_joint_range(self))))[:2]
            turn, side = rng.uniform(-_WALL_TURN, _WALL_TURN), rng.choice([-1.0, 1.0])
            inward = np.arctan2(*(base - start)[::-1]) + turn
            self.normal = np.array([np.cos(inward), np.sin(inward)])
            try:
                way = side * length * np.array([-self.normal[1], self.normal[0]])
                self.motion = self._along(start, start + way)
            except InputError:
                continue
            if self._manageable():
                return
        rule = f"cannot press on any of {_TRIES} random walls"
        hint = "Increase the torque limit or reduce the force."
        raise InputError(Problem("the arm", rule, hint=hint))

    def _manageable(self) -> bool:
        """Return whether the line is within reach and the limits on joint rates and torques."""
        times = _TOUCHDOWN + np.linspace(0.0, _SLIDE, 9)
        away = np.hypot(*(self.motion.tip(times) - self._base()).T) / self.reach
        if away.min() < _NEAREST or away.max() > _FARTHEST:
            return False
        if np.abs(self.motion.joint_rate(times)).max() > _FASTEST:
            return False
        arm, push = self.arm, self.force.sum()
        for angle in self.motion.joint_angle(times):
            turned = [
                arm.tip_velocity(arm.rest(angle), arm.rest(unit)) for unit in np.eye(arm.n_joints)
            ]
            holding = push * np.array([velocity[:2] @ self.normal for velocity in turned])
            if np.any(np.abs(holding) > _SHARE * self.torque_limit):
                return False
        return True

    def _table(self) -> FloatArray:
        """Return the task's values of the observation at every sample time."""
        times, (mean, amplitude) = self.times, self.force
        phase = 2.0 * np.pi * times / self.period
        force = mean - amplitude * np.cos(phase)
        rate = amplitude * np.sin(phase) * 2.0 * np.pi / self.period
        normal = np.tile(self.normal, (len(times), 1))
        return np.asarray(np.column_stack([*self.line_columns(times), normal, force, rate]))

    # Observation and reward ----------------------------------------------------------------------

    def pressing(self) -> float:
        """Return the current normal force (N) of the tip on the wall."""
        return float(self.plant.contact_force[0] @ self.normal)

    def miss(self, info: Mapping[str, Any]) -> Any:
        of_force = abs(info["force_error"]) / (_FORCE_SCALE * self.force[0])
        return super().miss(info) + min(of_force, _MOST_MISS)

    def succeeded(self, values: FloatArray, info: Mapping[str, Any]) -> Any:
        pressed = abs(info["force_error"]) < _FORCE_SCALE * self.force[0]
        over = values[6] == 0.0
        return over and pressed and info["distance"] < _NEAR * self.reach

    def task_info(self) -> dict[str, Any]:
        """See ``ArmEnv``; the contact force and its error change with each step."""
        force = self.pressing()
        error = force - float(self.task_values(self._tick)[-2])
        return {"force": force, "force_error": error}


def _checked_number(name: str, given: ArrayLike, positive: bool = False) -> float:
    """Return a non-negative number, or with ``positive`` a positive one, after validation."""
    return float(_checked_range(name, check_number(name, given), positive)[0])


def _checked_range(name: str, given: ArrayLike, positive: bool = False) -> FloatArray:
    """Return the bounds (2,) of a random value; both are equal for a single number."""
    single = np.ndim(given) == 0
    ends = check_array(name, [given, given] if single else given, (2,))
    if ends[0] > ends[1] or ends[0] < 0.0 or (positive and ends[0] == 0.0):
        rule = f"be {'greater than' if positive else 'at least'} 0"
        rule += "" if single else ", with the lower bound first"
        raise InputError(Problem(name, rule, shown(given)))
    return ends
