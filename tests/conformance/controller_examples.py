"""Every controller of the registry for an arm of two joints, in Python and as drives of a file.

A controller without an entry has its starting values of the studio. It has one in `ARGUMENTS` if
its loop needs others, and one in `DIFFERENT` if a file cannot have the same values.
"""

from functools import partial
from inspect import Parameter, signature
from typing import Any

import pytest

import flexarm as fa
from arms import chain
from flexarm.control.laws import CONTROLLERS
from flexarm.view.studio.values.starts import drive_of_kind, scenario_around

SAMPLE_TIME = 0.004


def two_links():
    """Return the arm of two joints for which every controller here is designed."""
    section = {"flexural_rigidity": [30.0, 20.0], "mass_per_length": [0.5, 0.4], "elements": 1}
    return chain((0.8, 0.6), [0.05, 0.03], gauge=(0.1, 0.005), gauged=1, **section)


def joint_pd():
    return fa.JointPD([8.0, 3.0], [0.8, 0.3], sample_time=SAMPLE_TIME)


def kalman_filter():
    instruments = [fa.Instrument("joint_angle", noise=1e-4), fa.Instrument("strain", noise=1e-6)]
    return fa.ExtendedKalmanFilter(two_links(), instruments, sample_time=SAMPLE_TIME)


#: A drive whose delays, lag and filtered rates are states of linear designs.
LATE = fa.Hardware(
    instruments=[
        fa.Instrument("joint_angle", rate_cutoff=25.0),
        fa.Instrument("strain", delay=SAMPLE_TIME),
    ],
    motors=fa.Motors(delay=1.5 * SAMPLE_TIME, time_constant=0.002),
)
#: Torques that keep the links of ``two_links`` within the linear theory for any motion.
LIMIT = [2.0, 0.6]
_GAINS = {"proportional": [8.0, 3.0], "derivative": [0.8, 0.3]}
_BOUNDS = {"posture": [0.4, 0.1], "torque_limit": LIMIT}
#: Arguments of each controller of the registry; functions return objects for each use.
ARGUMENTS: dict[str, dict[str, Any]] = {
    "adaptive": {"bandwidth": 2.0, "damping": [0.8, 0.2], "adaptation": 0.003},
    "adaptive_force": {"frequency": 1.5},
    "admittance": {"frequency": 1.5},
    "composite": _BOUNDS,
    "computed_torque": {"frequency_hz": 0.3, "damping_ratio": 0.5},
    "disturbance_observer": {"inner": joint_pd, "cutoff": 0.2},
    "estimator": {"estimator": kalman_filter, "inner": joint_pd},
    "hybrid_force": {"frequency": 1.5},
    "impedance": {"posture_frequency": 1.5},
    "integral_resonant_control": {"inner": joint_pd},
    "joint_pd": _GAINS,
    "joint_pid": {**_GAINS, "integral": [2.0, 1.0], "arm": two_links, "sag": True},
    "loop_shaping": {"posture": [0.4, 0.1], "bandwidth": 8.0, "integral": 0.8},
    "lqg": {**_BOUNDS, "integral": True},
    # With less weight on the torques, limits become active and inactive at single samples.
    "mpc": {**_BOUNDS, "horizon": 10, "acceptable_torque": [4.6, 0.59]},
    # Of this arm without payload and damping; with scalings the design takes seconds.
    "mu_synthesis": {
        "posture": [0.4, 0.1],
        "bandwidth": 4.0,
        "rigidity_uncertainty": 0.05,
        "payload_uncertainty": 0.0,
        "sensitivity": 4.0,
        "iterations": 1,
        "scaling_order": 0,
    },
    "output_redefinition": {"inner": joint_pd, "weight": -0.5},
    "nonlinear_mpc": {**_BOUNDS, "horizon": 8},
    "neural_force": {"frequency": 1.5, "features": 10},
    "positive_position_feedback": {"inner": joint_pd, "damping_ratio": 0.2},
    "prescribed_performance": {
        "bandwidth": 8.0,
        "damping": [0.8, 0.3],
        "bound": 0.3,
        "rate_bound": 8.0,
        "start_bound": 1.0,
        "gain_limit": 2.0,
    },
    "rbf_adaptive": {
        "bandwidth": 8.0,
        "damping": [0.8, 0.3],
        "adaptation": 0.001,
        "lower": -1.0,
        "upper": 1.0,
    },
    "repetitive": {
        "inner": joint_pd,
        "period": 0.4,
        "proportional": [2.0, 0.8],
        "derivative": 0.1,
    },
    "sliding_mode": {
        "bandwidth": 2.0,
        "boundary_layer": 0.5,
        "uncertainty": {"link_2.mass": 0.02},
        "reaching": [0.1, 0.02],
        "damping": [0.5, 0.1],
    },
    "strain_feedback": {
        **_GAINS,
        "strain": [[100.0], [0.0]],
        "strain_rate": [[0.1], [0.0]],
    },
    "wave_based_control": {"inner": joint_pd},
}


def usual(name: str) -> dict[str, Any]:
    """Return the arguments of a controller without an entry."""
    drive = drive_of_kind(scenario_around(two_links().spec), name)
    content = {key: drive[key] for key in drive if key not in ("kind", "sample_time")}
    return {**content, "inner": joint_pd} if "inner" in content else content


ARGUMENTS |= {name: usual(name) for name in sorted(CONTROLLERS) if name not in ARGUMENTS}

_WITHOUT_SLYCOT = "MuSynthesis was not tried, it needs: pip install 'flexarm[robust]'"


def complete(name: str) -> dict[str, Any]:
    """Return the arguments of a controller, with its arm and its sample time if it has them."""
    wanted = signature(CONTROLLERS[name]).parameters
    required = "arm" in wanted and wanted["arm"].default is Parameter.empty
    arm = {"arm": two_links} if required else {}
    own = "sample_time" in wanted and "inner" not in wanted
    return {**arm, **ARGUMENTS[name], **({"sample_time": SAMPLE_TIME} if own else {})}


def example(name: str, **changes: Any) -> Any:
    """Return a new controller, with changes of its arguments."""
    if name == "mu_synthesis":
        pytest.importorskip("slycot", reason=_WITHOUT_SLYCOT)
    given = {**complete(name), **changes}.items()
    return CONTROLLERS[name](**{key: v() if callable(v) else v for key, v in given})


#: Functions that return a new controller, by name.
EXAMPLES = {name: partial(example, name) for name in ARGUMENTS}

_PD = {"kind": "joint_pd", **_GAINS, "sample_time": SAMPLE_TIME}
_READ = [{"signal": "joint_angle", "noise": 1e-4}, {"signal": "strain", "noise": 1e-6}]
#: Drives of a file whose keys differ from the arguments.
DIFFERENT: dict[str, dict[str, Any]] = {
    "estimator": {"inner": _PD, "estimator": {"instruments": _READ}},
    "joint_pid": {**_GAINS, "integral": [2.0, 1.0], "gravity": "sag"},
    "strain_feedback": {**_GAINS, "strain": [100.0, 50.0], "strain_rate": [0.1, 0.0]},
}
_INNER = {"inner": _PD}
#: The same controllers as drives of a scenario, without kind and sample time.
DRIVES = {
    name: DIFFERENT.get(name) or {**given, **(_INNER if "inner" in given else {})}
    for name, given in ARGUMENTS.items()
}
