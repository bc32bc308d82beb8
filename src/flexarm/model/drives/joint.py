"""Joint controllers: PD, PID and strain feedback at single joints, and computed torque."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from pydantic import Field

from flexarm.model.checks import Given
from flexarm.model.drives.base import (
    ControllerDrive,
    Derivative,
    Feedforward,
    Proportional,
    SampleTime,
)
from flexarm.model.quantities import NonNegative, Number, OneOrMany, Positive
from flexarm.model.wording import Fault


class JointPDDrive(ControllerDrive):
    """Joint PD control: a proportional-derivative controller at each joint along the motion."""

    kind: Literal["joint_pd"] = "joint_pd"
    proportional: Proportional
    derivative: Derivative
    feedforward: Feedforward = "none"
    sample_time: SampleTime = 0.001

    per_joint: ClassVar[tuple[str, ...]] = ("proportional", "derivative")


class JointPIDDrive(ControllerDrive):
    """Joint PID control along the motion, with optional gravity compensation."""

    kind: Literal["joint_pid"] = "joint_pid"
    proportional: Proportional
    derivative: Derivative
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
    feedforward: Feedforward = "none"
    sample_time: SampleTime = 0.001

    per_joint: ClassVar[tuple[str, ...]] = (
        "proportional",
        "derivative",
        "integral",
        "torque_limit",
    )

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        twice = given.has("gravity") and given.gravity != "none"
        if twice and given.has("feedforward") and given.feedforward != "none":
            rule = f"cannot be combined with feedforward {given.feedforward}"
            yield Fault(("gravity",), rule)

    def balances(self) -> bool:
        """See `ControllerDrive.balances`."""
        return self.gravity != "none"


class ComputedTorqueDrive(ControllerDrive):
    """Computed torque of the rigid model along the motion."""

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
    sample_time: SampleTime = 0.001

    per_joint: ClassVar[tuple[str, ...]] = ("frequency_hz", "damping_ratio")

    def balances(self) -> bool:
        """See `ControllerDrive.balances`."""
        return self.feedforward == "none"


class StrainFeedbackDrive(ControllerDrive):
    """Joint PD control with feedback of the strain at one gauge per joint."""

    kind: Literal["strain_feedback"] = "strain_feedback"
    proportional: Proportional
    derivative: Derivative
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
    feedforward: Feedforward = "none"
    sample_time: SampleTime = 0.001

    per_joint: ClassVar[tuple[str, ...]] = ("proportional", "derivative", "strain", "strain_rate")
