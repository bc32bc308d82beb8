"""Drives of a scenario: controllers, prescribed torques, or none."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flexarm.model.checks import Record
from flexarm.model.drives.around import AROUND, FilterSpec
from flexarm.model.drives.base import ControllerDrive
from flexarm.model.drives.registry import GROUPS, one_of
from flexarm.model.drives.torques import (
    FEEDFORWARD_DRIVES,
    FlexibleTorqueDrive,
    IntegralManifoldDrive,
    NoDrive,
    QuasiStaticDrive,
    RigidInverseDynamicsDrive,
    TipInversionDrive,
    TorqueDrive,
    in_volts,
    winding_faults,
)

#: All drives of files, by the title of their group in lists.
DRIVES: dict[str, tuple[type[Record], ...]] = {
    "without feedback": (
        RigidInverseDynamicsDrive,
        QuasiStaticDrive,
        IntegralManifoldDrive,
        FlexibleTorqueDrive,
        TipInversionDrive,
        TorqueDrive,
        NoDrive,
    ),
    **GROUPS,
    "with an inner controller": AROUND,
}
#: Drives that are controllers, by their kind.
CONTROLLED: dict[str, type[ControllerDrive]] = {
    record.model_fields["kind"].default: record
    for group in DRIVES.values()
    for record in group
    if issubclass(record, ControllerDrive)
}
if TYPE_CHECKING:
    Drive = Any
else:
    Drive = one_of([record for group in DRIVES.values() for record in group])
# A record can be pickled only if its module has it.
globals().update({record.__name__: record for record in (*CONTROLLED.values(), FilterSpec)})


def balances(drive: object) -> bool:
    """Return whether a drive includes gravity compensation, or accepts no feedforward torque."""
    return isinstance(drive, ControllerDrive) and drive.balances()


__all__ = [
    "CONTROLLED",
    "DRIVES",
    "FEEDFORWARD_DRIVES",
    "ControllerDrive",
    "Drive",
    "FilterSpec",
    "FlexibleTorqueDrive",
    "IntegralManifoldDrive",
    "NoDrive",
    "QuasiStaticDrive",
    "RigidInverseDynamicsDrive",
    "TipInversionDrive",
    "TorqueDrive",
    "balances",
    "in_volts",
    "winding_faults",
]
