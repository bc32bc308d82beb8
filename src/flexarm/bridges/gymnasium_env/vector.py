"""Vector environments, whose arms are stepped together in vector registers and threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.observe import channels_of
from flexarm.base.arguments import check_choice, check_count
from flexarm.base.errors import InputError, Problem, check_array, public_call, raise_any, shown
from flexarm.base.processes import check_workers
from flexarm.bridges.gymnasium_env.base import ArmEnv, FloatArray, Vector, exact_instruments
from flexarm.bridges.gymnasium_env.tasks import ReachEnv, TrackPathEnv
from flexarm.linear.statics.gaps import refuse_bristles, refuse_sticking
from flexarm.simulation.batch.closed_lanes import LanePlants, Rows
from flexarm.simulation.batch.lanes import arm_fits_lanes
from flexarm.simulation.run.validity import BendingWatch

BoolArray = NDArray[np.bool_]
_Steps = tuple[Vector, FloatArray, BoolArray, BoolArray, dict[str, Any]]

_SYNC = "Use gymnasium.make_vec(..., vectorization_mode='sync'), which steps one arm at a time."


class ArmVectorEnv(VectorEnv[Vector, Vector, Any]):
    """Many environments of one task, stepped together, eight arms at a time in each thread.

    Sub-environment i has the numbers of a single environment with the seed of i, for any number of
    sub-environments and threads. ``reset(seed=s)`` gives it the seed s + i. Its arguments are
    those of the single environment, with these limits: the arm has no joint limits and no friction
    that holds (give it a ``smoothing_rate``), the instruments and motors are exact, and ``plant``
    is not a function. Other cases, and
    ``flexarm/TrackForce-v0``, need ``vectorization_mode="sync"``.

    Observations and rewards are new arrays of each step. ``info`` contains one array for each item
    of a single ``info``, and the mask of the sub-environments that have it, ``_time`` for ``time``.

    Args:
        num_envs: number of sub-environments.
        autoreset_mode: ``"NextStep"``: the step after the end of an episode begins a new one and
            ignores the action; its reward is zero. ``"SameStep"``: the last step of an episode
            returns the first observation of the next one; ``info["final_obs"]`` and
            ``info["final_info"]`` have the last ones. ``"Disabled"``: call ``reset`` with
            ``options={"reset_mask": ...}``.
        threads: number of threads, by default one for each core that this process may use.
        arguments: of the single environment.

    Raises:
        InputError: if an argument is not valid, or not supported by a vector environment.
    """

    #: Class of the single environments.
    kind: ClassVar[type[ArmEnv]]

    @public_call
    def __init__(
        self,
        num_envs: int = 1,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        **arguments: Any,
    ) -> None:
        problems = []
        plant = arguments.get("plant")
        if callable(plant) and not isinstance(plant, Arm):
            reason = "cannot be a function in a vector environment"
            problems.append(Problem("plant", reason, hint=_SYNC))
        for name in ("hardware", "changes"):
            if arguments.get(name):
                reason = "is not supported in a vector environment"
                problems.append(Problem(name, reason, hint=_SYNC))
        raise_any(problems)
        self._task = task = self.kind(**arguments)
        arm = task.plant.arm
        refuse_bristles(arm, "a vector environment", hint=_SYNC)
        refuse_sticking(arm, "a vector environment", hint=f"{_SYNC} Or use smoothing_rate=0.01.")
        if not arm_fits_lanes(arm):
            rule = "must have no joint limits in a vector environment"
            raise InputError(Problem("the arm", rule, hint=_SYNC))
        self.num_envs = check_count("num_envs", num_envs)
        threads = check_workers("threads", threads)
        word, words = (
            getattr(autoreset_mode, "value", autoreset_mode),
            [m.value for m in AutoresetMode],
        )
        self._mode = AutoresetMode(check_choice("autoreset_mode", word, words))
        self.metadata = {**task.metadata, "autoreset_mode": self._mode}
        self.render_mode = task.render_mode
        self.single_observation_space = task.observation_space
        self.single_action_space = task.action_space
        self.observation_space = batch_space(task.observation_space, self.num_envs)
        self.action_space = batch_space(task.action_space, self.num_envs)
        self._plants = LanePlants(arm, self.num_envs, task.plant.sample_time, threads)
        self._signals = [str(item.signal) for item in exact_instruments(arm, task.extra_signals)]
        self._bending = BendingWatch(arm)
        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._seeds = [-1] * self.num_envs
        self._over = np.zeros(self.num_envs, dtype=np.bool_)
        self._seen: Vector | None = None
        self._table = np.zeros((self.num_envs, 0, 0))  # task tables, from the first reset on
        self._constant: dict[str, FloatArray] = {}  # items of ``task_info``

    @property
    def observation_names(self) -> list[str]:
        """Names of the observation's components with their units, such as ``tip[x] (m)``."""
        return self._task.observation_names

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Random generators of the sub-environments."""
        return tuple(self._generator(place) for place in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Seeds of the sub-environments; -1 for an unknown one."""
        return tuple(self._seeds)

    # Interface of Gymnasium ----------------------------------------------------------------------

    @public_call
    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Vector, dict[str, Any]]:
        """Begin episodes; see ``gymnasium.vector.SyncVectorEnv.reset``.

        Args:
            seed: of the first sub-environment, s: sub-environment i has the seed s + i. Or a list
                with one for each. None keeps the random generators.
            options: of the task, the same for all sub-environments; and ``"reset_mask"``
                (num_envs,), the sub-environments to reset.

        Raises:
            InputError: if an option is unknown or not valid, or the number of seeds is not
                ``num_envs``.
        """
        options = dict(options or {})
        mask = _checked_mask(options.pop("reset_mask", None), self.num_envs)
        if self._seen is None and not mask.all():
            raise gymnasium.error.ResetNeeded("Reset all sub-environments first.")
        places = np.flatnonzero(mask)
        for place, one in zip(places, _seeds(seed, self.num_envs, places), strict=True):
            if one is not None:
                self._generators[place], self._seeds[place] = seeding.np_random(one)
        self._begin(places, options)
        observations, info = self._look(np.zeros(self.action_space.shape or ()), {})
        if self._seen is not None:
            observations[~mask] = self._seen[~mask]
        self._seen = observations
        return observations.copy(), _masked(info, mask)

    @public_call
    def step(self, actions: ArrayLike) -> _Steps:
        """Apply torques until the next sample time; see ``gymnasium.vector.VectorEnv.step``.

        Raises:
            InputError: if the actions are not finite or have the wrong shape.
            gymnasium.error.ResetNeeded: if ``reset`` has not been called, or an episode is over and
                ``autoreset_mode`` is ``"Disabled"``.
        """
        part = check_array("actions", actions, (self.num_envs, self._task.arm.n_joints))
        if self._seen is None:
            raise gymnasium.error.ResetNeeded("Call reset() before step().")
        if self._mode is AutoresetMode.DISABLED and self._over.any():
            how = "options={'reset_mask': terminations | truncations}"
            raise gymnasium.error.ResetNeeded(f"Episodes are over: call reset({how}).")
        begins = self._over.copy()
        before = self._seen
        assert before is not None
        np.clip(part, -1.0, 1.0, out=part)
        part[begins] = 0.0
        if begins.any():
            self._begin(np.flatnonzero(begins), {})
        torque = part * self._task.torque_limit
        active = np.flatnonzero(~begins)
        failed = self._plants.step(active, torque[active])
        reasons = self._bending.of_many(self._plants.state)
        reasons |= {place: str(error) for place, error in failed.items()}
        observations, info = self._look(torque, reasons)
        terminated = np.zeros(self.num_envs, dtype=np.bool_)
        terminated[list(reasons)] = True
        for place in failed:  # the instruments have no reading at the end of this step
            observations[place] = before[place]
        effort = np.einsum("ej,ej->e", part, part) / part.shape[1]
        rewards = self._task.reward(info, effort)
        rewards[terminated | begins] = 0.0
        truncated = self._plants.tick >= self._task.ticks
        self._over = terminated | truncated
        info = _masked(info, np.ones(self.num_envs, dtype=np.bool_))
        if self._mode is AutoresetMode.SAME_STEP and self._over.any():
            observations, info = self._restarted(observations, info)
        self._seen = observations
        return observations.copy(), rewards, terminated, truncated, info

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture (480, 480, 3) of each sub-environment."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() needs an environment made with render_mode='rgb_array'")
            return None
        states, ticks = self._plants.arm.unpadded(self._plants.state[:, 0]), self._plants.tick
        tasks = zip(states, self._table, ticks.tolist(), strict=True)
        return tuple(self._task.drawn(q, table, tick) for q, table, tick in tasks)

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads and release the picture."""
        if hasattr(self, "_plants"):  # Gymnasium also closes an object whose creation has failed
            self._plants.close()
            self._task.close()

    # ----------------------------------------------------------------------------------------------

    def _generator(self, place: int) -> np.random.Generator:
        generator = self._generators[place]
        if generator is None:
            generator, self._seeds[place] = seeding.np_random()
            self._generators[place] = generator
        return generator

    def _begin(self, places: Rows, options: Mapping[str, Any]) -> None:
        """Begin episodes in some sub-environments."""
        task, arm, angles = self._task, self._plants.arm, []
        for place in places.tolist():
            task.np_random = self._generator(place)
            angles.append(arm.rest(task.draw_task(options)))
            task.draw_noise()  # the same sequence of random numbers as in a single environment
            if self._table.shape[1:] != task.task_table.shape:
                self._table = np.zeros((self.num_envs, *task.task_table.shape))
                items = task.task_info().items()
                self._constant = {k: np.zeros((self.num_envs, *v.shape)) for k, v in items}
            self._table[place] = task.task_table
            for name, value in task.task_info().items():
                self._constant[name][place] = value
        self._plants.start(places, np.array(angles))
        self._over[places] = False

    def _look(
        self, torque: FloatArray, reasons: Mapping[int, str]
    ) -> tuple[Vector, dict[str, Any]]:
        """Return observations and infos of all sub-environments."""
        plants, task = self._plants, self._task
        channels = channels_of(plants.arm, plants.state, {*self._signals, "tip", "tip_velocity"})
        rows = np.minimum(plants.tick, self._table.shape[1] - 1)
        values = self._table[np.arange(self.num_envs), rows]
        apart = channels["tip"] - values[:, :2]
        info = {
            "time": plants.time.copy(),
            "tip": channels["tip"],
            "speed": np.hypot(*channels["tip_velocity"].T),
            "distance": np.hypot(*apart.T),
            "torque": torque,
            "reason": np.full(self.num_envs, "", dtype=object),
            **{name: value.copy() for name, value in self._constant.items()},
        }
        info["is_success"] = task.succeeded(values, info)
        for place, reason in reasons.items():
            info["reason"][place] = reason
            info["is_success"][place] = False
        readings = {name: channels[name] for name in self._signals}
        with np.errstate(over="ignore"):  # states of failed simulations may have any size
            return task.layout.vector(readings, values), info

    def _restarted(
        self, observations: Vector, info: dict[str, Any]
    ) -> tuple[Vector, dict[str, Any]]:
        """Begin the next episodes at once; return their observations, and the final ones."""
        over = self._over.copy()
        self._begin(np.flatnonzero(over), {})
        torque = np.where(over[:, None], 0.0, info["torque"])
        first, first_info = self._look(torque, {})
        final = np.full(self.num_envs, None, dtype=object)
        for place in np.flatnonzero(over):
            final[place] = observations[place].copy()
        names = [name for name in first_info if not name.startswith("_")]
        final_info = {name: info[name] for name in names}
        merged = {}
        for name in names:
            mask = over.reshape(-1, *[1] * (info[name].ndim - 1))
            merged[name] = np.where(mask, first_info[name], info[name])
        merged = _masked(merged, np.ones(self.num_envs, dtype=np.bool_))
        merged |= {"final_obs": final, "final_info": _masked(final_info, over)}
        merged |= {"_final_obs": over, "_final_info": over.copy()}
        return np.where(over[:, None], first, observations), merged


class ReachVectorEnv(ArmVectorEnv):
    """Vector environment of ``ReachEnv``; see ``ArmVectorEnv``."""

    kind = ReachEnv


class TrackPathVectorEnv(ArmVectorEnv):
    """Vector environment of ``TrackPathEnv``; see ``ArmVectorEnv``."""

    kind = TrackPathEnv


def _checked_mask(given: Any, count: int) -> BoolArray:
    """Return the mask of the sub-environments to reset, by default all."""
    if given is None:
        return np.ones(count, dtype=np.bool_)
    mask = np.asarray(given)
    if mask.shape != (count,) or mask.dtype != np.bool_ or not mask.any():
        rule = f"be ({count},) Booleans, at least one of them True"
        raise InputError(Problem("options['reset_mask']", rule, shown(given)))
    return mask


def _seeds(given: int | Sequence[int | None] | None, count: int, places: Rows) -> list[int | None]:
    """Return the seeds of the sub-environments ``places``."""
    if given is None:
        return [None] * len(places)
    if isinstance(given, int | np.integer):
        return [int(given) + place for place in places.tolist()]
    if len(given) != count:
        raise InputError(Problem("seed", f"be one number, or {count} of them", shown(given)))
    return [given[place] for place in places.tolist()]


def _masked(info: dict[str, Any], mask: BoolArray) -> dict[str, Any]:
    """Return an info with the mask of the sub-environments that have each item."""
    return info | {f"_{name}": mask.copy() for name in info}
