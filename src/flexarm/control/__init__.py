"""Controllers: one a file, and the registry of their names."""

from __future__ import annotations

from flexarm.control.base import Controller, Measurement, Reference
from flexarm.control.computed_torque import ComputedTorque
from flexarm.control.hardware import Hardware, Motors
from flexarm.control.input_shaping import shaped
from flexarm.control.instruments import Instrument
from flexarm.control.joint_pd import JointPD
from flexarm.control.joint_pid import JointPID
from flexarm.control.strain_feedback import StrainFeedback

#: Every controller by the name that scenario files use.
CONTROLLERS: dict[str, type[Controller]] = {
    ComputedTorque.name: ComputedTorque,
    JointPD.name: JointPD,
    JointPID.name: JointPID,
    StrainFeedback.name: StrainFeedback,
}

__all__ = [
    "CONTROLLERS",
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
