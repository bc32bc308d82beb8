"""Drives of a scenario: controllers, prescribed or precomputed torques, or none."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field

from flexarm.model.checks import Given, Record
from flexarm.model.drives.around import AROUND
from flexarm.model.drives.around import FilterSpec as FilterSpec
from flexarm.model.drives.base import ControllerDrive as ControllerDrive
from flexarm.model.drives.controllers import GROUPS, one_of
from flexarm.model.quantities import Listed, Number, Positive, length_of
from flexarm.model.wording import Fault


class RigidInverseDynamicsDrive(Record):
    """Inverse dynamics of the rigid model along the motion, without feedback."""

    kind: Literal["rigid_inverse_dynamics"] = "rigid_inverse_dynamics"


class QuasiStaticDrive(Record):
    """Torques of the statically bent arm whose tip follows the motion, without feedback."""

    kind: Literal["quasi_static"] = "quasi_static"


class IntegralManifoldDrive(Record):
    """Torques as for `quasi_static`, with the bending due to the accelerations of the bending."""

    kind: Literal["integral_manifold"] = "integral_manifold"


class FlexibleTorqueDrive(Record):
    """Torques with which the joints of the flexible arm follow the motion, without feedback."""

    kind: Literal["flexible_torque"] = "flexible_torque"


class TipInversionDrive(Record):
    """Torques with which the tip of the flexible arm follows the motion, without feedback."""

    kind: Literal["tip_inversion"] = "tip_inversion"
    pre_actuation: Positive | None = None
    """Duration of the torques before the motion (s); by default until 1e-6 of the bending
    remains."""
    post_actuation: Positive | None = None
    """Duration of the torques after the motion, likewise (s)."""
    reduction: Positive = 2e-3
    """Tip error that ends the search, as a fraction of that under rigid torques."""


class TorqueDrive(Record):
    """Sampled joint torques as a function of time."""

    kind: Literal["torque"] = "torque"
    rate: Positive
    """Samples per second (Hz)."""
    values: Listed[Listed[Number]] = Field(json_schema_extra={"minItems": 1})
    """One row for each sample: the torque of each joint (N m), or its voltage."""
    interpolation: Literal["cubic", "linear", "hold"] = "cubic"
    """Interpolation between samples; a cubic overshoots where samples jump. After the last sample
    the torque is constant."""

    quantity: Literal["torque", "voltage"] = "torque"
    """Quantity of the values: torque, or voltage of the motors of joints with a winding (in V)."""

    _columns: ClassVar[tuple[str, ...]] = ("values",)

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        samples = length_of(given.raw("values"))
        if samples == 0:
            yield Fault(("values",), "is empty")
        if samples == 1 and given.has("interpolation") and given.interpolation != "hold":
            rule = f"have at least two samples for {given.interpolation} interpolation"
            yield Fault(("values",), rule, "1")


def in_volts(drive: object) -> bool:
    """Return whether a drive has samples of voltages."""
    return isinstance(drive, TorqueDrive) and drive.quantity == "voltage"


#: Drives without feedback whose torques are computed from the motion.
FEEDFORWARD_DRIVES: tuple[str, ...] = (
    "rigid_inverse_dynamics",
    "quasi_static",
    "integral_manifold",
    "flexible_torque",
    "tip_inversion",
)


class NoDrive(Record):
    """No torque: the arm moves freely."""

    kind: Literal["none"] = "none"


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
