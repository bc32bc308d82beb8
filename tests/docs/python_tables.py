"""Tables of the Python interface, made from signatures and docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any

import flexarm as fa
from flexarm.control.laws import CONTROLLERS
from flexarm.model.drives import CONTROLLED

#: Parts of the page and their public names, in the order of the page.
GROUPS: dict[str, tuple[str, ...]] = {
    "describing": (
        *("Arm", "load_arm", "save_arm", "varied"),
        *("Link", "Material", "Rectangle", "Circle", "Tube", "Box", "SectionTable"),
        *("ModalDamping", "RayleighDamping", "Gauge"),
        *("Joint", "Friction", "JointLimits", "Winding", "Payload", "Base", "Closure"),
    ),
    "loads": ("Load", "Change", "Contact", "Wall", "RoundWall", "SurfaceTable"),
    "motions": (
        *("line_motion", "via_point_motion", "spline_motion", "circle_motion", "joint_motion"),
        *("inverse_kinematics", "rigid_torque", "shaped", "smoothed"),
        "shaper_sensitivity",
        *("quasi_static_reference", "QuasiStaticReference", "pressed_motion", "PressedMotion"),
        *("tip_inversion", "TipInversion", "flexible_torque", "FlexibleTorque"),
        *("optimal_motion", "MotionLimits", "OptimalMotion"),
    ),
    "simulation": (
        *("simulate", "simulate_batch", "Reduction", "RunSettings"),
        *("converged", "ConvergedRun", "sensitivities", "goal_gradient"),
        *("GeneralizedAlpha", "Plant", "realtime", "PrescribedAngle"),
        *("Event", "joint_event", "contact_event", "tip_event"),
        *("load_scenario", "run_scenario", "run_study"),
        *("Study", "read_study", "study_statistics", "sensitivity_indices"),
        *("stress", "fatigue_damage"),
        *("write_result", "read_result", "citation"),
    ),
    "identification": (
        *("read_record", "MeasuredRecord", "Filter", "InertialSensor"),
        *("identify", "commission", "FreeParameter", "Identification"),
        *("identifiability", "Identifiability", "optimal_excitation", "OptimalExcitation"),
        *("multisine", "Multisine"),
        *("frequency_response", "FrequencyResponse", "measured_modes", "MeasuredModes"),
    ),
    "controllers": (
        *("Controller", "ControllerRequirements", "Measurement"),
        *("Hardware", "Instrument", "Motors"),
        *(CONTROLLERS[kind].__name__ for kind in CONTROLLED),
        *("ExtendedKalmanFilter", "UnscentedKalmanFilter", "compare"),
        "loop_margins",
        *("iterative_learning", "LearnedMotion"),
        *("loop_models", "SampledModel", "robustness"),
        *("design", "ControllerDesign", "InstrumentFault", "MovingHorizonEstimator"),
    ),
    "linear": (
        *("equilibrium", "Equilibrium", "assembled", "modes", "Modes", "track_modes", "campbell"),
        *("ModeTracks", "linearize", "LinearModel", "Sensor", "save_linear"),
    ),
    "plots": (*(f"plot.{name}" for name in fa.plot.__all__), "animate", "report"),
    "separation": (
        *("linearize_along", "Separation", "simulate_separated"),
        *("step_jacobian", "StepJacobian"),
    ),
    "symbolic": (
        *("to_casadi", "to_jax", "export_c", "export_fmu", "export_mat"),
        *("export_mjcf", "export_urdf", "export_exudyn"),
    ),
    "errors": (
        *("FlexarmError", "InputError", "ModelError", "EquilibriumError", "InversionError"),
        "OptimizationError",
        "ArgumentError",
        *(
            "SimulationError",
            "FlexarmWarning",
            "AccuracyWarning",
            "UnstableLoopWarning",
            "ConvergenceWarning",
        ),
        *("InconsistentEstimateWarning", "LargeDeflectionWarning", "IdentifiabilityWarning"),
        *("ImplausibleValueWarning", "LimitWarning"),
    ),
}
_HEAD = ["| name | meaning |", "| --- | --- |"]


def python_tables() -> dict[str, str]:
    """Return a Markdown table for every part of the page."""
    tables = {
        part: "\n".join(_HEAD + [_row(name) for name in names]) for part, names in GROUPS.items()
    }
    members = [_member_row(name) for name in dir(fa.Arm) if not name.startswith("_")]
    return tables | {"members": "\n".join(_HEAD + members)}


def public(name: str) -> Any:
    """Return the object of a public name, such as ``plot.modes``."""
    value: Any = fa
    for part in name.split("."):
        value = getattr(value, part)
    return value


def called(function: Callable[..., Any], name: str) -> str:
    """Return a call with names, order and defaults of all parameters."""
    parameters = inspect.signature(function).parameters.values()
    shown = ", ".join(str(p.replace(annotation=p.empty)) for p in parameters if p.name != "self")
    return f"{name}({shown})".replace("'", '"').replace("|", r"\|")


def _row(name: str) -> str:
    value = public(name)
    shown = f"fa.{name}" if name.startswith("plot.") else name
    documented = inspect.getdoc(value) or ""
    # Users create objects of the classes whose docstrings list arguments.
    if inspect.isfunction(value) or re.search("^Args:", documented, flags=re.MULTILINE):
        shown = called(value, shown)
    return f"| `{shown}` | {_summary(documented)} |"


def _member_row(name: str) -> str:
    member = inspect.getattr_static(fa.Arm, name)
    documented = inspect.getdoc(getattr(fa.Arm, name, None)) or ""
    if callable(member):
        return f"| `arm.{called(member, name)}` | {_summary(documented)} |"
    if not isinstance(member, property) and not hasattr(member, "func"):
        documented = ""
    return f"| `arm.{name}` | {_summary(documented)} |"


def _summary(documented: str) -> str:
    """Return the first sentence of a docstring as Markdown."""
    paragraph = " ".join(documented.partition("\n\n")[0].split())
    sentence = re.split(r"(?<=[.])\s+(?=[A-Z`])", paragraph)[0]
    return re.sub(r"``(.+?)``", r"`\1`", sentence).replace("|", r"\|")
