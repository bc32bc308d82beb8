"""Built-in controllers, one per file, and the registry of their names."""

from __future__ import annotations

from flexarm.control.base import Controller, Measurement, Reference
from flexarm.control.requirements import ControllerRequirements
from flexarm.control_design.input_shaping import shaped
from flexarm.controllers.force.adaptive_force import AdaptiveForce
from flexarm.controllers.force.admittance import Admittance
from flexarm.controllers.force.hybrid_force import HybridForce
from flexarm.controllers.force.impedance import Impedance
from flexarm.controllers.force.neural_force import NeuralForce
from flexarm.controllers.joint.computed_torque import ComputedTorque
from flexarm.controllers.joint.joint_pd import JointPD
from flexarm.controllers.joint.joint_pid import JointPID
from flexarm.controllers.joint.loop_shaping import LoopShaping
from flexarm.controllers.joint.mu_synthesis import MuSynthesis
from flexarm.controllers.joint.prescribed_performance import PrescribedPerformance
from flexarm.controllers.joint.strain_feedback import StrainFeedback
from flexarm.controllers.linear.composite import Composite
from flexarm.controllers.linear.lqg import LQG
from flexarm.controllers.linear.mpc import MPC
from flexarm.controllers.linear.nonlinear_mpc import NonlinearMPC
from flexarm.controllers.uncertain.adaptive import Adaptive
from flexarm.controllers.uncertain.disturbance_observer import DisturbanceObserver
from flexarm.controllers.uncertain.rbf_adaptive import RBFAdaptive
from flexarm.controllers.uncertain.repetitive import RepetitiveControl
from flexarm.controllers.uncertain.sliding_mode import SlidingMode
from flexarm.controllers.vibration.integral_resonant import IntegralResonantControl
from flexarm.controllers.vibration.output_redefinition import OutputRedefinition
from flexarm.controllers.vibration.positive_position import PositivePositionFeedback
from flexarm.controllers.vibration.wave_based import WaveBasedControl
from flexarm.estimation.estimator_controller import EstimatorController
from flexarm.estimation.extended_kalman import ExtendedKalmanFilter
from flexarm.estimation.moving_horizon import MovingHorizonEstimator
from flexarm.estimation.unscented_kalman import UnscentedKalmanFilter
from flexarm.loop_analysis.margins import loop_margins
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
