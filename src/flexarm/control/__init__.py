"""Controllers: one a file, and the registry of their names."""

from __future__ import annotations

from flexarm.control.adaptive import Adaptive
from flexarm.control.base import Controller, Measurement, Reference
from flexarm.control.disturbance_observer import DisturbanceObserver
from flexarm.control.estimator import EstimatorController
from flexarm.control.extended_kalman import ExtendedKalmanFilter
from flexarm.control.hardware import Hardware, Motors
from flexarm.control.instruments import Instrument
from flexarm.control.joint_pd import JointPD
from flexarm.control.rbf_adaptive import RBFAdaptive
from flexarm.control.sliding_mode import SlidingMode

#: Every controller by the name that scenario files use.
CONTROLLERS: dict[str, type[Controller]] = {
    Adaptive.name: Adaptive,
    DisturbanceObserver.name: DisturbanceObserver,
    EstimatorController.name: EstimatorController,
    JointPD.name: JointPD,
    RBFAdaptive.name: RBFAdaptive,
    SlidingMode.name: SlidingMode,
}

__all__ = [
    "CONTROLLERS",
    "Adaptive",
    "Controller",
    "DisturbanceObserver",
    "EstimatorController",
    "ExtendedKalmanFilter",
    "Hardware",
    "Instrument",
    "JointPD",
    "Measurement",
    "Motors",
    "RBFAdaptive",
    "Reference",
    "SlidingMode",
]
