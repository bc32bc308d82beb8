"""Controllers: one a file, and the registry of their names."""

from __future__ import annotations

from flexarm.control.adaptive import Adaptive
from flexarm.control.admittance import Admittance
from flexarm.control.base import Controller, Measurement, Reference
from flexarm.control.composite import Composite
from flexarm.control.computed_torque import ComputedTorque
from flexarm.control.disturbance_observer import DisturbanceObserver
from flexarm.control.estimator import EstimatorController
from flexarm.control.extended_kalman import ExtendedKalmanFilter
from flexarm.control.hardware import Hardware, Motors
from flexarm.control.hybrid_force import HybridForce
from flexarm.control.impedance import Impedance
from flexarm.control.input_shaping import shaped
from flexarm.control.instruments import Instrument
from flexarm.control.joint_pd import JointPD
from flexarm.control.joint_pid import JointPID
from flexarm.control.lqg import LQG
from flexarm.control.margins import loop_margins
from flexarm.control.mpc import MPC
from flexarm.control.needs import Needs
from flexarm.control.rbf_adaptive import RBFAdaptive
from flexarm.control.sliding_mode import SlidingMode
from flexarm.control.strain_feedback import StrainFeedback

#: Every controller by its name, which is that of its record in files.
CONTROLLERS: dict[str, type[Controller]] = {
    Adaptive.name: Adaptive,
    Admittance.name: Admittance,
    Composite.name: Composite,
    ComputedTorque.name: ComputedTorque,
    DisturbanceObserver.name: DisturbanceObserver,
    EstimatorController.name: EstimatorController,
    HybridForce.name: HybridForce,
    Impedance.name: Impedance,
    JointPD.name: JointPD,
    JointPID.name: JointPID,
    LQG.name: LQG,
    MPC.name: MPC,
    RBFAdaptive.name: RBFAdaptive,
    SlidingMode.name: SlidingMode,
    StrainFeedback.name: StrainFeedback,
}

__all__ = [
    "CONTROLLERS",
    "LQG",
    "MPC",
    "Adaptive",
    "Admittance",
    "Composite",
    "ComputedTorque",
    "Controller",
    "DisturbanceObserver",
    "EstimatorController",
    "ExtendedKalmanFilter",
    "Hardware",
    "HybridForce",
    "Impedance",
    "Instrument",
    "JointPD",
    "JointPID",
    "Measurement",
    "Motors",
    "Needs",
    "RBFAdaptive",
    "Reference",
    "SlidingMode",
    "StrainFeedback",
    "loop_margins",
    "shaped",
]
