"""Controllers: one a file, and the registry of their names."""

from __future__ import annotations

from flexarm.control.base import Controller, Measurement, Reference
from flexarm.control.composite import Composite
from flexarm.control.hardware import Hardware, Motors
from flexarm.control.instruments import Instrument
from flexarm.control.joint_pd import JointPD
from flexarm.control.lqg import LQG
from flexarm.control.mpc import MPC

#: Every controller by the name that scenario files use.
CONTROLLERS: dict[str, type[Controller]] = {
    Composite.name: Composite,
    JointPD.name: JointPD,
    LQG.name: LQG,
    MPC.name: MPC,
}

__all__ = [
    "CONTROLLERS",
    "LQG",
    "MPC",
    "Composite",
    "Controller",
    "Hardware",
    "Instrument",
    "JointPD",
    "Measurement",
    "Motors",
    "Reference",
]
