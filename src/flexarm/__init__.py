"""Planar serial manipulators with flexible links: model, simulate, control.

Public names are loaded when they are first used, so that ``import flexarm`` stays fast.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexarm import plot as plot
    from flexarm.arm import Arm as Arm
    from flexarm.arm import load_arm as load_arm
    from flexarm.arm import save_arm as save_arm
    from flexarm.arm import varied as varied
    from flexarm.contacts import Contact as Contact
    from flexarm.control import LQG as LQG
    from flexarm.control import MPC as MPC
    from flexarm.control import Adaptive as Adaptive
    from flexarm.control import Admittance as Admittance
    from flexarm.control import Composite as Composite
    from flexarm.control import ComputedTorque as ComputedTorque
    from flexarm.control import Controller as Controller
    from flexarm.control import DisturbanceObserver as DisturbanceObserver
    from flexarm.control import EstimatorController as EstimatorController
    from flexarm.control import ExtendedKalmanFilter as ExtendedKalmanFilter
    from flexarm.control import Hardware as Hardware
    from flexarm.control import HybridForce as HybridForce
    from flexarm.control import Impedance as Impedance
    from flexarm.control import Instrument as Instrument
    from flexarm.control import JointPD as JointPD
    from flexarm.control import JointPID as JointPID
    from flexarm.control import Measurement as Measurement
    from flexarm.control import Motors as Motors
    from flexarm.control import Needs as Needs
    from flexarm.control import RBFAdaptive as RBFAdaptive
    from flexarm.control import SlidingMode as SlidingMode
    from flexarm.control import StrainFeedback as StrainFeedback
    from flexarm.control import loop_margins as loop_margins
    from flexarm.control import shaped as shaped
    from flexarm.errors import AccuracyWarning as AccuracyWarning
    from flexarm.errors import FlexarmError as FlexarmError
    from flexarm.errors import FlexarmWarning as FlexarmWarning
    from flexarm.errors import InconsistentEstimateWarning as InconsistentEstimateWarning
    from flexarm.errors import InputError as InputError
    from flexarm.errors import LargeDeflectionWarning as LargeDeflectionWarning
    from flexarm.errors import ModelError as ModelError
    from flexarm.errors import SimulationError as SimulationError
    from flexarm.errors import UnstableLoopWarning as UnstableLoopWarning
    from flexarm.integrate import GeneralizedAlpha as GeneralizedAlpha
    from flexarm.linear import Equilibrium as Equilibrium
    from flexarm.linear import EquilibriumError as EquilibriumError
    from flexarm.linear import LinearModel as LinearModel
    from flexarm.linear import Modes as Modes
    from flexarm.linear import ModeTracks as ModeTracks
    from flexarm.linear import Sensor as Sensor
    from flexarm.linear import campbell as campbell
    from flexarm.linear import equilibrium as equilibrium
    from flexarm.linear import linearize as linearize
    from flexarm.linear import modes as modes
    from flexarm.linear import track_modes as track_modes
    from flexarm.linear.along import Separation as Separation
    from flexarm.linear.along import linearize_along as linearize_along
    from flexarm.linear.pressed import PressedMotion as PressedMotion
    from flexarm.linear.pressed import pressed_motion as pressed_motion
    from flexarm.linear.quasi_static import QuasiStaticReference as QuasiStaticReference
    from flexarm.linear.quasi_static import quasi_static_reference as quasi_static_reference
    from flexarm.linear.step_jacobian import StepJacobian as StepJacobian
    from flexarm.linear.step_jacobian import step_jacobian as step_jacobian
    from flexarm.loads import Load as Load
    from flexarm.model import Box as Box
    from flexarm.model import Circle as Circle
    from flexarm.model import Friction as Friction
    from flexarm.model import Gauge as Gauge
    from flexarm.model import Joint as Joint
    from flexarm.model import JointLimits as JointLimits
    from flexarm.model import Link as Link
    from flexarm.model import Material as Material
    from flexarm.model import ModalDamping as ModalDamping
    from flexarm.model import Payload as Payload
    from flexarm.model import RayleighDamping as RayleighDamping
    from flexarm.model import Rectangle as Rectangle
    from flexarm.model import SectionTable as SectionTable
    from flexarm.model import Tube as Tube
    from flexarm.model import load_scenario as load_scenario
    from flexarm.motion import joint_motion as joint_motion
    from flexarm.motion import line_motion as line_motion
    from flexarm.motion import rigid_torque as rigid_torque
    from flexarm.motion import smoothed as smoothed
    from flexarm.output import read_result as read_result
    from flexarm.output import save_linear as save_linear
    from flexarm.output import write_result as write_result
    from flexarm.plot.animation import animate as animate
    from flexarm.references import citation as citation
    from flexarm.simulate import PrescribedAngle as PrescribedAngle
    from flexarm.simulate import run_scenario as run_scenario
    from flexarm.simulate import simulate as simulate
    from flexarm.simulate.compare import compare as compare
    from flexarm.simulate.events import Event as Event
    from flexarm.simulate.events import contact_event as contact_event
    from flexarm.simulate.events import joint_event as joint_event
    from flexarm.simulate.events import tip_event as tip_event
    from flexarm.simulate.flexible_torque import FlexibleTorque as FlexibleTorque
    from flexarm.simulate.flexible_torque import flexible_torque as flexible_torque
    from flexarm.simulate.plant import Plant as Plant
    from flexarm.simulate.separated import simulate_separated as simulate_separated
    from flexarm.simulate.study import run_study as run_study
    from flexarm.simulate.tip_inversion import InversionError as InversionError
    from flexarm.simulate.tip_inversion import TipInversion as TipInversion
    from flexarm.simulate.tip_inversion import tip_inversion as tip_inversion
    from flexarm.surfaces import RoundWall as RoundWall
    from flexarm.surfaces import SurfaceTable as SurfaceTable
    from flexarm.surfaces import Wall as Wall

#: Every public name, and the module that holds it.
_HOME = {
    "AccuracyWarning": "errors",
    "Adaptive": "control",
    "Admittance": "control",
    "Arm": "arm",
    "Box": "model",
    "Circle": "model",
    "Contact": "contacts",
    "Composite": "control",
    "ComputedTorque": "control",
    "Controller": "control",
    "DisturbanceObserver": "control",
    "Equilibrium": "linear",
    "EquilibriumError": "linear",
    "Event": "simulate.events",
    "EstimatorController": "control",
    "ExtendedKalmanFilter": "control",
    "FlexarmError": "errors",
    "FlexarmWarning": "errors",
    "FlexibleTorque": "simulate.flexible_torque",
    "Friction": "model",
    "GeneralizedAlpha": "integrate",
    "Gauge": "model",
    "Hardware": "control",
    "HybridForce": "control",
    "Impedance": "control",
    "InputError": "errors",
    "Instrument": "control",
    "InversionError": "simulate.tip_inversion",
    "Joint": "model",
    "JointLimits": "model",
    "JointPD": "control",
    "LQG": "control",
    "MPC": "control",
    "JointPID": "control",
    "InconsistentEstimateWarning": "errors",
    "LargeDeflectionWarning": "errors",
    "LinearModel": "linear",
    "Link": "model",
    "Load": "loads",
    "Material": "model",
    "Measurement": "control",
    "ModalDamping": "model",
    "ModelError": "errors",
    "Motors": "control",
    "Needs": "control",
    "ModeTracks": "linear",
    "Modes": "linear",
    "Payload": "model",
    "Plant": "simulate.plant",
    "PrescribedAngle": "simulate",
    "QuasiStaticReference": "linear.quasi_static",
    "RBFAdaptive": "control",
    "PressedMotion": "linear.pressed",
    "RayleighDamping": "model",
    "Rectangle": "model",
    "RoundWall": "surfaces",
    "SectionTable": "model",
    "Sensor": "linear",
    "Separation": "linear.along",
    "SimulationError": "errors",
    "SlidingMode": "control",
    "StepJacobian": "linear.step_jacobian",
    "SurfaceTable": "surfaces",
    "StrainFeedback": "control",
    "TipInversion": "simulate.tip_inversion",
    "Tube": "model",
    "UnstableLoopWarning": "errors",
    "Wall": "surfaces",
    "animate": "plot.animation",
    "campbell": "linear",
    "citation": "references",
    "compare": "simulate.compare",
    "contact_event": "simulate.events",
    "equilibrium": "linear",
    "flexible_torque": "simulate.flexible_torque",
    "joint_event": "simulate.events",
    "joint_motion": "motion",
    "line_motion": "motion",
    "linearize": "linear",
    "linearize_along": "linear.along",
    "load_arm": "arm",
    "load_scenario": "model",
    "loop_margins": "control",
    "modes": "linear",
    "quasi_static_reference": "linear.quasi_static",
    "pressed_motion": "linear.pressed",
    "read_result": "output",
    "rigid_torque": "motion",
    "run_scenario": "simulate",
    "run_study": "simulate.study",
    "save_arm": "arm",
    "save_linear": "output",
    "shaped": "control",
    "simulate": "simulate",
    "smoothed": "motion",
    "write_result": "output",
    "track_modes": "linear",
    "simulate_separated": "simulate.separated",
    "step_jacobian": "linear.step_jacobian",
    "tip_event": "simulate.events",
    "tip_inversion": "simulate.tip_inversion",
    "varied": "arm",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("flexarm")
    if name == "plot":
        return import_module("flexarm.plot")
    if name not in _HOME:
        raise AttributeError(f"module 'flexarm' has no attribute {name!r}")
    value = getattr(import_module(f"flexarm.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__", "plot"]


class _Package(ModuleType):
    """Keep ``flexarm.simulate`` the function.

    Importing the layer of that name would put the module in its place: Python sets a submodule as
    an attribute of its package. ``from flexarm.simulate import ...`` finds the module all the same.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
