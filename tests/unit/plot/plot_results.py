"""Short results for tests of plots and animations."""

from __future__ import annotations

from functools import cache

import numpy as np

import flexarm as fa

LINK = {"length": 0.5, "flexural_rigidity": 3.0, "mass_per_length": 0.4, "elements": 1}


@cache
def arm() -> fa.Arm:
    return fa.Arm(links=[LINK, LINK], payload={"mass": 0.1})


def torque(t: float) -> np.ndarray:
    return np.array([0.4 * np.cos(20.0 * t), -0.1])


@cache
def result():
    start = {"initial": arm().rest([0.3, 0.6]), "initial_rate": arm().rest([2.0, 1.0])}
    return fa.simulate(arm(), 0.2, torque=torque, rate=500.0, stations=5, **start)


@cache
def rigid_result():
    start = {"initial": [0.3, 0.6], "initial_rate": [2.0, 1.0]}
    return fa.simulate(arm().rigid(), 0.2, torque=torque, rate=500.0, **start)
