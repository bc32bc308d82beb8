"""Time of calls from Python: `simulate` outside its steps, and single evaluations.

`python -m benchmarks.whole_call` prints only these tables.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from functools import partial
from itertools import count
from typing import Any, NamedTuple

import numpy as np

import flexarm as fa
from benchmarks.arms import moving_state, table_one
from benchmarks.measure import in_turns
from benchmarks.raw import stopwatch
from flexarm.integrate import INTEGRATORS

#: Goals for the time of `simulate` outside its steps (ms): of open-loop runs, and of a loop with 20
#: microseconds a sample.
GOAL, LOOP_GOAL = 2.0, 42.0
#: Runs in a closed loop.
LOOPS = tuple(
    f"{law} at 1 kHz, 1000 samples per second"
    for law in ("joint PD", "computed torque", "joint PD with encoders, limits and a delay")
)
#: Goals for the times of single calls (microseconds), on an idle machine.
GOALS = {
    "`Arm.forward_dynamics`": 8.0,
    "`Arm.inverse_dynamics`": None,
    "`Arm.derivatives`": 30.0,
    "`Plant.step` of 1 ms": 20.0,
    "`Arm(...)` of new links": 2000.0,
    "`Arm(...)` of links that an arm had before": None,
}
_DURATION = 2.0


class Whole(NamedTuple):
    """Medians (s) over the calls of `simulate` for one run."""

    name: str
    steps: float
    whole: float
    beside: float  # median of the differences


def arm(rigidity: float = 105.0) -> fa.Arm:
    """Return the paper's arm with four modes on each link."""
    return table_one((2, 2), rigidity)


def _with_motors(arm: fa.Arm) -> fa.Arm:
    """Return the arm with motors; without their inertia, loops at 1 kHz are unstable."""
    first, second = arm.spec.joints
    joints = [
        first.replace(hub_inertia=0.034),
        second.replace(hub_inertia=0.013, housing_inertia=0.013),
    ]
    return fa.Arm(arm.spec.replace(joints=joints))


def _runs(arm: fa.Arm, duration: float) -> dict[str, tuple[str, dict[str, Any]]]:
    """Return the integrator and the arguments of each run by name."""
    initial = arm.rest([0.3, -0.5])
    times = np.arange(int(duration * 100.0) + 1) / 100.0
    torque = 0.1 * np.stack([np.sin(3.0 * times), np.cos(3.0 * times)], axis=1)
    low = {"rate": 100.0, "initial": initial}
    implicit = "kennedy_carpenter_5"

    def wave(t: float) -> tuple[float, float]:
        return 0.1 * math.sin(3.0 * t), 0.1 * math.cos(3.0 * t)

    plant = _with_motors(arm)
    laws = fa.JointPD([20.0, 10.0], [2.0, 1.0]), fa.ComputedTorque(plant, 1.0)
    motion = fa.joint_motion(arm, [0.3, -0.5], [0.8, -0.9], _DURATION)
    loops = [{"plant": plant, "controller": law, "reference": motion} for law in laws]
    encoder = fa.Instrument("joint_angle", resolution=1e-4, rate_cutoff=100.0)
    motors = fa.Motors(torque_limit=[50.0, 20.0], delay=1e-3)
    loops.append({**loops[0], "hardware": fa.Hardware([encoder], motors)})
    return {
        "no torque, 100 samples per second": ("dormand_prince_8", low),
        "torque samples, 100 per second": (implicit, low | {"torque": torque}),
        "torque function, 100 per second": (implicit, low | {"torque": wave}),
        "no torque, 1000 samples per second": ("dormand_prince_8", {"initial": initial}),
        **{name: ("dormand_prince_8", loop) for name, loop in zip(LOOPS, loops, strict=True)},
    }


def simulations(repeats: int = 60, duration: float = _DURATION) -> list[Whole]:
    """Time calls of `simulate` alternately."""
    plant = arm()
    calls = {}
    for name, (integrator, options) in _runs(plant, duration).items():
        method = INTEGRATORS[integrator]()
        options = options | {"integrator": method, "progress": False, "rtol": 1e-4}
        calls[name] = partial(fa.simulate, plant, duration, **options), stopwatch(method)
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for turn in range(repeats + 5):
        for name, (call, spent) in calls.items():
            spent.clear()
            started = time.perf_counter()
            call()
            whole = time.perf_counter() - started
            if turn >= 5:  # the first calls load machine code and resolve types
                times[name].append((sum(spent), whole))
    median = statistics.median
    return [
        Whole(
            name,
            median(steps for steps, _ in found),
            median(whole for _, whole in found),
            median(whole - steps for steps, whole in found),
        )
        for name, found in times.items()
    ]


def microseconds(repeats: int = 200, calls: int = 20) -> dict[str, float]:
    """Return the times of single calls, measured alternately."""
    plant = arm()
    q, qd, torque = moving_state(plant)
    stepped = fa.Plant(plant, 1e-3, warn=False)
    candidates: Mapping[str, Callable[[], object]] = {
        "`Arm.forward_dynamics`": partial(plant.forward_dynamics, q, qd, torque),
        "`Arm.inverse_dynamics`": partial(plant.inverse_dynamics, q, qd, qd),
        "`Arm.derivatives`": partial(plant.derivatives, q, qd, torque),
        "`Plant.step` of 1 ms": partial(stepped.step, 0.01 * torque),
    }
    found = in_turns(candidates, repeats, calls)
    # The constants of a link are kept for further arms, so a new link needs a new number.
    rigidities = count(105.0, 1e-6)
    arms = {
        "`Arm(...)` of new links": lambda: arm(next(rigidities)),
        "`Arm(...)` of links that an arm had before": arm,
    }
    found |= in_turns(arms, max(repeats // 4, 1))
    return {name: 1e6 * found[name] for name in GOALS}


def main() -> None:
    """Print the tables."""
    from benchmarks.report import calls_table, whole_table

    print(whole_table(simulations()), calls_table(microseconds()), sep="\n\n")


if __name__ == "__main__":
    main()
