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


class JointPIDDrive(Record):
    """A PID controller at each joint, following the motion, with the arm's weight balanced."""

    kind: Literal["joint_pid"] = "joint_pid"
    proportional: OneOrMany[NonNegative] = Field(
        description="Torque per angle error, one for all joints or one each (N m/rad)."
    )
    derivative: OneOrMany[NonNegative] = Field(
        description="Torque per rate error, one for all joints or one each (N m s/rad)."
    )
    integral: OneOrMany[NonNegative] = Field(
        default=0.0,
        description="Torque per angle error and time, one for all joints or one each "
        "(N m/(rad s)).",
    )
    gravity: Literal["none", "rigid", "sag"] = Field(
        default="none",
        description="Weight that is balanced at the measured angles: none, that of the rigid arm, "
        "or that of the arm with links that sag.",
    )
    torque_limit: OneOrMany[Positive] | None = Field(
        default=None,
        description="Largest torque asked for, one for all joints or one each (N m); no limit by "
        "default.",
    )
    feedforward: Literal["none", "rigid_inverse_dynamics"] = Field(
        default="none", description="Torque added to the feedback."
    )
    sample_time: Positive = Field(
        default=0.001, description="Time between updates; the torque is held in between (s)."
    )

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        twice = given.has("gravity") and given.gravity != "none"
        if twice and given.has("feedforward") and given.feedforward != "none":
            rule = "be none where the feedforward holds the weight, too"
            yield Fault(("gravity",), rule, repr(given.gravity))


class ComputedTorqueDrive(Record):
    """Computed torque from the rigid model, following the motion."""

    kind: Literal["computed_torque"] = "computed_torque"
    frequency_hz: OneOrMany[Positive] = Field(
        description="Natural frequency of the error, one for all joints or one each (Hz)."
    )
    damping_ratio: OneOrMany[NonNegative] = Field(
        default=1.0, description="Of the error, one for all joints or one each."
    )
    feedforward: Literal["none", "rigid_inverse_dynamics"] = Field(
        default="none",
        description="Torque along the motion in place of the model's at the measured angles.",
    )
    sample_time: Positive = Field(
        default=0.001, description="Time between updates; the torque is held in between (s)."
    )


class StrainFeedbackDrive(Record):
    """A PD controller at each joint that yields to the strain at one gauge for each joint."""

    kind: Literal["strain_feedback"] = "strain_feedback"
    proportional: OneOrMany[NonNegative] = Field(
        description="Torque per angle error, one for all joints or one each (N m/rad)."
    )
    derivative: OneOrMany[NonNegative] = Field(
        description="Torque per rate error, one for all joints or one each (N m s/rad)."
    )
    strain: OneOrMany[Number] = Field(
        description="Torque per strain of the gauge of the same place, one for all joints or one "
        "each (N m)."
    )
    strain_rate: OneOrMany[Number] = Field(
        default=0.0,
        description="Torque per rate of strain, one for all joints or one each (N m s).",
    )
    rate_cutoff: Positive = Field(
        default=100.0, description="Of the filter that differentiates strains (Hz)."
    )
    feedforward: Literal["none", "rigid_inverse_dynamics"] = Field(
        default="none", description="Torque added to the feedback."
    )
    sample_time: Positive = Field(
        default=0.001, description="Time between updates; the torque is held in between (s)."
    )


#: Drives that are controllers, and their values of which there may be one for each joint.
CONTROLLED: dict[str, tuple[str, ...]] = {
    "computed_torque": ("frequency_hz", "damping_ratio"),
    "joint_pd": ("proportional", "derivative"),
    "joint_pid": ("proportional", "derivative", "integral", "torque_limit"),
    "strain_feedback": ("proportional", "derivative", "strain", "strain_rate"),
}


class NoDrive(Record):
    """No torque: the arm moves freely."""

    kind: Literal["none"] = "none"


Drive = Annotated[
    RigidInverseDynamicsDrive
    | TorqueDrive
    | JointPDDrive
    | JointPIDDrive
    | ComputedTorqueDrive
    | StrainFeedbackDrive
    | NoDrive,
    Field(discriminator="kind"),
]


def balances(drive: object) -> bool:
    """Whether a drive holds the arm's weight whatever it is told to add."""
    if isinstance(drive, ComputedTorqueDrive):
        return drive.feedforward == "none"
    return isinstance(drive, JointPIDDrive) and drive.gravity != "none"
