"""Time of `fa.sensitivities` and `fa.goal_gradient` over that of `fa.simulate`, in three tables.

The arm of Table I with two elements on each link, a payload, damping and viscous friction moves for
some seconds under smooth torques, with 100 samples per second. Medians of alternating calls; of the
gradient, the shortest ones. The tables are those of the page "Accuracy".

    python docs/performance/measure_derivatives.py
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

import flexarm as fa

#: Integrator, duration (s) and number of parameters of each row.
ROWS = (
    ("dormand_prince_8", 2.0, 1),
    ("dormand_prince_8", 2.0, 8),
    ("dormand_prince_8", 2.0, 20),
    ("dormand_prince_8", 20.0, 20),
    ("kennedy_carpenter_5", 2.0, 20),
)
REPEATS = 9
_LINKS = "flexural_rigidity", "mass_per_length", "damping.stiffness_coefficient"
_JOINTS = "hub_inertia", "damping", "friction.viscous", "friction.coulomb"
PATHS = [
    *(f"links[{link}].{name}" for link in range(2) for name in _LINKS),
    *(f"joints[{joint}].{name}" for joint in range(2) for name in _JOINTS),
    *("joints[1].mass", "joints[1].housing_inertia"),
    *("payload.mass", "payload.inertia", "initial[0]", "initial_rate[0]"),
]


def arm() -> fa.Arm:
    """Return two links with everything that the parameters change."""
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": 2}
    rod["damping"] = fa.RayleighDamping(stiffness_coefficient=1e-5)
    joint = {
        "damping": 0.1,
        "friction": fa.Friction(coulomb=0.05, viscous=0.05, smoothing_rate=0.5),
    }
    return fa.Arm(
        links=[fa.Link(length=length, **rod) for length in (1.4142, 1.0)],
        joints=[
            fa.Joint(hub_inertia=0.1, **joint),
            fa.Joint(hub_inertia=0.05, mass=0.3, housing_inertia=0.01, **joint),
        ],
        payload=fa.Payload(mass=0.4, inertia=0.01),
    )


def medians(
    calls: dict[str, Callable[[], object]],
    repeats: int,
    chosen: Callable[[list[float]], float] = statistics.median,
) -> dict[str, float]:
    """Return the median time (s) of each call, or another ``chosen`` one."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeats + 1):
        for name, call in calls.items():
            started = time.perf_counter()
            call()
            times[name].append(time.perf_counter() - started)
    return {name: chosen(values[1:]) for name, values in times.items()}


def table(repeats: int = REPEATS, shortest: float = 1.0) -> str:
    """Return the table; durations are divided by ``shortest``."""
    lines = [
        "| integrator | duration | parameters | `simulate` | `sensitivities` | ratio |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    own = arm()
    for integrator, duration, count in ROWS:
        given = {
            "torque": lambda t: [np.sin(3.0 * t), 0.5 * np.cos(3.0 * t)],
            "rate": 100.0,
            "integrator": integrator,
            "progress": False,
        }
        span = duration / shortest
        found = medians(
            {
                "run": lambda span=span, given=given: fa.simulate(own, span, **given),
                "derivatives": lambda span=span, given=given, count=count: fa.sensitivities(
                    own, span, PATHS[:count], channels=["tip"], **given
                ),
            },
            repeats,
        )
        run, derivatives = found["run"], found["derivatives"]
        cells = integrator, f"{duration:g} s", count, f"{1e3 * run:.1f} ms"
        rest = f"{1e3 * derivatives:.1f} ms", f"{derivatives / run:.1f}"
        lines.append(f"| {' | '.join(map(str, (*cells, *rest)))} |")
    return "\n".join(lines)


def controllers(own: fa.Arm) -> dict[str, fa.Controller]:
    """Return a linear and a nonlinear controller of an arm."""
    return {
        "JointPD": fa.JointPD([60.0, 20.0], [12.0, 4.0], sample_time=2e-3),
        "ComputedTorque": fa.ComputedTorque(own, frequency_hz=0.5, sample_time=2e-3),
    }


def loop_table(repeats: int = REPEATS, duration: float = 2.0) -> str:
    """Return the table of closed loops along a motion of the joints."""
    lines = [
        "| controller | parameters | `simulate` | `sensitivities` | ratio |",
        "| --- | --- | --- | --- | --- |",
    ]
    own = arm()
    motion = fa.joint_motion(own, [0.0, 0.0], [0.5, 0.3], 1.0)
    for name, controller in controllers(own).items():
        for count in (1, 8, 20):
            given = {"controller": controller, "reference": motion, "rate": 100.0}
            found = medians(
                {
                    "run": lambda given=given: fa.simulate(own, duration, **given),
                    "derivatives": lambda given=given, count=count: fa.sensitivities(
                        own, duration, PATHS[:count], channels=["tip"], **given
                    ),
                },
                repeats,
            )
            run, derivatives = found["run"], found["derivatives"]
            cells = f"`{name}`", count, f"{1e3 * run:.0f} ms", f"{1e3 * derivatives:.0f} ms"
            lines.append(f"| {' | '.join(map(str, cells))} | {derivatives / run:.1f} |")
    return "\n".join(lines)


#: Integrator, torque interpolation and number of torque samples of each joint, at 500 Hz, of each
#: row of the gradient.
GRADIENTS = (
    ("dormand_prince_8", "hold", 100),
    ("dormand_prince_8", "hold", 1000),
    ("dormand_prince_8", "cubic", 1000),
    ("kennedy_carpenter_5", "hold", 1000),
)


def gradient_table(repeats: int = 30) -> str:
    """Return the table of `fa.goal_gradient`, by the shortest of the calls."""
    lines = [
        "| integrator | interpolation | torque samples | `simulate` | `goal_gradient` | ratio |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    own = arm()
    for integrator, interpolation, count in GRADIENTS:
        times = np.arange(count) / 500.0
        torque = np.stack([np.sin(3.0 * times), 0.5 * np.cos(3.0 * times)], axis=1)
        given = {
            "torque": torque,
            "rate": 500.0,
            "torque_interpolation": interpolation,
            "integrator": integrator,
            "progress": False,
        }
        span = count / 500.0
        weights = {"tip": np.ones((count + 1, 2))}
        found = medians(
            {
                "run": lambda span=span, given=given: fa.simulate(own, span, **given),
                "gradient": lambda span=span, given=given, weights=weights: fa.goal_gradient(
                    own, span, weights, **given
                ),
            },
            repeats,
            min,
        )
        run, gradient = found["run"], found["gradient"]
        cells = (
            integrator,
            interpolation,
            2 * count,
            f"{1e3 * run:.1f} ms",
            f"{1e3 * gradient:.1f} ms",
        )
        lines.append(f"| {' | '.join(map(str, cells))} | {gradient / run:.1f} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
    for more in (loop_table, gradient_table):
        print()
        print(more())
