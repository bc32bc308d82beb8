"""Base class of the environments: one step is one sample time; its observation vector."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_choice, check_each, check_kind, check_number
from flexarm.base.errors import (
    InputError,
    Problem,
    SimulationError,
    check_array,
    public_call,
    raise_any,
    shown,
)
from flexarm.bridges.gymnasium_env.picture import Picture
from flexarm.control.hardware.measurement import Measurement
from flexarm.model import (
    Change,
    Contact,
    Gauge,
    Hardware,
    Instrument,
    Joint,
    Link,
    ModalDamping,
    Motors,
)
from flexarm.model.arm.spec import serial_only
from flexarm.simulation.calls.plant import Plant

FloatArray = NDArray[np.float64]
Vector = NDArray[np.float32]

#: Bounds far above the values of a working arm, for clipping: rad/s, and strain in 1e-3.
_MOST_RATE, _MOST_STRAIN = 50.0, 10.0
#: Largest contact force in an observation, N.
MOST_FORCE = 100.0
#: Limit on the ratio of tip distance to reach, which exceeds 1 for a bent arm in the linear theory.
_STRETCH = 1.2


@dataclass(frozen=True)
class Part:
    """Group of components of the observation vector."""

    name: str  # common name of the components
    unit: str  # common unit of the components
    size: int  # number of components
    bound: float  # largest magnitude
    axes: bool = False  # whether the components are x and y, instead of numbers from 1

    @property
    def names(self) -> list[str]:
        """Names of the components with units, in the form of the signals of linear models."""
        ends = ("x", "y") if self.axes else range(1, self.size + 1)
        return [f"{self.name}[{end}] ({self.unit})" for end in ends]


class Observation:
    """Layout of the observation vector, and conversion of measurements to it.

    A joint angle appears as cosine and sine, because angles that differ by a full turn are the same
    posture. Strains are in units of 1e-3, so that the components have similar magnitudes.
    """

    def __init__(
        self,
        arm: Arm,
        instruments: Sequence[Instrument],
        example: Measurement,
        task: Sequence[Part],
    ) -> None:
        signals = {label: signal for item in instruments for label, signal in _named(item)}
        reach = arm.reach
        limits = {item.label: float(item.limit) for item in instruments}
        self.parts: list[Part] = []
        self._signals = [(label, signals[label]) for label in example]
        known = {  # unit, bound, and whether the components are x and y
            "joint_rate": ("rad/s", _MOST_RATE, False),
            "strain": ("1e-3", _MOST_STRAIN, False),
            "tip": ("m", _STRETCH * reach, True),
            "tip_velocity": ("m/s", _MOST_RATE * reach, True),
            "contact_force": ("N", MOST_FORCE, True),
        }
        for label, value in example.items():
            signal = str(signals[label])
            if signal == "joint_angle":
                self.parts += [Part(f"{f} {label}", "1", value.size, 1.0) for f in ("cos", "sin")]
            else:
                unit, bound, axes = known.get(signal, ("SI", limits.get(label, np.inf), False))
                self.parts.append(Part(label, unit, value.size, bound, axes))
        self.parts += task
        bounds = np.concatenate([np.full(part.size, part.bound) for part in self.parts])
        self._most = bounds.astype(np.float32)
        self._least = -self._most
        self.space = Box(self._least, self._most, dtype=np.float32)

    @property
    def names(self) -> list[str]:
        """Names of the components with units, such as ``tip[x] (m)``."""
        return [name for part in self.parts for name in part.names]

    def vector(self, measurement: Mapping[str, FloatArray], task: FloatArray) -> Vector:
        """Return the observation (..., size), clipped to the bounds of the space."""
        values = []
        for label, signal in self._signals:
            value = measurement[label]
            if value.ndim != task.ndim:
                value = value.reshape(*task.shape[:-1], -1)
            if signal == "joint_angle":
                values.append(np.cos(value))
                values.append(np.sin(value))
            else:
                values.append(1e3 * value if signal == "strain" else value)
        values.append(task)
        seen = np.concatenate(values, axis=-1, dtype=np.float32, casting="same_kind")
        # Clip after the conversion, because rounding to single precision may exceed a bound.
        np.minimum(seen, self._most, out=seen)
        return np.maximum(seen, self._least, out=seen)


def exact_instruments(arm: Arm, extra: Sequence[str] = ()) -> list[Instrument]:
    """Return exact instruments of the joints, strain, tip and the signals ``extra``."""
    strain = ["strain"] if arm.gauges else []
    signals = ["joint_angle", "joint_rate", *strain, "tip", "tip_velocity", *extra]
    return [Instrument(signal=signal) for signal in signals]


def _named(item: Instrument) -> list[tuple[str, object]]:
    """Return the names of an instrument in measurements, each with its signal."""
    rate = {"joint_angle": "joint_rate", "tip": "tip_velocity"}
    signals = [item.signal, rate.get(str(item.signal), "")]
    return list(zip(item.labels, signals, strict=False))


#: An arm, or a function that draws one for each episode.
PlantSource = Arm | Callable[[np.random.Generator], Arm]
#: Changes of the plant during an episode, or a function that draws them for each episode.
ChangeSource = Sequence[Change] | Callable[[np.random.Generator], Sequence[Change]]
#: Reward penalty of full torque, as a fraction of the largest reward.
_EFFORT = 0.002


@cache
def laboratory_arm() -> Arm:
    """Return the default arm of the environments: two light links with gauges at their roots."""
    rod: dict[str, Any] = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
    rod |= {"damping": ModalDamping(ratio=0.01), "gauges": [Gauge(station=0.05, distance=0.005)]}
    links = [Link(length=1.4142, elements=2, **rod), Link(length=1.0, elements=1, **rod)]
    elbow = Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02)
    return Arm(links=links, joints=[Joint(hub_inertia=0.1), elbow])


class ArmEnv(gymnasium.Env[Vector, Vector]):
    """Environment in which an agent commands the motors of an arm at each sample time.

    The action (joints,) is in [-1, 1]: the fraction of ``torque_limit`` to command to each motor
    until the next step; larger values are clipped. The observation contains the readings of the
    instruments, followed by the values of the task: ``observation_names`` lists all components
    with their units. The reward of a step is ``1 / (1 + distance / scale)``, with the distance of
    the exact tip from the task's target, minus 0.002 times the mean square of the action. It is
    always positive, so that an agent never gains by ending an episode. A task may add other errors
    to the distance, as its own documentation describes.

    An episode is *terminated*, with reward zero, if the simulation fails or a link exceeds the
    linear beam theory; ``info["reason"]`` contains the reason. It is *truncated* after
    ``duration``.

    ``info`` contains ``time`` (s), ``tip`` (2,) m and its ``speed`` (m/s), ``distance`` (m), the
    commanded ``torque`` (joints,) N m, ``is_success`` and ``reason``.

    Args:
        arm: the nominal arm; None for ``laboratory_arm()``.
        plant: simulated arm, if it differs from ``arm``; or a function of a random generator that
            returns one for each episode.
        sample_time: s.
        duration: of an episode, s.
        torque_limit: N m, one number or one for each joint; None for that of the hardware's motors,
            or ``laboratory_torque`` of the laboratory arm.
        hardware: instruments and motors; each episode replaces its seed. Without instruments:
            exact joint angles, rates, strain, tip and its velocity.
        render_mode: "rgb_array" or None.
        changes: numbers of the simulated arm that change during each episode, at times or by
            tables (``flexarm.Change``); or a function of a random generator that returns them.

    Attributes:
        arm, torque_limit: as given, the latter (joints,).
        reach: length of the straight arm, m.
        plant: the ``flexarm.Plant`` of the simulation, with the exact state, which is hidden from
            the agent.
        ticks: number of steps of a complete episode.
        layout: of the observation vector.
        task_table: (1 or ticks + 1, values) values of the task's components of the observation,
            constant or at each sample time. The first two are the target of the tip, m.

    Raises:
        InputError: if an argument is not valid.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 200}  # noqa: RUF012
    #: Distance at which the reward is a half, as a fraction of the reach.
    scale: ClassVar[float]
    task_table: FloatArray
    #: Names of the options of ``reset``.
    option_names: ClassVar[tuple[str, ...]]
    #: Largest torques (N m) of the motors of the laboratory arm.
    laboratory_torque: ClassVar[tuple[float, float]] = (10.0, 3.0)
    #: Signals of the exact instruments in addition to the joints, strain and tip.
    extra_signals: ClassVar[tuple[str, ...]] = ()

    @public_call
    def __init__(
        self,
        arm: Arm | None = None,
        plant: PlantSource | None = None,
        sample_time: float = 0.005,
        duration: float = 3.0,
        torque_limit: ArrayLike | None = None,
        hardware: Hardware | None = None,
        render_mode: str | None = None,
        changes: ChangeSource = (),
    ) -> None:
        right = isinstance(plant, Arm) or callable(plant)
        rules = (
            ("arm", "be an Arm", arm, isinstance(arm, Arm)),
            ("plant", "be an Arm, or a function that returns one", plant, right),
            ("hardware", "be a Hardware object", hardware, isinstance(hardware, Hardware)),
            ("render_mode", "be 'rgb_array' or None", render_mode, render_mode == "rgb_array"),
        )
        problems = [
            Problem(name, rule, shown(value))
            for name, rule, value, right in rules
            if value is not None and not right
        ]
        raise_any(problems)
        hardware = hardware or Hardware()
        if torque_limit is None:
            given = self.laboratory_torque if arm is None else None
            torque_limit = _default_limit(given, hardware.motors)
        self.arm = arm or laboratory_arm()
        serial_only(self.arm.spec, "an environment of Gymnasium")
        self.reach = self.arm.reach
        #: Torques (joints,) N m of an action of 1.
        self.torque_limit = np.full(
            self.arm.n_joints,
            check_each("torque_limit", torque_limit, self.arm.n_joints, positive=True),
        )
        instruments = hardware.instruments or exact_instruments(self.arm, self.extra_signals)
        self._hardware = hardware.replace(instruments=instruments)
        self._source: PlantSource = self.arm if plant is None else plant
        self._changes = changes
        first = self._source if isinstance(self._source, Arm) else self.arm
        self.plant = self._made(first, sample_time, () if callable(changes) else changes)
        self.ticks = round(check_number("duration", duration) / sample_time)
        if self.ticks < 1:
            raise InputError(Problem("duration", "be at least sample_time", shown(duration)))
        example = self.plant.measurement
        self.layout = Observation(self.arm, instruments, example, self.task_parts())
        self.observation_space = self.layout.space
        self.action_space = Box(-1.0, 1.0, (self.arm.n_joints,), np.float32)
        self.render_mode = render_mode
        self.metadata = {**type(self).metadata, "render_fps": round(1.0 / sample_time)}
        self._picture: Picture | None = None
        self._tick, self._begun = 0, False
        self._most, self._least = np.ones(self.arm.n_joints), -np.ones(self.arm.n_joints)

    # Interface of a task -------------------------------------------------------------------------

    @abstractmethod
    def task_parts(self) -> Sequence[Part]:
        """Return the task's components of the observation."""

    @abstractmethod
    def begin(self, options: dict[str, Any]) -> FloatArray:
        """Draw a task with ``np_random``: set ``task_table``; return initial angles (joints,)."""

    @abstractmethod
    def succeeded(self, values: FloatArray, info: Mapping[str, Any]) -> Any:
        """Return whether the task is done.

        As in ``miss``, numbers have leading axes in a vector environment.

        Args:
            values: of the task, (..., values).
            info: as returned by ``step``.
        """

    def contacts(self) -> Sequence[Contact]:
        """Return the contacts of this episode; none by default."""
        return ()

    def task_info(self) -> dict[str, FloatArray]:
        """Return the items of ``info`` that are constant in an episode."""
        return {}

    def miss(self, info: Mapping[str, Any]) -> Any:
        """Return the scaled error, 1 for half of the largest reward; by default of the distance."""
        return info["distance"] / (self.scale * self.reach)

    def task_values(self, tick: int) -> FloatArray:
        """Return the task's values of the observation at a sample time."""
        return np.asarray(self.task_table[min(tick, len(self.task_table) - 1)])

    def target(self, tick: int) -> FloatArray:
        """Return the target position of the tip (2,) at a sample time, m."""
        return self.task_values(tick)[:2]

    def reward(self, info: Mapping[str, Any], effort: Any) -> Any:
        """Return the reward of a step; ``effort``: mean square of the action."""
        return 1.0 / (1.0 + self.miss(info)) - _EFFORT * effort

    # Interface of Gymnasium ----------------------------------------------------------------------

    @property
    def observation_names(self) -> list[str]:
        """Names of the observation's components with their units, such as ``tip[x] (m)``."""
        return self.layout.names

    @public_call
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Begin an episode; see ``gymnasium.Env.reset``.

        Raises:
            InputError: if an option is unknown to the task or not valid.
        """
        super().reset(seed=seed)
        start = self.draw_task(options)
        drawn = self._source if isinstance(self._source, Arm) else self._source(self.np_random)
        changing = self._changes(self.np_random) if callable(self._changes) else self._changes
        if drawn is not self.plant.arm or self.contacts() or callable(self._changes):
            self.plant = self._made(drawn, self.plant.sample_time, changing)
        self.plant.reset(self.plant.arm.rest(start), seed=self.draw_noise())
        self._tick, self._begun = 0, True
        return self._look(np.zeros(self.arm.n_joints), "")

    @public_call
    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Apply torques until the next sample time; see ``gymnasium.Env.step``.

        Raises:
            InputError: if the action is not finite or has the wrong shape.
            gymnasium.error.ResetNeeded: if ``reset`` has not been called.
        """
        if not self._begun:
            raise gymnasium.error.ResetNeeded("Call reset() before step().")
        part = check_array("action", action, (self.arm.n_joints,))
        np.minimum(part, self._most, out=part)  # faster than np.clip
        np.maximum(part, self._least, out=part)
        torque = part * self.torque_limit
        try:
            self.plant.step(torque)
            self._tick += 1
            reason = self.plant.warning
        except SimulationError as error:
            reason = str(error)
        observation, info = self._look(torque, reason)
        reward = 0.0
        if not reason:
            reward = self.reward(info, float(part @ part) / part.size)
        over = self._tick >= self.ticks
        return observation, reward, bool(reason), over, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture (480, 480, 3) of the arm and its task."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() needs an environment made with render_mode='rgb_array'")
            return None
        return self.drawn(self.plant.q, self.task_table, self._tick)

    def close(self) -> None:
        """Release the picture."""
        self._picture = None

    # Common code of this environment and of vector environments ---------------------------------

    def draw_task(self, options: Mapping[str, Any] | None) -> FloatArray:
        """Draw a task with validated options; return the initial joint angles (joints,), rad."""
        for name in options or {}:
            check_choice("an option", name, self.option_names)
        return self.begin(dict(options or {}))

    def draw_noise(self) -> int:
        """Draw the seed of the instruments of an episode."""
        return int(self.np_random.integers(2**31))

    def drawn(self, q: FloatArray, table: FloatArray, tick: int) -> NDArray[np.uint8]:
        """Return a picture of the arm at q (dof,) with a task at a sample time."""
        if self._picture is None:
            self._picture = Picture(self.reach)
        return self._picture.draw(self.plant.arm.shape(q, 20), table, tick)

    # ----------------------------------------------------------------------------------------------

    def _made(self, arm: object, sample_time: float, changes: Sequence[Change]) -> Plant:
        """Create the plant of an arm with the nominal arm's numbers of joints and gauges."""
        known = self.arm
        arm = check_kind("plant", arm, Arm)
        if (arm.n_joints, len(arm.gauges)) != (known.n_joints, len(known.gauges)):
            rule = f"have {known.n_joints} joints and {len(known.gauges)} gauges"
            raise InputError(Problem("plant", rule, f"{arm.n_joints} and {len(arm.gauges)}"))
        acting: dict[str, Any] = {"contacts": self.contacts(), "changes": changes}
        return Plant(arm, sample_time, self._hardware, **acting, warn=False)

    def _look(self, torque: FloatArray, reason: str) -> tuple[Vector, dict[str, Any]]:
        """Return the observation and the info after a step."""
        motion, values = self.plant.tip_motion, self.task_values(self._tick)
        x, y, _, vx, vy, _ = motion.tolist()
        to_x, to_y = values[:2].tolist()
        info = {
            "time": self.plant.time,
            "tip": motion[:2],
            "speed": math.hypot(vx, vy),
            "distance": math.hypot(x - to_x, y - to_y),
            "torque": torque,
            "reason": reason,
        }
        info |= self.task_info()
        info["is_success"] = not reason and bool(self.succeeded(values, info))
        return self.layout.vector(self.plant.measurement, values), info


def _default_limit(laboratory: ArrayLike | None, motors: Motors | None) -> ArrayLike:
    """Return the torque limit of the motors, or that of the laboratory arm, N m."""
    if motors is not None and np.all(np.isfinite(motors.torque_limit)):
        return motors.torque_limit
    if laboratory is not None:
        return laboratory
    hint = "Give it, or hardware whose motors have a torque_limit."
    raise InputError(Problem("torque_limit", "is required with an arm", hint=hint))
