"""Many runs of the Table I arm from different starts: one at a time, in lanes, in threads; peers.

`python -m benchmarks.rollouts` prints only this table.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from peers.flexarm_arm import Torque

import flexarm as fa
from benchmarks import programs
from benchmarks.arms import table_one
from benchmarks.table_one import CASE, EXACT, PAPER, second_order, truths

#: Number of runs of the goal, and its time on two cores (s).
RUNS, GOAL = 1000, 0.15
#: Spread of the initial joint angles (rad); the first run is the case itself.
_SPREAD = 0.1
#: Arguments of flexarm: second-order theory with three modes on each link.
_MODES, _STEP = 3, 1.25e-3
_MUJOCO, _JAX_STEP = (8, 2.5e-4), 6.25e-4


class Rollouts(NamedTuple):
    """Timed runs of one program.

    Attributes:
        program, setting: names. against: reference solution of the error.
        error: m, of the tip in the first run. runs: number of runs that were timed.
        seconds: for all of them.
    """

    program: str
    setting: str
    against: str
    error: float
    runs: int
    seconds: float

    @property
    def rate(self) -> float:
        """Runs per second."""
        return self.runs / self.seconds


def starts(count: int) -> np.ndarray:
    """Return initial joint angles (count, 2)."""
    moved = _SPREAD * np.random.default_rng(3).uniform(-1.0, 1.0, (count, 2))
    moved[0] = 0.0
    return CASE.joint_angles + moved


@cache
def _arm() -> fa.Arm:
    return second_order(elements=16, modes=_MODES)


@cache
def _paper_arm() -> fa.Arm:
    return table_one()


def _own(count: int, threads: int, **how: object) -> np.ndarray:
    arm = _arm()
    batch = fa.simulate_batch(
        arm,
        CASE.duration,
        torque=Torque(CASE),
        initial=[arm.rest(angles) for angles in starts(count)],
        rate=CASE.rate,
        channels=["tip"],
        threads=threads,
        progress=False,
        **{"integrator": "rk4", "step": _STEP, **how},
    )
    return np.asarray(batch["tip"][0])


def _one_at_a_time(count: int) -> np.ndarray:
    arm = _arm()
    results = [
        fa.simulate(
            arm,
            CASE.duration,
            torque=Torque(CASE),
            initial=arm.rest(angles),
            rate=CASE.rate,
            integrator="rk4",
            step=_STEP,
            progress=False,
        )
        for angles in starts(count)
    ]
    return np.asarray(results[0]["tip"])


def _mujoco(count: int, threads: int) -> np.ndarray:
    from peers import mujoco_arm

    tips = mujoco_arm.rollouts(CASE, *_MUJOCO, starts(count), threads)
    return tips[0]


def _jax(count: int) -> np.ndarray:
    from benchmarks import jax_diffrax

    arm = _paper_arm()
    states = jax_diffrax.many(CASE, arm, _JAX_STEP, starts(count))
    return programs.tips(arm, states[0])


def rollouts(runs: int = RUNS, few: int = 100, threads: int = 2) -> list[Rollouts]:
    """Time all programs, each after a call that compiles.

    Args:
        runs: number of runs in lanes. few: of slow programs. threads: of the last entries.
    """
    rk4 = f"rk4, {_MODES} modes, step {_STEP:g} s"
    entries: list[tuple[str, str, str, int, Callable[[int], np.ndarray]]] = [
        ("flexarm, `simulate` in a loop", rk4, EXACT, few, _one_at_a_time),
        (
            "flexarm, batch without lanes, 1 thread",
            rk4,
            EXACT,
            few,
            partial(_own, threads=1, loads=[fa.Load(1)]),
        ),
        ("flexarm, lanes, 1 thread", rk4, EXACT, runs, partial(_own, threads=1)),
        (f"flexarm, lanes, {threads} threads", rk4, EXACT, runs, partial(_own, threads=threads)),
    ]
    missing = programs.missing()
    if "MuJoCo" not in missing:
        segments, step = _MUJOCO
        setting = f"{segments} bars a link, RK4 step {step:g} s"
        name = f"MuJoCo, rollout, {threads} threads"
        entries.append((name, setting, EXACT, few, partial(_mujoco, threads=threads)))
    if "JAX" not in missing:
        setting = f"2+1 elements, RK4 step {_JAX_STEP:g} s"
        entries.append(("JAX, vmap", setting, PAPER, runs, _jax))
    known = truths(CASE.duration)
    found = []
    for program, setting, against, count, run in entries:
        tip = run(count)  # compiles
        error = float(np.hypot(*(tip - known[against]).T).max())
        seconds = []
        for _ in range(3):
            started = time.perf_counter()
            run(count)
            seconds.append(time.perf_counter() - started)
        found.append(Rollouts(program, setting, against, error, count, sorted(seconds)[1]))
    return found
