"""Controllers: one a file, and the registry of their names."""

from __future__ import annotations

from flexarm.control.base import Controller, Measurement, Reference
from flexarm.control.composite import Composite
from flexarm.control.computed_torque import ComputedTorque
from flexarm.control.hardware import Hardware, Motors
from flexarm.control.input_shaping import shaped
from flexarm.control.instruments import Instrument
from flexarm.control.joint_pd import JointPD
from flexarm.control.joint_pid import JointPID
from flexarm.control.lqg import LQG
from flexarm.control.mpc import MPC
from flexarm.control.strain_feedback import StrainFeedback

#: Every controller by the name that scenario files use.
CONTROLLERS: dict[str, type[Controller]] = {
    Composite.name: Composite,
    ComputedTorque.name: ComputedTorque,
    JointPD.name: JointPD,
    JointPID.name: JointPID,
    LQG.name: LQG,
    MPC.name: MPC,
    StrainFeedback.name: StrainFeedback,
}

__all__ = [
    "CONTROLLERS",
    "LQG",
    "MPC",
    "Composite",
    "ComputedTorque",
    "Controller",
    "Hardware",
    "Instrument",
    "JointPD",
    "JointPID",
    "Measurement",
    "Motors",
    "Reference",
    "StrainFeedback",
    "shaped",
]
