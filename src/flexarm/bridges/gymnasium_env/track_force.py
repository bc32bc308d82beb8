"""Slide along a wall and press on it with a force that changes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm import Arm
from flexarm.bridges.gymnasium_env.base import ArmEnv, PlantSource
from flexarm.bridges.gymnasium_env.observation import MOST_FORCE, FloatArray, Part, reach_of
from flexarm.bridges.gymnasium_env.picture import Scene
from flexarm.bridges.gymnasium_env.reach import joint_range
from flexarm.contacts import Contact
from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.motion import line_motion
from flexarm.motion.lines import LineMotion
from flexarm.surfaces import Wall

#: When the tip is to begin to slide, and for how long it does, s.
_TOUCHDOWN, _SLIDE = 0.5, 2.0
#: How far it slides, as a part of the reach: 0.3 m with the arm that is there.
_LENGTH = 0.125
#: The tip starts this far (m) before the wall.
_GAP = 0.005
#: A wall faces the base, turned by at most this (rad): its base is on the free side then.
_TURN = np.pi / 6.0
#: How far from the base a line may be (parts of the reach): a stretched arm cannot give way.
_NEAREST, _FARTHEST = 0.5, 0.85
#: Joint rates (rad/s) that a line may take, and the part of the torque limits that the largest
#: force may take at rest: more would bend the links too far.
_FASTEST, _SHARE = 1.0, 0.4
_TRIES = 500
#: The reward is halved by a fifth of the mean force; more than a hundred times that counts as that.
_FORCE_SCALE, _MOST_MISS = 0.2, 100.0
#: Done is a line that the tip has come to the end of and is this near to (part of the reach).
_NEAR = 0.01


class TrackForceEnv(ArmEnv):
    """Slide the tip along a random wall, pressing on it with a force that changes.

    The arm starts at rest, its tip at least 5 mm before the wall. The force asked for is
    ``force[0] - force[1] cos(2 pi t / period)`` from the first moment on. From 0.5 s to 2.5 s a
    point moves along the wall by an eighth of the reach (0.3 m), from rest to rest. The wall stands
    in a random place and faces the base, turned by up to 30 degrees. Only the tip touches it.

    The task adds to the observation: ``wanted_tip`` (2,) m and ``wanted_velocity`` (2,) m/s of the
    point now, ``line_end`` (2,) m, ``time_left`` (1,) s until the point is there, ``wall_normal``
    (2,) away from the wall, ``wanted_force`` (1,) N and ``wanted_force_rate`` (1,) N/s. Among the
    exact instruments there is one of the ``contact_force`` on the arm, (2,) N in world axes; in an
    observation each component ends at 100 N.

    The reward of a step is ``1 / (1 + distance / (0.02 reach) + force_error / (0.2 force[0]))``,
    less the effort: the force counts no more than a hundred. ``is_success``: the line is over, the
    tip is within a hundredth of the reach of its end, and the force within a fifth of its mean of
    what is asked for.

    ``reset(options={"start": ..., "end": ..., "stiffness": ..., "friction": ..., "place": ...})``
    takes the two ends of the line on the wall, world points (2,) m, together; each of the others
    fixes what is random otherwise. ``info`` also holds ``force``, with which the tip presses, and
    ``force_error``, N. ``motion`` is the ``line_motion`` along the wall, ``normal`` the wall's.
    Everything else is told by ``ArmEnv``.

    Args:
        arm, plant: see ``ArmEnv``.
        force: mean and amplitude of the force asked for, N. period: of its change, s.
        stiffness: of the wall, N/m; or the two ends of what is drawn for each episode, evenly in
            its logarithm.
        friction: coefficient; or the two ends of what is drawn for each episode.
        damping, exponent: of the wall, see ``flexarm.Contact``.
        place: m, by how much at most the wall is nearer or farther than the task says.
        others: further arguments of ``ArmEnv``.

    Raises:
        InputError: an argument cannot be used.
    """

    scale: ClassVar[float] = 0.02
    option_names: ClassVar[tuple[str, ...]] = ("start", "end", "stiffness", "friction", "place")
    #: Pressing takes more than moving.
    laboratory_torque: ClassVar[tuple[float, float]] = (20.0, 12.0)
    extra_signals: ClassVar[tuple[str, ...]] = ("contact_force",)
    motion: LineMotion
    normal: FloatArray

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
        self.force = _checked_force(force)
        self.period = _checked_number("period", period, positive=True)
        self.stiffness = _checked_range("stiffness", stiffness, positive=True)
        self.friction = _checked_range("friction", friction)
        self.damping = _checked_number("damping", damping)
        self.exponent = _checked_number("exponent", exponent)
        self.place = _checked_number("place", place)
        self._wall: Contact | None = None
        super().__init__(arm, plant, **others)

    def contacts(self) -> Sequence[Contact]:
        """See ``ArmEnv``; before the first episode the wall stands out of reach."""
        if self._wall is None:
            away = Wall((3.0 * reach_of(self.arm), 0.0), (-1.0, 0.0))
            return [self._touching(away, self.stiffness[0], self.friction[0])]
        return [self._wall]

    def _touching(self, wall: Wall, stiffness: float, friction: float) -> Contact:
        return Contact(
            wall,
            stiffness,
            exponent=self.exponent,
            damping=self.damping,
            friction=friction,
        )

    def task_parts(self) -> Sequence[Part]:
        """See ``ArmEnv``."""
        reach = reach_of(self.arm)
        most_rate = 2.0 * np.pi * self.force[1] / self.period
        return [
            Part("wanted_tip", "m", 2, reach, axes=True),
            Part("wanted_velocity", "m/s", 2, 10.0 * reach, axes=True),
            Part("line_end", "m", 2, reach, axes=True),
            Part("time_left", "s", 1, _TOUCHDOWN + _SLIDE),
            Part("wall_normal", "1", 2, 1.0, axes=True),
            Part("wanted_force", "N", 1, MOST_FORCE),
            Part("wanted_force_rate", "N/s", 1, max(most_rate, 1.0)),
        ]

    # An episode -----------------------------------------------------------------------------------

    def begin(self, options: dict[str, Any]) -> FloatArray:
        """See ``ArmEnv``."""
        where, rng = "TrackForceEnv.reset", self.np_random
        if "start" in options and "end" in options:
            ends = [check_array(where, name, options[name], (2,)) for name in ("start", "end")]
            self.normal = self._facing(*ends)
            self.motion = self._along(*ends)
        elif "start" in options or "end" in options:
            rule = "come both or neither: 'start' and 'end'"
            raise InputError(Problem(where, "the options", rule, "one of them"))
        else:
            self._draw()
        low, high = np.log(self.stiffness)
        stiffness, friction = np.exp(rng.uniform(low, high)), rng.uniform(*self.friction)
        place = rng.uniform(-self.place, self.place)
        drawn = {"stiffness": stiffness, "friction": friction, "place": place}
        drawn |= {k: float(check_array(where, k, options[k], ())) for k in drawn if k in options}
        surface = Wall(self.motion.start + drawn["place"] * self.normal, self.normal)
        self._wall = self._touching(surface, drawn["stiffness"], drawn["friction"])
        self._wanted = self._table()
        # Before the wall as it is: one that is nearer than said is not started in.
        before = (_GAP + max(drawn["place"], 0.0)) * self.normal
        return self._along(self.motion.start + before, self.motion.end + before).joint_angle(0.0)

    def _along(self, start: FloatArray, end: FloatArray) -> LineMotion:
        return line_motion(self.arm, start, end, _SLIDE, start_time=_TOUCHDOWN)

    def _facing(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the normal (2,) of a line that looks to the base."""
        way = (end - start) / max(float(np.hypot(*(end - start))), 1e-300)
        normal = np.array([-way[1], way[0]])
        return -normal if normal @ (self._base() - start) < 0.0 else normal

    def _base(self) -> FloatArray:
        base: FloatArray = self.arm.shape(self.arm.rest(np.zeros(self.arm.joints)), 2)[0, 0]
        return base

    def _draw(self) -> None:
        """Draw a line on a wall along which the arm can press."""
        rng, length, base = self.np_random, _LENGTH * reach_of(self.arm), self._base()
        for _ in range(_TRIES):
            start = self.arm.tip(self.arm.rest(rng.uniform(*joint_range(self))))[:2]
            turn, side = rng.uniform(-_TURN, _TURN), rng.choice([-1.0, 1.0])
            inward = np.arctan2(*(base - start)[::-1]) + turn
            self.normal = np.array([np.cos(inward), np.sin(inward)])
            try:
                way = side * length * np.array([-self.normal[1], self.normal[0]])
                self.motion = self._along(start, start + way)
            except InputError:
                continue
            if self._manageable():
                return
        rule = "be able to press on walls"
        value = f"one that could press on none of {_TRIES}"
        hint = "Give it more torque, or ask for less force."
        raise InputError(Problem("TrackForceEnv.reset", "the arm", rule, value, hint))

    def _manageable(self) -> bool:
        """Whether joints can move along the line, and press there without much of their torque."""
        times = _TOUCHDOWN + np.linspace(0.0, _SLIDE, 9)
        away = np.hypot(*(self.motion.tip(times) - self._base()).T) / reach_of(self.arm)
        if away.min() < _NEAREST or away.max() > _FARTHEST:
            return False
        if np.abs(self.motion.joint_rate(times)).max() > _FASTEST:
            return False
        arm, push = self.arm, self.force.sum()
        for angle in self.motion.joint_angle(times):
            turned = [
                arm.tip_velocity(arm.rest(angle), arm.rest(unit)) for unit in np.eye(arm.joints)
            ]
            holding = push * np.array([velocity[:2] @ self.normal for velocity in turned])
            if np.any(np.abs(holding) > _SHARE * self.torque_limit):
                return False
        return True

    def _table(self) -> FloatArray:
        """Return what the task asks for at every sample time, as it is observed."""
        motion, times = self.motion, np.arange(self.ticks + 1) * self.plant.sample_time
        along = motion.law(np.clip((times - _TOUCHDOWN) / _SLIDE, 0.0, 1.0))
        way, (mean, amplitude) = motion.end - motion.start, self.force
        phase = 2.0 * np.pi * times / self.period
        table: FloatArray = np.column_stack(
            [
                motion.start + np.outer(along.s, way),
                np.outer(along.ds / _SLIDE, way),
                np.tile(motion.end, (len(times), 1)),
                np.maximum(motion.end_time - times, 0.0),
                np.tile(self.normal, (len(times), 1)),
                mean - amplitude * np.cos(phase),
                amplitude * np.sin(phase) * 2.0 * np.pi / self.period,
            ]
        )
        return table

    # What an agent sees, and what it earns --------------------------------------------------------

    def task_values(self, tick: int) -> FloatArray:
        """See ``ArmEnv``."""
        values: FloatArray = self._wanted[min(tick, self.ticks)]
        return values

    def target(self, tick: int) -> FloatArray:
        """See ``ArmEnv``."""
        return self.task_values(tick)[:2]

    def pressing(self) -> float:
        """Return the force (N) with which the tip presses on the wall now."""
        return float(self.plant.contact_force[0] @ self.normal)

    def _force_error(self, tick: int) -> float:
        return self.pressing() - float(self.task_values(tick)[-2])

    def miss(self, info: dict[str, Any]) -> float:
        """See ``ArmEnv``."""
        of_force = float(abs(info["force_error"]) / (_FORCE_SCALE * self.force[0]))
        return super().miss(info) + min(of_force, _MOST_MISS)

    def succeeded(self, tick: int, distance: float) -> bool:
        """See ``ArmEnv``."""
        over = tick * self.plant.sample_time >= self.motion.end_time
        pressed = abs(self._force_error(tick)) < _FORCE_SCALE * self.force[0]
        return bool(over and pressed and distance < _NEAR * reach_of(self.arm))

    def _info(self, torque: FloatArray, reason: str) -> dict[str, Any]:
        told = {"force": self.pressing(), "force_error": self._force_error(self._tick)}
        return super()._info(torque, reason) | told

    def scene(self) -> Scene:
        """See ``ArmEnv``."""
        return Scene(self.target(self._tick), self._wanted[:, :2])


