"""Built-in controllers, one per file, and the registry of their names."""

from __future__ import annotations

from flexarm.control.analysis.margins import loop_margins
from flexarm.control.contract.base import Controller, Measurement, Reference
from flexarm.control.contract.requirements import ControllerRequirements
from flexarm.control.design.input_shaping import shaped
from flexarm.control.filters.estimator_controller import EstimatorController
from flexarm.control.filters.extended_kalman import ExtendedKalmanFilter
from flexarm.control.filters.moving_horizon import MovingHorizonEstimator
from flexarm.control.filters.unscented_kalman import UnscentedKalmanFilter
from flexarm.control.laws.force.adaptive_force import AdaptiveForce
from flexarm.control.laws.force.admittance import Admittance
from flexarm.control.laws.force.hybrid_force import HybridForce
from flexarm.control.laws.force.impedance import Impedance
from flexarm.control.laws.force.neural_force import NeuralForce
from flexarm.control.laws.joint.computed_torque import ComputedTorque
from flexarm.control.laws.joint.joint_pd import JointPD
from flexarm.control.laws.joint.joint_pid import JointPID
from flexarm.control.laws.joint.loop_shaping import LoopShaping
from flexarm.control.laws.joint.mu_synthesis import MuSynthesis
from flexarm.control.laws.joint.prescribed_performance import PrescribedPerformance
from flexarm.control.laws.joint.strain_feedback import StrainFeedback
from flexarm.control.laws.linear.composite import Composite
from flexarm.control.laws.linear.lqg import LQG
from flexarm.control.laws.linear.mpc import MPC
from flexarm.control.laws.linear.nonlinear_mpc import NonlinearMPC
from flexarm.control.laws.uncertain.adaptive import Adaptive
from flexarm.control.laws.uncertain.disturbance_observer import DisturbanceObserver
from flexarm.control.laws.uncertain.rbf_adaptive import RBFAdaptive
from flexarm.control.laws.uncertain.repetitive import RepetitiveControl
from flexarm.control.laws.uncertain.sliding_mode import SlidingMode
from flexarm.control.laws.vibration.integral_resonant import IntegralResonantControl
from flexarm.control.laws.vibration.output_redefinition import OutputRedefinition
from flexarm.control.laws.vibration.positive_position import PositivePositionFeedback
from flexarm.control.laws.vibration.wave_based import WaveBasedControl
from flexarm.model import Hardware, Instrument, Motors

#: Controllers by name. The drives of files have the same names as kinds.
CONTROLLERS: dict[str, type[Controller]] = {
    controller.name: controller
    for controller in (
        Adaptive,
        AdaptiveForce,
        Admittance,
        Composite,
        ComputedTorque,
        DisturbanceObserver,
        EstimatorController,
        HybridForce,
        Impedance,
        IntegralResonantControl,
        JointPD,
        JointPID,
        LQG,
        LoopShaping,
        MPC,
        MuSynthesis,
        OutputRedefinition,
        NonlinearMPC,
        NeuralForce,
        PositivePositionFeedback,
        PrescribedPerformance,
        RBFAdaptive,
        RepetitiveControl,
        SlidingMode,
        StrainFeedback,
        WaveBasedControl,
    )
}

__all__ = [
    "CONTROLLERS",
    "LQG",
    "MPC",
    "Adaptive",
    "AdaptiveForce",
    "Admittance",
    "Composite",
    "ComputedTorque",
    "Controller",
    "ControllerRequirements",
    "DisturbanceObserver",
    "EstimatorController",
    "ExtendedKalmanFilter",
    "Hardware",
    "HybridForce",
    "Impedance",
    "Instrument",
    "IntegralResonantControl",
    "JointPD",
    "JointPID",
    "LoopShaping",
    "Measurement",
    "Motors",
    "MovingHorizonEstimator",
    "MuSynthesis",
    "NeuralForce",
    "NonlinearMPC",
    "OutputRedefinition",
    "PositivePositionFeedback",
    "PrescribedPerformance",
    "RBFAdaptive",
    "Reference",
    "RepetitiveControl",
    "SlidingMode",
    "StrainFeedback",
    "UnscentedKalmanFilter",
    "WaveBasedControl",
    "loop_margins",
    "shaped",
]
