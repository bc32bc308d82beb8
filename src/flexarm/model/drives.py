"""What moves the joints in a scenario."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Listed, NonNegative, Number, OneOrMany, Positive, length_of
from flexarm.model.wording import Fault


class RigidInverseDynamicsDrive(Record):
    """The torques that would move the rigid twin along the motion, without feedback."""

    kind: Literal["rigid_inverse_dynamics"] = "rigid_inverse_dynamics"


class TorqueDrive(Record):
    """Sampled joint torques."""

    kind: Literal["torque"] = "torque"
    rate: Positive = Field(description="Samples per second (Hz).")
    values: Listed[Listed[Number]] = Field(
        description="One row for each sample: the torque of each joint (N m).",
        json_schema_extra={"minItems": 1},
    )
    interpolation: Literal["cubic", "linear", "hold"] = Field(
        default="cubic", description="What happens between samples."
    )

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        samples = length_of(given.raw("values"))
        if samples == 0:
            yield Fault(("values",), "hold at least one sample", "empty")
        if samples == 1 and given.has("interpolation") and given.interpolation != "hold":
            rule = f"hold at least two samples for {given.interpolation} interpolation"
            yield Fault(("values",), rule, "1 long")


class JointPDDrive(Record):
    """A proportional-derivative controller at each joint, following the motion."""

    kind: Literal["joint_pd"] = "joint_pd"
    proportional: OneOrMany[NonNegative] = Field(
        description="Torque per angle error, one for all joints or one each (N m/rad)."
    )
    derivative: OneOrMany[NonNegative] = Field(
        description="Torque per rate error, one for all joints or one each (N m s/rad)."
    )
    feedforward: Literal["none", "rigid_inverse_dynamics"] = Field(
        default="none", description="Torque added to the feedback."
    )
    sample_time: Positive = Field(
        default=0.001, description="Time between updates; the torque is held in between (s)."
    )


class NoDrive(Record):
    """No torque: the arm moves freely."""

    kind: Literal["none"] = "none"


Drive = Annotated[
    RigidInverseDynamicsDrive | TorqueDrive | JointPDDrive | NoDrive, Field(discriminator="kind")
]
