"""Drives of a scenario: controllers, prescribed torques, or none."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flexarm.model.drives.around import AROUND, FilterSpec
from flexarm.model.drives.base import ControllerDrive
from flexarm.model.drives.registry import ALONE, one_of
from flexarm.model.drives.torques import NoDrive, RigidInverseDynamicsDrive, TorqueDrive

#: Drives that are controllers, by their kind.
CONTROLLED: dict[str, type[ControllerDrive]] = {
    record.model_fields["kind"].default: record for record in (*ALONE, *AROUND)
}
if TYPE_CHECKING:
    Drive = Any
else:
    Drive = one_of((RigidInverseDynamicsDrive, TorqueDrive, NoDrive, *CONTROLLED.values()))
# A record can be pickled only if its module has it.
globals().update({record.__name__: record for record in (*CONTROLLED.values(), FilterSpec)})


def balances(drive: object) -> bool:
    """Return whether a drive includes gravity compensation, or accepts no feedforward torque."""
    return isinstance(drive, ControllerDrive) and drive.balances()


__all__ = [
    "CONTROLLED",
    "ControllerDrive",
    "Drive",
    "FilterSpec",
    "NoDrive",
    "RigidInverseDynamicsDrive",
    "TorqueDrive",
    "balances",
]