def _checked_force(given: ArrayLike) -> FloatArray:
    """Return mean and amplitude (2,) of a force that always presses, N."""
    where = "TrackForceEnv"
    force = check_array(where, "force", given, (2,))
    if not (force[0] > 0.0 and 0.0 <= force[1] <= force[0] and force.sum() <= MOST_FORCE):
        rule = f"be a mean and an amplitude no larger, together at most {MOST_FORCE:g}"
        raise InputError(Problem(where, "force", rule, shown(given)))
    return force


def _checked_number(name: str, given: ArrayLike, positive: bool = False) -> float:
    """Return a number that is not negative; with ``positive``, not zero."""
    number = float(check_array("TrackForceEnv", name, given, ()))
    return float(_checked_range(name, number, positive)[0])


def _checked_range(name: str, given: ArrayLike, positive: bool = False) -> FloatArray:
    """Return the ends (2,) of what is drawn; of a number, twice that."""
    where = "TrackForceEnv"
    single = np.ndim(given) == 0
    ends = check_array(where, name, [given, given] if single else given, (2,))
    if ends[0] > ends[1] or ends[0] < 0.0 or (positive and ends[0] == 0.0):
        rule = f"be {'greater than' if positive else 'at least'} 0"
        rule += "" if single else ", and two ends in rising order"
        raise InputError(Problem(where, name, rule, shown(given)))
    return ends
