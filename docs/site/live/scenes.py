"""The live pages: runs of ``fa.simulate``, and sliders that change their arguments.

The number of each slider takes a few values. The memory of the runs is computed for each of them,
so that a slider sets the very numbers that Python would have computed for its value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

import flexarm as fa


class Slider(NamedTuple):
    """A number that the reader sets; its values are evenly spaced, or listed."""

    label: str
    unit: str
    values: tuple[float, ...]
    start: float
    #: Whether it acts at once: "yes", "down" (only a smaller value), or "no": the run restarts.
    live: str = "yes"


class Trace(NamedTuple):
    """A quantity of the poses that the page draws over time."""

    label: str
    unit: str
    scale: float  # unit per SI unit
    link: int  # from 1
    column: int  # of ``kernels.observation.observables``
    limit: float = math.inf  # SI unit, at which a run ends, because the links have bent too far


class Case(NamedTuple):
    """Arguments of a run: ``fa.simulate(arm, duration, **arguments)``."""

    arm: fa.Arm
    arguments: dict[str, Any]


@dataclass(frozen=True)
class Scene:
    """A live page: its runs by label, for the values of its sliders by name."""

    cases: Callable[..., Mapping[str, Case]]
    sliders: Mapping[str, Slider]
    traces: tuple[Trace, ...]
    view: tuple[float, float, float, float]  # m: left, bottom, right, top
    duration: float  # s
    magnify: int = 1  # factor of the drawn bending at the start
    speed: float = 1.0  # of the clock at the start, over that of the motion
    #: False draws the arm in axes that turn with its first joint.
    turns: bool = True
    #: A button that sets a slider to its first value: (text, slider).
    button: tuple[str, str] | None = None

    def start(self) -> dict[str, float]:
        """Return the values of the sliders at the start."""
        return {name: slider.start for name, slider in self.sliders.items()}


#: Samples that a run records per second.
RATE = 240.0
#: Columns of poses: deflection of the tip of a link, and angle of its root.
DEFLECTION, ANGLE = 6, 2


def _steps(first: float, last: float, count: int) -> tuple[float, ...]:
    """Return evenly spaced values without the digits of rounding."""
    return tuple(round(float(value), 10) for value in np.linspace(first, last, count))


# The paper's arm -------------------------------------------------------------------------------


def _torques(first: float, second: float) -> dict[str, Case]:
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
    arm = fa.Arm(
        links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)]
    )
    start = arm.rest([0.0, 1.2])
    return {"arm": Case(arm, {"torque": lambda t: [first, second], "initial": start})}


# Softening and stiffening ------------------------------------------------------------------------


def _strip(**more: Any) -> fa.Link:
    section = fa.Rectangle(width=0.04, height=0.004)
    damping = fa.ModalDamping(ratio=0.005)
    return fa.Link(
        length=1.0, material="aluminium", section=section, modes=3, damping=damping, **more
    )


def _spin(rate: float) -> dict[str, Case]:
    cases = {}
    for label, theory in (("first order", "linear"), ("second order", "second_order")):
        arm = fa.Arm(links=[_strip()], joints=[fa.Joint(hub_inertia=50.0)], theory=theory)
        bent = fa.equilibrium(arm, [0.0], tip_force=(0.0, 2.0)).q
        cases[label] = Case(arm, {"initial": bent, "initial_rate": arm.rest([rate])})
    return cases


# Input shaping -----------------------------------------------------------------------------------


def _loaded_strip() -> fa.Arm:
    joint, payload = fa.Joint(hub_inertia=0.02), fa.Payload(mass=0.15)
    return fa.Arm(links=[_strip()], joints=[joint], payload=payload)


@cache
def _shaped_motions() -> tuple[fa.Arm, fa.JointPD, dict[str, Any]]:
    """Return the arm of the design, its controller, and the motions by label."""
    arm = _loaded_strip()
    controller = fa.JointPD([200.0], [12.0], sample_time=0.002)
    turn = fa.joint_motion(arm, start=[0.0], end=[0.5], duration=0.7, start_time=0.2)
    motions = {
        "as it is": turn,
        "ZV": fa.shaped(turn, arm, "zv", joints=controller),
        "ZVD": fa.shaped(turn, arm, "zvd", joints=controller),
    }
    return arm, controller, motions


def _shaping(payload: float) -> dict[str, Case]:
    arm, controller, motions = _shaped_motions()
    plant = fa.varied(arm, payload_mass=payload)
    return {
        label: Case(arm, {"controller": controller, "reference": motion, "plant": plant})
        for label, motion in motions.items()
    }


# A joint controller ------------------------------------------------------------------------------


def _gains(proportional: float, derivative: float, sample: float) -> dict[str, Case]:
    arm = _loaded_strip()
    controller = fa.JointPD([proportional], [derivative], sample_time=1e-3 * sample)
    goal = fa.joint_motion(arm, start=[0.2], end=[0.2], duration=1.0)
    start = {"initial": arm.rest([0.0]), "initial_rate": arm.rest([0.0])}
    return {"arm": Case(arm, {"controller": controller, "reference": goal, **start})}


# A payload that is dropped -----------------------------------------------------------------------


def _payload(mass: float) -> dict[str, Case]:
    rod = {"flexural_rigidity": 400.0, "mass_per_length": 0.61732, "modes": 2}
    damping = fa.ModalDamping(ratio=0.01)
    arm = fa.Arm(
        links=[
            fa.Link(length=1.2, damping=damping, **rod),
            fa.Link(length=0.9, damping=damping, **rod),
        ],
        joints=[
            fa.Joint(hub_inertia=0.1),
            fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02),
        ],
        payload=fa.Payload(mass=0.5),
        gravity=(0.0, -9.81),
    )
    posture = [0.5, -0.6]
    rest = fa.equilibrium(arm, posture)
    controller = fa.JointPD(
        [300.0, 60.0], [40.0, 6.0], feedforward=lambda t: rest.torque, sample_time=0.002
    )
    goal = fa.joint_motion(arm, start=posture, end=posture, duration=1.0)
    plant = fa.varied(arm, payload_mass=mass)
    start = {"initial": fa.equilibrium(plant, posture).q, "initial_rate": plant.rest([0.0, 0.0])}
    loop = {"controller": controller, "reference": goal, "plant": plant}
    return {"arm": Case(arm, {**loop, **start})}


def _deflection(link: int, limit: float = math.inf) -> Trace:
    return Trace(f"tip deflection, link {link}", "mm", 1e3, link, DEFLECTION, limit)


SCENES = {
    "torques": Scene(
        _torques,
        {
            "first": Slider("torque of joint 1", "N m", _steps(-2.0, 2.0, 41), 0.3),
            "second": Slider("torque of joint 2", "N m", _steps(-1.0, 1.0, 41), 0.1),
        },
        (_deflection(1, 0.3), _deflection(2, 0.2)),
        (-2.6, -2.6, 2.6, 2.6),
        6.0,
        magnify=10,
    ),
    "spin": Scene(
        _spin,
        {"rate": Slider("rate of rotation", "rad/s", _steps(0.0, 30.0, 31), 15.0, "no")},
        (_deflection(1, 0.3),),
        (-0.1, -0.45, 1.2, 0.45),
        4.0,
        magnify=2,
        speed=0.25,
        turns=False,
    ),
    "shaping": Scene(
        _shaping,
        {"payload": Slider("payload", "kg", _steps(0.05, 0.4, 15), 0.15, "no")},
        (_deflection(1),),
        (-0.15, -0.25, 1.25, 0.85),
        5.0,
    ),
    "gains": Scene(
        _gains,
        {
            "proportional": Slider("proportional gain", "N m/rad", _steps(0.0, 60.0, 31), 16.0),
            "derivative": Slider("derivative gain", "N m s/rad", _steps(0.0, 12.0, 25), 1.0),
            "sample": Slider("sample time", "ms", (1.0, 2.0, 5.0, 10.0, 20.0, 40.0), 1.0, "no"),
        },
        (Trace("joint angle", "deg", 180.0 / math.pi, 1, ANGLE, 1.5), _deflection(1, 0.3)),
        (-0.1, -0.45, 1.2, 0.55),
        4.0,
        magnify=2,
    ),
    "payload": Scene(
        _payload,
        {"mass": Slider("payload", "kg", _steps(0.0, 1.0, 21), 0.5, "down")},
        (_deflection(1, 0.3), _deflection(2, 0.2)),
        (-0.2, -0.6, 2.3, 1.3),
        10.0,
        magnify=5,
        button=("Drop the payload", "mass"),
    ),
}
