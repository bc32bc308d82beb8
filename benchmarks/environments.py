"""Steps per second of the Gymnasium environment `flexarm/Reach-v0`: single and vector.

`python -m benchmarks.environments` prints only this table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple

import gymnasium
import numpy as np

import flexarm.bridges.gymnasium_env  # noqa: F401  registers the environments
from benchmarks.measure import in_turns

#: Steps per second of the goal, on two cores.
GOAL = 300_000
#: Largest fraction of a single environment's time outside `Plant.step`.
OUTSIDE = 0.3
_NAME, _THREADS, _SYNC, _PLANT = "flexarm/Reach-v0", 2, 16, "plant"
#: Steps of an episode.
_EPISODE = 600


class Environments(NamedTuple):
    """Steps per second of environments, and the time of a single one outside its plant.

    Attributes:
        rates: steps per second by the name of the environment.
        outside: fraction of the time of a single environment outside `Plant.step`.
    """

    rates: dict[str, float]
    outside: float


def environments(count: int = 1024, steps: int = _EPISODE, repeats: int = 5) -> Environments:
    """Measure episodes with random actions, including the begin of each.

    Args:
        count: sub-environments of the vector environments.
        steps: of each episode.
        repeats: number of turns.
    """
    random = np.random.default_rng(0)
    many = random.uniform(-0.5, 0.5, (steps, count, 2)).astype(np.float32)
    few = list(many[:, 0])
    env: Any = gymnasium.make(_NAME).unwrapped
    torques = [env.torque_limit * action for action in few]
    some = min(count, _SYNC)
    sync = gymnasium.make_vec(_NAME, num_envs=some, vectorization_mode="sync")
    timed: dict[str, tuple[int, Callable[[], object]]] = {
        "single": (steps, lambda: _steps(env, env.step, few)),
        _PLANT: (steps, lambda: _steps(env, env.plant.step, torques)),
        f"`SyncVectorEnv` of Gymnasium, {some}": (
            some * steps,
            lambda: _steps(sync, sync.step, many[:, :some]),
        ),
    }
    for threads in dict.fromkeys((1, _THREADS)):
        envs = gymnasium.make_vec(_NAME, num_envs=count, threads=threads)
        name = f"vector, {count}, {threads} thread{'s' * (threads > 1)}"
        timed[name] = count * steps, partial(_steps, envs, envs.step, many)
    seconds = in_turns({name: call for name, (_, call) in timed.items()}, repeats)
    rates = {name: timed[name][0] / value for name, value in seconds.items()}
    return Environments(rates, 1.0 - rates["single"] / rates.pop(_PLANT))


def _steps(env: Any, step: Callable[[Any], object], inputs: Iterable[np.ndarray]) -> None:
    env.reset()
    for one in inputs:
        step(one)


def table(found: Environments) -> str:
    """Return the table of docs/performance."""
    single = found.rates["single"]
    lines = ["| environment | steps per second | times the single one |", "| --- | --- | --- |"]
    lines += [
        f"| {name} | {rate:,.0f} | {rate / single:.1f} |" for name, rate in found.rates.items()
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    measured = environments()
    print(table(measured))
    print(f"A single environment spends {measured.outside:.0%} of its time outside the plant.")
