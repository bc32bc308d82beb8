"""Many runs of the Table I arm from different starts: one at a time, in lanes, in threads; peers.

`python -m benchmarks.rollouts` prints only this table.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from peers.flexarm_arm import Torque

import flexarm as fa
from benchmarks import programs
from benchmarks.arms import table_one
from benchmarks.measure import in_turns
from benchmarks.table_one import CASE, EXACT, PAPER, second_order, truths

#: Number of runs of the goal, and its time on two cores (s).
RUNS, GOAL = 1000, 0.15
#: Spread of the initial joint angles (rad); the first run is the case itself.
_SPREAD = 0.1
#: Modes of each link in flexarm, and the relative tolerance of `kennedy_carpenter_5`.
_MODES, _RTOL = 3, 8e-4
#: Arguments on the paper's arm, whose error is that of JAX.
_PAPER = {"integrator": "dormand_prince_8", "rtol": 1e-3, "atol": 1e-5}
#: Bars of each link and step (s) of MuJoCo; step (s) of JAX.
_MUJOCO, _JAX_STEP = (8, 2.5e-4), 6.25e-4
#: Threads of the batches and of MuJoCo.
_THREADS = 2


class Rollouts(NamedTuple):
    """Timed runs of one program.

    Attributes:
        program, setting: names. against: reference solution of the error.
        error: m, of the tip in the first run. rate: runs per second.
    """

    program: str
    setting: str
    against: str
    error: float
    rate: float


class _Entry(NamedTuple):
    program: str
    setting: str
    against: str
    runs: int
    tips: Callable[[int], np.ndarray]  # of the first of some runs (samples, 2), m


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


_OWN = {
    "torque": Torque(CASE),
    "rate": CASE.rate,
    "integrator": "kennedy_carpenter_5",
    "rtol": _RTOL,
    "atol": 1e-2 * _RTOL,
    "progress": False,
}


def _loop(count: int) -> np.ndarray:
    initial = [_arm().rest(angles) for angles in starts(count)]
    found = [fa.simulate(_arm(), CASE.duration, initial=start, **_OWN) for start in initial]
    return np.asarray(found[0]["tip"])


def _batch(
    count: int, threads: int, arm: Callable[[], fa.Arm] = _arm, **other: object
) -> np.ndarray:
    initial = [arm().rest(angles) for angles in starts(count)]
    own = {"initial": initial, "channels": ["tip"], "threads": threads, **_OWN, **other}
    return np.asarray(fa.simulate_batch(arm(), CASE.duration, **own)["tip"][0])


def _mujoco(count: int) -> np.ndarray:
    from peers import mujoco_arm

    return mujoco_arm.rollouts(CASE, *_MUJOCO, starts(count), _THREADS)[0]


def _jax(count: int) -> np.ndarray:
    from benchmarks import jax_diffrax

    states = jax_diffrax.many(CASE, _paper_arm(), _JAX_STEP, starts(count))
    return programs.tips(_paper_arm(), states[0])


def _entries(runs: int, few: int) -> list[_Entry]:
    own = f"kennedy_carpenter_5, {_MODES} modes, {programs.tolerances(_RTOL)}"
    # A load of zero excludes lanes.
    alone = partial(_batch, loads=[fa.Load(1, force=(0.0, 0.0))], threads=_THREADS)
    found = [
        _Entry("flexarm, `simulate` in a loop", own, EXACT, few, _loop),
        _Entry(f"flexarm, single runs in {_THREADS} threads", own, EXACT, few, alone),
        _Entry("flexarm, lanes, 1 thread", own, EXACT, runs, partial(_batch, threads=1)),
        _Entry(
            f"flexarm, lanes, {_THREADS} threads",
            own,
            EXACT,
            runs,
            partial(_batch, threads=_THREADS),
        ),
    ]
    found.append(
        _Entry(
            f"flexarm, lanes, {_THREADS} threads, the paper's model",
            f"dormand_prince_8, 2+1 elements, {programs.tolerances(1e-3)}",
            PAPER,
            runs,
            partial(_batch, threads=_THREADS, arm=_paper_arm, **_PAPER),
        )
    )
    missing = programs.missing()
    if "MuJoCo" not in missing:
        setting = "{} bars a link, RK4 step {:g} s".format(*_MUJOCO)
        name = f"MuJoCo, `rollout`, {_THREADS} threads"
        found.append(_Entry(name, setting, EXACT, few, _mujoco))
    if "JAX" not in missing:
        setting = f"2+1 elements, RK4 step {_JAX_STEP:g} s"
        found.append(_Entry("JAX, `vmap`", setting, PAPER, runs, _jax))
    return found


def rollouts(runs: int = RUNS, few: int = 40, repeats: int = 5) -> list[Rollouts]:
    """Time all programs alternately, each after a call that compiles.

    Args:
        runs: number of runs of the fast programs. few: of the others.
    """
    entries, known = _entries(runs, few), truths(CASE.duration)
    calls = {entry.program: partial(entry.tips, entry.runs) for entry in entries}
    seconds = in_turns(calls, repeats)
    found = []
    for entry in entries:
        missed = entry.tips(1) - known[entry.against]
        error = float(np.hypot(*missed.T).max())
        rate = entry.runs / seconds[entry.program]
        found.append(Rollouts(entry.program, entry.setting, entry.against, error, rate))
    return found


def table(found: list[Rollouts]) -> str:
    """Return the measurements as a table, with ratios to lanes against the same reference."""
    lanes = [one for one in found if f"lanes, {_THREADS}" in one.program]
    best = {one.against: one.rate for one in lanes}
    head = "| program | setting | against | tip error (m) | runs per second | ratio |"
    rows = [
        f"| {one.program} | {one.setting} | {one.against} | {one.error:.1e} | {one.rate:.3g} | "
        f"{best[one.against] / one.rate:.3g} |"
        for one in found
    ]
    return "\n".join([head, "| --- | --- | --- | --- | --- | --- |", *rows])


if __name__ == "__main__":
    print(table(rollouts()))
