"""Drives of a scenario: controllers, prescribed torques, or none."""

from __future__ import annotations

from typing import Annotated, get_args

from pydantic import Field

from flexarm.model.drives.around import DisturbanceObserverDrive, EstimatorDrive, FilterSpec
from flexarm.model.drives.base import ControllerDrive
from flexarm.model.drives.force import AdmittanceDrive, HybridForceDrive, ImpedanceDrive
from flexarm.model.drives.joint import (
    ComputedTorqueDrive,
    JointPDDrive,
    JointPIDDrive,
    StrainFeedbackDrive,
)
from flexarm.model.drives.linear import CompositeDrive, LQGDrive, MPCDrive
from flexarm.model.drives.registry import Alone
from flexarm.model.drives.torques import NoDrive, RigidInverseDynamicsDrive, TorqueDrive
from flexarm.model.drives.uncertain import AdaptiveDrive, RBFAdaptiveDrive, SlidingModeDrive

_Controllers = Alone | DisturbanceObserverDrive | EstimatorDrive
Drive = Annotated[
    RigidInverseDynamicsDrive | TorqueDrive | NoDrive | _Controllers, Field(discriminator="kind")
]
#: Drives that are controllers, by their kind.
CONTROLLED: dict[str, type[ControllerDrive]] = {
    record.model_fields["kind"].default: record for record in get_args(_Controllers)
}


def balances(drive: object) -> bool:
    """Return whether a drive includes gravity compensation, or accepts no feedforward torque."""
    return isinstance(drive, ControllerDrive) and drive.balances()


__all__ = [
    "CONTROLLED",
    "AdaptiveDrive",
    "AdmittanceDrive",
    "CompositeDrive",
    "ComputedTorqueDrive",
    "ControllerDrive",
    "DisturbanceObserverDrive",
    "Drive",
    "EstimatorDrive",
    "FilterSpec",
    "HybridForceDrive",
    "ImpedanceDrive",
    "JointPDDrive",
    "JointPIDDrive",
    "LQGDrive",
    "MPCDrive",
    "NoDrive",
    "RBFAdaptiveDrive",
    "RigidInverseDynamicsDrive",
    "SlidingModeDrive",
    "StrainFeedbackDrive",
    "TorqueDrive",
    "balances",
]
