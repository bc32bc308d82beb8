"""References and torques of drives: those of the flexible arm or of the rigid one."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from flexarm.arm.arm import Arm
from flexarm.base.errors import FlexarmError, LargeDeflectionWarning
from flexarm.cases.scenario.file_errors import problems_under
from flexarm.cases.scenario.motions import TaskReference
from flexarm.integrate.base import FloatArray
from flexarm.linear.reference_motions.pressed import PressedMotion
from flexarm.linear.reference_motions.quasi_static import quasi_static_reference
from flexarm.model.drives import (
    ControllerDrive,
    FlexibleTorqueDrive,
    IntegralManifoldDrive,
    QuasiStaticDrive,
    RigidInverseDynamicsDrive,
    TipInversionDrive,
)
from flexarm.motion import Motion, rigid_torque
from flexarm.simulation.inversion.flexible_torque import flexible_torque
from flexarm.simulation.inversion.tip_inversion import tip_inversion

#: Function of time (s) that returns torques (joints,), N m.
TorqueFunction = Callable[[Any], Any]
#: Orders of `quasi_static_reference` by the kind of a reference or drive.
_ORDERS = {"quasi_static": 1, "integral_manifold": 2}


@dataclass(frozen=True, eq=False)
class Followed:
    """Reference of a drive along a motion.

    Attributes:
        motion: the reference, or None without a motion.
        kind: "quasi_static", "integral_manifold", "tip_inversion", "rigid", "pressed" or "none";
            after "rigid" the reason, if the flexible reference does not exist.
        torque: torque of the reference, or None.
        initial: coordinates (dof,) of the arm at rest at the start of a flexible reference.
    """

    motion: TaskReference | None
    kind: str = "none"
    torque: TorqueFunction | None = None
    initial: FloatArray | None = None


def reference_of(arm: Arm, drive: ControllerDrive, motion: TaskReference | None) -> Followed:
    """Return the reference that a controller follows along a motion.

    Raises:
        InputError, SimulationError, InversionError: if a requested reference does not exist for
            the arm and the motion.
    """
    if motion is None:
        return Followed(None)
    if isinstance(motion, PressedMotion):
        return Followed(motion, "pressed", motion.holding_torque, motion.initial)
    kind = drive.reference_kind
    if kind is None:
        return _bent_or_rigid(arm, motion)
    with problems_under("reference"):
        if kind in _ORDERS:
            return _quasi_static(arm, motion, kind)
        if kind == "tip_inversion":
            inverse = tip_inversion(arm, motion)
            return Followed(inverse.reference, kind, inverse.torque, inverse.initial)
    return _rigid(arm, motion)


def torque_of(arm: Arm, drive: Any, motion: Motion) -> Followed:
    """Return the torque of a drive without feedback, with the motion that it is for.

    Raises:
        InputError, SimulationError, InversionError: if the torque does not exist.
    """
    match drive:
        case RigidInverseDynamicsDrive():
            return _rigid(arm, motion)
        case QuasiStaticDrive() | IntegralManifoldDrive():
            return _quasi_static(arm, motion, drive.kind)
        case FlexibleTorqueDrive():
            torque = flexible_torque(arm, motion)
            return Followed(motion, drive.kind, torque, torque.initial)
    assert isinstance(drive, TipInversionDrive)
    options = {name: getattr(drive, name) for name in type(drive).model_fields if name != "kind"}
    inverse = tip_inversion(arm, motion, **options)
    return Followed(motion, drive.kind, inverse.torque, inverse.initial)


def _bent_or_rigid(arm: Arm, motion: Motion) -> Followed:
    """Return the quasi-static reference, or the rigid one with the reason."""
    if arm.dof == arm.joints:
        return _rigid(arm, motion)
    try:
        return _quasi_static(arm, motion)
    except FlexarmError as error:
        return _rigid(arm, motion, f": {error}")


def _rigid(arm: Arm, motion: Motion, reason: str = "") -> Followed:
    return Followed(motion, f"rigid{reason}", rigid_torque(arm, motion))


def _quasi_static(arm: Arm, motion: Motion, kind: str = "quasi_static") -> Followed:
    with warnings.catch_warnings():  # the run warns of its states
        warnings.simplefilter("ignore", LargeDeflectionWarning)
        bent = quasi_static_reference(arm, motion, order=_ORDERS[kind])
    return Followed(bent, kind, bent.torque, bent.initial)
