"""Valid keyword arguments of all public callables and methods, to be replaced by wrong values.

`test_calls.py` fails if a public name is missing here.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import flexarm as fa
from arms import chain
from conformance.controller_examples import EXAMPLES, complete
from flexarm.control.laws import CONTROLLERS as REGISTRY
from flexarm.motion.timing import quintic
from fuzz.arm_calls import ARM, STATE, Q, arm, start, wound
from fuzz.filter_calls import FILTER_METHODS, FILTERS
from fuzz.identification_calls import IDENTIFICATION, RESULT

end = [0.5, 0.8]


@cache
def spinning() -> fa.Arm:
    """Return an arm of one link, which may spin and be integrated by any method."""
    return chain([1.0], [0.05], flexural_rigidity=30.0, mass_per_length=0.5, elements=1)


@cache
def linkage() -> fa.Arm:
    """Return two links, the tip of which stays on a line."""
    closures = [fa.Closure(kind="line", link=2)]
    return fa.Arm(links=[LINK, LINK], closures=closures)


@cache
def motion() -> Any:
    return fa.joint_motion(arm(), start, end, 1.0)


@cache
def loaded() -> Any:
    section = fa.Rectangle(width=0.03, height=0.004)
    beam = fa.Arm(links=[fa.Link(length=1.0, material="steel", section=section, elements=1)])
    return fa.simulate(beam, 0.01, initial=beam.rest([0.1]), stations=3)


@cache
def limits() -> fa.MotionLimits:
    return fa.MotionLimits(torque=4.0)


@cache
def optimal() -> fa.OptimalMotion:
    return fa.optimal_motion(
        arm(), start, end, "energy", duration=1.0, limits=limits(), intervals=20
    )


@cache
def pressed() -> Any:
    return fa.pressed_motion(arm(), motion(), 0.1, [1.0, 0.3], interval=0.5)


@cache
def result() -> Any:
    return fa.simulate(arm(), 0.01, rate=500.0)


@cache
def proposal() -> fa.ControllerDesign:
    return fa.design(spinning(), "hold", computing="low", duration=0.1, progress=False)


@cache
def separation() -> fa.Separation:
    return fa.linearize_along(arm(), motion(), rate=3.0)


_PLACE = tempfile.TemporaryDirectory(prefix="flexarm-calls-")


@cache
def folder() -> Path:
    """Return a folder with an arm, a scenario, a study and a result."""
    place = Path(_PLACE.name)
    fa.save_arm(arm(), place / "arm.yaml")
    fa.write_result(result(), place / "result.nc")
    fa.write_result(result(), place / "result.csv")
    run = "flexarm: 1\narm: arm.yaml\nrun: {duration: 0.01, rate: 500}\n"
    (place / "scenario.yaml").write_text(run)
    study = (
        "flexarm: 1\narm: arm.yaml\n"
        "motions: {move: {kind: joint, start: [0.1, 0.3], end: [0.5, 0.8], duration: 1}}\n"
        "drives: {pd: {kind: joint_pd, proportional: 8, derivative: 0.8, sample_time: 0.005}}\n"
        "run: {duration: 0.01, rate: 500}\n"
    )
    (place / "study.yaml").write_text(study)
    return place


def controller() -> fa.JointPD:
    return fa.JointPD([8.0, 3.0], [0.8, 0.3], sample_time=0.005)


def contact() -> fa.Contact:
    return fa.Contact(fa.Wall((0.0, -3.0), (0.0, 1.0)), 1e3)


@cache
def measurement() -> fa.Measurement:
    read = {"joint_angle": np.array(start), "joint_rate": np.zeros(2), "strain": np.zeros(1)}
    return fa.Measurement(**read, contact_force=np.zeros((1, 2)), contact_gap=np.ones(1))


LINK = {"length": 0.8, "flexural_rigidity": 30.0, "mass_per_length": 0.5, "elements": 1}

#: Records, as in files.
RECORDS: dict[str, dict[str, Any]] = {
    "Box": {"width": 0.04, "height": 0.02, "thickness": 0.002},
    "Circle": {"diameter": 0.02},
    "Filter": {"kind": "low_pass", "cutoff": 20.0},
    "FreeParameter": {"path": "payload.mass"},
    "Friction": {"coulomb": 0.1},
    "Winding": {"torque_constant": 0.05, "resistance": 2.0},
    "Gauge": {"station": 0.1, "distance": 0.005},
    "Joint": {"hub_inertia": 0.05},
    "Base": {"mass": 2.0, "inertia": 0.1, "free": ["x", "angle"], "stiffness": [1e3, 0.0, 10.0]},
    "Closure": {"kind": "weld", "link": 1, "to_link": 2, "to_station": 0.1, "angle": 0.2},
    "JointLimits": {"lower": -1.0, "upper": 1.0, "stiffness": 100.0},
    "Link": LINK,
    "Material": {"density": 2700.0, "youngs_modulus": 7e10},
    "ModalDamping": {"ratio": 0.01},
    "Payload": {"mass": 0.1},
    "RayleighDamping": {"mass_coefficient": 0.1},
    "Rectangle": {"width": 0.04, "height": 0.002},
    "SectionTable": {
        "x": [0.0, 0.8],
        "flexural_rigidity": [30.0, 20.0],
        "mass_per_length": [0.5, 0.4],
    },
    "Tube": {"outer_diameter": 0.03, "thickness": 0.002},
}

#: Constructors of controllers, and of the filter.
CONTROLLERS: dict[str, dict[str, Any]] = {
    **{REGISTRY[name].__name__: complete(name) for name in EXAMPLES},
    **FILTERS,
}

_MOVE = {"arm": arm, "motion": motion}
#: Other public functions and classes.
FUNCTIONS: dict[str, dict[str, Any]] = {
    "GeneralizedAlpha": {"step": 1e-3, "spectral_radius": 0.5},
    "design": {
        "arm": spinning,
        "task": "hold",
        "computing": "low",
        "duration": 0.1,
        "hardware": fa.Hardware(motors=fa.Motors(delay=1e-3)),
    },
    "loop_margins": {"controller": controller, "plants": arm, "postures": [start]},
    "loop_models": {"controller": controller, "plant": arm, "posture": start},
    "robustness": {"controller": controller, "plants": arm, "posture": start},
    "Arm": {
        "links": [LINK],
        "joints": [{"hub_inertia": 0.1}],
        "payload": {"mass": 0.1},
        "gravity": [0.0, -9.81],
        "theory": "linear",
    },
    "Change": {"path": "payload.mass", "at": 0.1, "to": 0.3, "velocity": (0.1, 0.0)},
    "Contact": {"surface": lambda: fa.Wall((0.0, -3.0), (0.0, 1.0)), "stiffness": 1e3},
    "Event": {"function": lambda: lambda t, q, qd: 1.0},
    "Hardware": {"instruments": lambda: [fa.Instrument("joint_angle")], "motors": fa.Motors},
    "Instrument": {"signal": "joint_angle"},
    "InstrumentFault": {"kind": "bias", "size": 0.01},
    "Load": {"link": 1, "force": [1.0, 0.0]},
    "Measurement": {},
    "MotionLimits": {"torque": 2.0},
    "Motors": {"torque_limit": 2.0},
    "ControllerRequirements": {},
    "Plant": {"arm": arm, "sample_time": 0.005},
    "PrescribedAngle": dict.fromkeys(("angle", "rate", "acceleration"), lambda: lambda t: 0.0),
    "Reduction": {"kind": "peak", "channel": "tip"},
    "RunSettings": {"rtol": 1e-8},
    "RoundWall": {"center": [0.0, 0.0], "radius": 3.0},
    "InertialSensor": {"link": 1, "station": 0.2},
    "Sensor": {"kind": "acceleration", "link": 1},
    "SurfaceTable": {"x": [-3.0, 0.0, 3.0], "y": [-3.0, -3.1, -3.0]},
    "Wall": {"point": [0.0, -3.0], "normal": [0.0, 1.0]},
    "assembled": {"arm": linkage, "q": [0.1] * 6, "qd": [0.2] * 6, "held": [1]},
    "animate": {"results": result, "fps": 2.0, "width": 320},
    "campbell": {"arm": spinning, "spin": [0.0, 1.0], "count": 1},
    "citation": {"result": result},
    "compare": {
        "arm": arm,
        "controllers": lambda: {"pd": controller()},
        "duration": 0.01,
        "references": lambda: {"line": motion()},
    },
    "converged": {"arm": arm, "duration": 0.01, "rate": 500.0},
    "contact_event": {"arm": arm, "contact": contact},
    "equilibrium": {"arm": arm},
    "fatigue_damage": {"stress": lambda: fa.stress(loaded()), "detail_category": 71e6},
    "flexible_torque": {"arm": arm, "motion": motion, "duration": 0.01, "rtol": 1e-4},
    "iterative_learning": {
        "arm": arm,
        "reference": lambda: fa.joint_motion(arm(), start, [0.101, 0.301], 0.03),
        "controller": lambda: controller(),
        "duration": 0.04,
        "trials": 1,
    },
    "joint_event": {"arm": arm, "joint": 1, "angle": 0.2},
    "linearize": {"arm": arm},
    "linearize_along": {**_MOVE, "rate": 3.0},
    "load_arm": {"path": lambda: folder() / "arm.yaml"},
    "load_scenario": {"path": lambda: folder() / "scenario.yaml"},
    "modes": {"arm": arm},
    "optimal_motion": {"arm": arm, "start": start, "end": end, "limits": limits, "intervals": 12},
    "pressed_motion": {**_MOVE, "force": 0.1, "normal": [1.0, 0.3], "interval": 0.5},
    "quasi_static_reference": _MOVE,
    **IDENTIFICATION,
    "read_record": {"path": lambda: folder() / "result.csv"},
    "read_result": {"path": lambda: folder() / "result.nc"},
    "realtime": {
        "plant": lambda: fa.Plant(arm(), 0.005),
        "controller": controller,
        "duration": 0.02,
        "reference": motion,
        "clock": False,
    },
    "report": {"result": result},
    "rigid_torque": {**_MOVE, "actuated": [1, 2]},
    "run_scenario": {"scenario": lambda: folder() / "scenario.yaml"},
    "run_study": {"study": lambda: folder() / "study.yaml"},
    "save_arm": {"arm": arm, "path": lambda: folder() / "saved.yaml"},
    "save_linear": {"model": lambda: fa.linearize(arm()), "path": lambda: folder() / "m.json"},
    "shaped": {"motion": motion, "arm": arm},
    "shaper_sensitivity": {"frequency_ratio": [0.9, 1.0]},
    "simulate": {"arm": arm, "duration": 0.01, "rate": 500.0},
    "simulate_batch": {"arm": arm, "duration": 0.01, "rate": 500.0, "initial": [Q, Q]},
    "goal_gradient": {
        "arm": arm,
        "duration": 0.01,
        "weights": {"tip": np.ones((6, 2))},
        "torque": np.zeros((5, 2)),
        "rate": 500.0,
    },
    "sensitivities": {"arm": arm, "duration": 0.01, "parameters": ["payload.mass"], "rate": 500.0},
    "simulate_separated": {**_MOVE, "duration": 0.05, "rate": 100.0},
    "smoothed": {"motion": motion, "duration": 0.1},
    "step_jacobian": {"arm": arm, **STATE, "torque": [0.1, 0.2], "step": 1e-4},
    "stress": {"run": loaded, "fibres": [-1.0, 1.0], "stations": 5},
    "tip_event": {"arm": arm, "point": [1.0, 0.0], "normal": [1.0, 0.0]},
    "tip_inversion": {
        "arm": arm,
        "motion": lambda: fa.joint_motion(arm(), start, end, 1.0, start_time=0.5),
    },
    "track_modes": {"arm": arm, "along": [start, end], "count": 2, "samples": 2},
    "varied": {"arm": arm},
    "write_result": {"result": result, "path": lambda: folder() / "written.nc"},
}

#: Methods of the objects that these return: the object, then arguments by method.
_UPDATE = {
    "requirements": {"arm": arm, "reference": motion},
    "needs": {"arm": arm, "reference": motion},
    "report": {},
    "reset": {},
    "update": {"t": 0.0, "measurement": measurement, "reference": motion},
}
_TIMES = {key: {"t": 0.2} for key in ("joint_angle", "joint_rate", "joint_acceleration")}
_MOTION = {**_TIMES, "state": {"t": 0.2}, "tip": {"t": 0.2}, "sampled": {"rate": 100.0}}
METHODS: dict[str, tuple[Callable[[], Any], dict[str, dict[str, Any]]]] = {
    "Arm": (wound, ARM),
    **RESULT,
    **FILTER_METHODS,
    "LinearModel": (
        lambda: fa.linearize(arm()),
        {
            "arrays": {},
            "frequency_response": {"omega": [1.0, 10.0]},
            "to_control": {},
            "zeros": {"input": "torque[1]", "output": "joint_angle[1]"},
        },
    ),
    "Measurement": (measurement, {"get": {"name": "strain"}}),
    "Modes": (lambda: fa.modes(arm()), {"curves": {"stations": 3}, "displacements": {}}),
    "InstrumentFault": (lambda: fa.InstrumentFault("bias", size=0.01), {"acts": {"t": 0.1}}),
    "Link": (lambda: fa.Link(**LINK), {"beam": {}}),
    "Load": (lambda: fa.Load(1, [1.0, 0.0]), {"scaled": {"factor": 2.0}}),
    "ModalDamping": (lambda: fa.ModalDamping(ratio=[0.01, 0.02]), {"ratios": {"modes": 3}}),
    "Motors": (
        fa.Motors,
        {"allowed": {"torque": [0.0, 0.0], "rate": [0.0, 0.0]}},
    ),
    "Plant": (
        lambda: fa.Plant(arm(), 0.005),
        {"reset": {"initial": Q}, "step": {"torque": [0.1, 0.2]}},
    ),
    "PrescribedAngle": (
        lambda: fa.PrescribedAngle,
        {"hold": {"angle": 0.1}, "table": {"times": [0.0, 1.0], "angles": [0.0, 0.1]}},
    ),
    "OptimalMotion": (
        optimal,
        {
            **_TIMES,
            "at": {"times": [0.2]},
            "sampled": {"rate": 100.0},
            "state": {"t": 0.2},
            "tip": {"t": 0.2},
        },
    ),
    "PressedMotion": (
        pressed,
        {
            **_TIMES,
            **{
                key: {"t": 0.2}
                for key in (
                    *("contact_force", "curvature", "holding_torque"),
                    *("normal", "pressing_torque", "tip"),
                )
            },
        },
    ),
    "QuasiStaticReference": (
        lambda: fa.quasi_static_reference(arm(), motion()),
        {
            **_TIMES,
            "state": {"t": 0.2},
            "tip": {"t": 0.2},
            "at": {"times": [0.2]},
            "coordinates": {"times": [0.2]},
            "sampled": {"rate": 100.0},
        },
    ),
    "ControllerDesign": (proposal, {"save": {"path": lambda: folder() / "design.yaml"}}),
    "Sensor": (lambda: fa.Sensor("acceleration", 1), {"labels": {}}),
    "SampledModel": (
        lambda: fa.loop_models(controller(), arm()).plant,
        {"frequency_response": {"omega": [1.0, 10.0]}, "to_control": {}},
    ),
    "Separation": (
        separation,
        {
            "at": {"t": [0.2]},
            "bent": {
                "K": lambda: separation().deviation.K,
                "r": lambda: separation().deviation.r,
            },
            "quasi_static": {},
            "save": {"path": lambda: folder() / "separation.npz"},
            "to_dataset": {},
        },
    ),
    **{REGISTRY[name].__name__: (make, _UPDATE) for name, make in EXAMPLES.items()},
    # Objects that functions return and whose classes are not public names.
    "joint_motion()": (motion, _MOTION),
    "line_motion()": (lambda: fa.line_motion(arm(), [1.0, 0.2], [1.0, 0.4], 1.0), _MOTION),
    "sampled()": (lambda: motion().sampled(100.0), _MOTION),
    "shaped()": (lambda: fa.shaped(motion(), arm()), _MOTION),
    "smoothed()": (lambda: fa.smoothed(motion(), 0.1), _MOTION),
    "animate()": (
        lambda: fa.animate(result(), fps=2.0, width=320),
        {"save": {"path": lambda: folder() / "arm.gif"}},
    ),
    "rigid_torque()": (
        lambda: fa.rigid_torque(arm(), motion()),
        {"__call__": {"t": 0.2}, "base_position": {"t": 0.2}},
    ),
    "quintic()": (quintic, {"__call__": {"u": 0.2}}),
}
for _name in ("LQG", "MPC", "NonlinearMPC", "Composite"):
    METHODS[_name] = (
        METHODS[_name][0],
        {
            **_UPDATE,
            "at_rest": {},
            "loop_poles": {},
            # A margin of zero is reached by the first design.
            "for_margin": {
                "arm": arm,
                "posture": start,
                "plants": arm,
                "disk_margin": 1e-6,
                **({"torque_limit": 10.0, "horizon": 3} if "MPC" in _name else {}),
            },
        },
    )

METHODS["PrescribedPerformance"] = (
    METHODS["PrescribedPerformance"][0],
    {**_UPDATE, "angle_bound": {"t": [0.0, 1.0]}},
)
_STRAINS = {**_UPDATE, "strain_correction": {"t": 0.2, "reference": motion}}
for _law in ("PositivePositionFeedback", "WaveBasedControl", "IntegralResonantControl"):
    METHODS[_law] = METHODS[_law][0], _STRAINS
METHODS["OutputRedefinition"] = (
    METHODS["OutputRedefinition"][0],
    {**_STRAINS, "damping_weights": {}},
)
METHODS["NonlinearMPC"][1].update(feedback=_UPDATE["update"], prepare={})
_RATES = {"harmonic_rates": {"plant": arm, "posture": start}}
METHODS["RepetitiveControl"] = METHODS["RepetitiveControl"][0], {**_UPDATE, **_RATES}

#: Results that only flexarm creates, and the abstract controller, whose methods all others have.
MADE_BY_FLEXARM = {
    "ConvergedRun",
    "ControllerDesign",
    "Equilibrium",
    "Controller",
    "FlexibleTorque",
    "FrequencyResponse",
    "Identifiability",
    "Identification",
    "LearnedMotion",
    "LinearModel",
    "MeasuredModes",
    "ModeTracks",
    "Modes",
    "OptimalExcitation",
    "OptimalMotion",
    "PressedMotion",
    "QuasiStaticReference",
    "SampledModel",
    "Separation",
    "StepJacobian",
    "TipInversion",
}
