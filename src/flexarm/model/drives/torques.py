"""Drives without measurements: prescribed or precomputed torques, or none."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from pydantic import Field

from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Listed, Number, Positive, length_of
from flexarm.model.wording import Fault


class RigidInverseDynamicsDrive(Record):
    """Inverse dynamics of the rigid model along the motion, without feedback."""

    kind: Literal["rigid_inverse_dynamics"] = "rigid_inverse_dynamics"


class TorqueDrive(Record):
    """Sampled joint torques as a function of time."""

    kind: Literal["torque"] = "torque"
    rate: Positive = Field(description="Samples per second (Hz).")
    values: Listed[Listed[Number]] = Field(
        description="One row for each sample: the torque of each joint (N m).",
        json_schema_extra={"minItems": 1},
    )
    interpolation: Literal["cubic", "linear", "hold"] = Field(
        default="cubic",
        description=(
            "Interpolation between samples; a cubic overshoots where samples jump. "
            "After the last sample the torque is constant."
        ),
    )

    _columns: ClassVar[tuple[str, ...]] = ("values",)

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        samples = length_of(given.raw("values"))
        if samples == 0:
            yield Fault(("values",), "is empty")
        if samples == 1 and given.has("interpolation") and given.interpolation != "hold":
            rule = f"have at least two samples for {given.interpolation} interpolation"
            yield Fault(("values",), rule, "1")


class NoDrive(Record):
    """No torque: the arm moves freely."""

    kind: Literal["none"] = "none"
