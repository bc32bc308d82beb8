"""Processor time of runs with controllers: `simulate` in a loop, and a batch in lanes.

`python -m benchmarks.closed_batches` prints only this table. The arm is that of Table I with hubs
and a payload, as in docs/tutorials/which-controller.md: a joint without inertia has no stable
sampled loop at 1 kHz. The runs have different starts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import flexarm as fa
from benchmarks.arms import table_one
from flexarm.control.contract.base import Controller

#: Duration of the motion (s), and its joint angles (rad) at the start and the end.
_DURATION, _START, _END = 2.0, [0.3, 0.6], [0.5, 0.9]
_GAINS = [40.0, 10.0], [20.0, 3.0]
_DISTANCE, _SAMPLE_TIME = 0.02, 1e-3


def _arm() -> fa.Arm:
    hubs = {"mass": 0.5, "hub_inertia": 0.02, "housing_inertia": 0.02}
    joints = [fa.Joint(hub_inertia=0.1), fa.Joint(**hubs)]
    return table_one(joints=joints, payload=fa.Payload(mass=0.1))


class _Python:
    """Joint PD control as users write it."""

    sample_time = _SAMPLE_TIME

    def reset(self) -> None:
        """Do nothing."""

    def update(
        self, t: float, measurement: fa.Measurement, reference: fa.Reference | None
    ) -> np.ndarray:
        assert reference is not None
        error = reference.joint_angle(t) - measurement.joint_angle
        rate = reference.joint_rate(t) - measurement.joint_rate
        return np.array(_GAINS[0]) * error + np.array(_GAINS[1]) * rate


def _controllers(arm: fa.Arm) -> dict[str, Controller | _Python]:
    own = {"sample_time": _SAMPLE_TIME}
    return {
        "joint PD": fa.JointPD(*_GAINS, **own),
        "joint PID": fa.JointPID(*_GAINS, 5.0, **own),
        "computed torque": fa.ComputedTorque(arm, frequency_hz=0.5, **own),
        "LQG": fa.LQG(arm, posture=_START, torque_limit=[200.0, 100.0], **own),
        "a Python class": _Python(),
    }


class Closed(NamedTuple):
    """Processor time (s) of one run with a controller, alone and in a batch."""

    controller: str
    single: float
    batch: float


def closed_batches(runs: int = 200, few: int = 5, repeats: int = 3) -> list[Closed]:
    """Measure runs of each controller; the least of some repetitions.

    Args:
        runs: of the batch. few: runs of `simulate`.
        repeats: number of turns.
    """
    arm = _arm()
    motion = fa.joint_motion(arm, _START, _END, _DURATION)
    moved = _DISTANCE * np.random.default_rng(3).uniform(-1.0, 1.0, (runs, 2))
    starts = [arm.rest(np.array(_START) + one) for one in moved]
    found = []
    for name, controller in _controllers(arm).items():
        own = {"controller": controller, "reference": motion, "progress": False}

        def alone(own: dict[str, object] = own) -> None:
            for start in starts[:few]:
                fa.simulate(arm, _DURATION, initial=start, rate=100.0, **own)

        def batch(own: dict[str, object] = own) -> None:
            many = {"channels": ["tip"], "rate": 100.0, "threads": 1}
            failure = fa.simulate_batch(arm, _DURATION, initial=starts, **many, **own)["failure"]
            assert not failure.str.len().any(), failure.values

        found.append(Closed(name, _least(alone, few, repeats), _least(batch, runs, repeats)))
    return found


def _least(call: Callable[[], None], runs: int, repeats: int) -> float:
    """Return the least processor time (s) of one run, after a call that compiles."""
    seconds = []
    for _ in range(repeats + 1):
        started = time.process_time()
        call()
        seconds.append((time.process_time() - started) / runs)
    return min(seconds[1:])


def table(found: list[Closed]) -> str:
    """Return the measurements as a table."""
    head = "| controller | `simulate` (ms) | in a batch (ms) | ratio |"
    rows = [
        f"| {one.controller} | {1e3 * one.single:.3g} | {1e3 * one.batch:.3g} | "
        f"{one.single / one.batch:.3g} |"
        for one in found
    ]
    return "\n".join([head, "| --- | --- | --- | --- |", *rows])


if __name__ == "__main__":
    print(table(closed_batches()))
