"""Computing time of each controller per sample, in a closed loop on two flexible links."""

from __future__ import annotations

import statistics
import warnings
from collections.abc import Callable
from functools import partial

import numpy as np

import flexarm as fa
from flexarm.cases.scenario.scenario import prepare
from flexarm.control.contract.base import Controller
from flexarm.control.laws import CONTROLLERS
from flexarm.view.studio.values.starts import drive_of_kind, scenario_around

#: Joint angles (rad) at the start and the end of the motion, and its duration (s).
START, END, DURATION = [0.3, 1.2], [0.6, 1.5], 0.5
_LIMIT = [40.0, 10.0]


def arm() -> fa.Arm:
    """Return two links with a strain gauge each and a payload."""
    rod = {"flexural_rigidity": 600.0, "mass_per_length": 0.6, "elements": 1}
    rod["damping"] = fa.ModalDamping(ratio=0.005)
    gauges = [fa.Gauge(station=0.02, distance=0.005)]
    return fa.Arm(
        links=[fa.Link(length=length, gauges=gauges, **rod) for length in (1.0, 0.8)],
        joints=[
            fa.Joint(hub_inertia=0.2),
            fa.Joint(mass=0.5, hub_inertia=0.05, housing_inertia=0.05),
        ],
        payload=fa.Payload(mass=0.4),
    )


def _estimator(arm: fa.Arm, payload_deviation: float = 0.0) -> fa.EstimatorController:
    instruments = [fa.Instrument("joint_angle", noise=1e-4), fa.Instrument("strain", noise=1e-6)]
    estimator = fa.ExtendedKalmanFilter(arm, instruments, payload_deviation=payload_deviation)
    return fa.EstimatorController(estimator, fa.JointPD(*_PD))


_PD = ([300.0, 80.0], [30.0, 8.0])
_ADAPTED = ["payload.mass", "joint_1.viscous", "joint_2.viscous"]
#: Functions that create controllers whose starting values are not the usual ones: with limits,
#: horizons or parameters that determine the time. Others have the starting values of the studio.
MAKERS: dict[str, Callable[[fa.Arm], Controller]] = {
    "joint_pid": lambda arm: fa.JointPID(*_PD, [50.0, 10.0], arm=arm),
    "repetitive": lambda arm: fa.RepetitiveControl(fa.JointPD(*_PD), 0.4, [100.0, 30.0]),
    "adaptive": lambda arm: fa.Adaptive(arm, 10.0, [30.0, 8.0], 0.5, _ADAPTED),
    "sliding_mode": lambda arm: fa.SlidingMode(
        arm, 10.0, 0.3, {"payload.mass": 0.8}, reaching=[1.0, 0.5], damping=[30.0, 8.0]
    ),
    "rbf_adaptive": lambda arm: fa.RBFAdaptive(
        arm, 10.0, [30.0, 8.0], 2.0, [0.0, 1.0], [1.0, 2.0], centres=(1, 5)
    ),
    "composite": lambda arm: fa.Composite(arm, torque_limit=_LIMIT),
    "lqg": lambda arm: fa.LQG(arm, torque_limit=_LIMIT),
    "mu_synthesis": lambda arm: fa.MuSynthesis(
        arm,
        bandwidth=8.0,
        rigidity_uncertainty=0.0,
        payload_uncertainty=0.05,
        sensitivity=4.0,
        iterations=1,
        scaling_order=0,
    ),
    "mpc": lambda arm: fa.MPC(arm, torque_limit=_LIMIT, horizon=10),
    "nonlinear_mpc": lambda arm: fa.NonlinearMPC(arm, torque_limit=_LIMIT),
    "estimator": _estimator,
}
#: Conditions in which controllers take longer. Without limits, LQG requests up to 28 and 9 N m.
CONDITIONS: dict[tuple[str, str], Callable[[fa.Arm], Controller]] = {
    ("mpc", "torques at their limits, horizon 10"): lambda arm: fa.MPC(
        arm, torque_limit=[6.0, 2.0], horizon=10
    ),
    ("mpc", "torques at their limits, horizon 40"): lambda arm: fa.MPC(
        arm, torque_limit=[6.0, 2.0]
    ),
    ("nonlinear_mpc", "torques at their limits"): lambda arm: fa.NonlinearMPC(
        arm, torque_limit=[6.0, 2.0]
    ),
    ("estimator", "payload unknown"): lambda arm: _estimator(arm, payload_deviation=0.4),
}


def _started(name: str, arm: fa.Arm) -> Controller:
    """Return a controller with its starting values in the studio."""
    scenario = scenario_around(arm.spec)
    drive = drive_of_kind(scenario, name)
    controller: Controller = prepare(scenario.replace(drive=drive)).options["controller"]
    return controller


def microseconds(repeats: int = 5, duration: float = DURATION) -> dict[tuple[str, str], float]:
    """Return the time of one ``update`` by name and condition: medians of alternating runs."""
    plant = arm()
    motion = fa.joint_motion(plant, START, END, DURATION)
    makers = {(name, ""): MAKERS.get(name, partial(_started, name)) for name in CONTROLLERS}
    makers |= CONDITIONS
    controllers = {key: make(plant) for key, make in sorted(makers.items())}
    found: dict[tuple[str, str], list[float]] = {key: [] for key in controllers}
    for turn in range(repeats + 1):
        for key, controller in controllers.items():
            seconds = _per_update(plant, controller, motion, duration)
            if turn > 0:  # the first run loads machine code
                found[key].append(1e6 * seconds)
    return {key: statistics.median(values) for key, values in found.items()}


def _per_update(plant: fa.Arm, controller: Controller, motion: fa.Motion, duration: float) -> float:
    settings = {"initial": plant.rest(np.array(START)), "progress": False}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        result = fa.simulate(plant, duration, controller=controller, reference=motion, **settings)
    return result.attrs["controller_seconds"] / result.attrs["controller_calls"]
