"""Built-in controllers, and the registry of their names: one import is one entry."""

from __future__ import annotations

from typing import Any

from flexarm.control.contract.base import Controller as Controller
from flexarm.control.filters.estimator_controller import EstimatorController as EstimatorController
from flexarm.control.laws.compensation import DisturbanceObserver as DisturbanceObserver
from flexarm.control.laws.compensation import RepetitiveControl as RepetitiveControl
from flexarm.control.laws.composite import Composite as Composite
from flexarm.control.laws.joint_laws import ComputedTorque as ComputedTorque
from flexarm.control.laws.joint_laws import JointPD as JointPD
from flexarm.control.laws.joint_laws import JointPID as JointPID
from flexarm.control.laws.joint_laws import PrescribedPerformance as PrescribedPerformance
from flexarm.control.laws.joint_laws import StrainFeedback as StrainFeedback
from flexarm.control.laws.lqg import LQG as LQG
from flexarm.control.laws.mpc import MPC as MPC
from flexarm.control.laws.mpc import NonlinearMPC as NonlinearMPC
from flexarm.control.laws.robust_laws import LoopShaping as LoopShaping
from flexarm.control.laws.robust_laws import MuSynthesis as MuSynthesis
from flexarm.control.laws.sliding_laws import Adaptive as Adaptive
from flexarm.control.laws.sliding_laws import RBFAdaptive as RBFAdaptive
from flexarm.control.laws.sliding_laws import SlidingMode as SlidingMode
from flexarm.control.laws.strain_damping import IntegralResonantControl as IntegralResonantControl
from flexarm.control.laws.strain_damping import OutputRedefinition as OutputRedefinition
from flexarm.control.laws.strain_damping import PositivePositionFeedback as PositivePositionFeedback
from flexarm.control.laws.strain_damping import WaveBasedControl as WaveBasedControl
from flexarm.control.laws.task_controller import AdaptiveForce as AdaptiveForce
from flexarm.control.laws.task_controller import Admittance as Admittance
from flexarm.control.laws.task_controller import HybridForce as HybridForce
from flexarm.control.laws.task_controller import Impedance as Impedance
from flexarm.control.laws.task_controller import NeuralForce as NeuralForce


def _is_built_in(value: Any) -> bool:
    return isinstance(value, type) and issubclass(value, Controller) and value is not Controller


#: Controllers by name. The drives of files have the same names as kinds.
CONTROLLERS: dict[str, type[Controller]] = {
    kind.name: kind for kind in filter(_is_built_in, [*globals().values()])
}
