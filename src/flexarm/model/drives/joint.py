"""Joint controllers: PD, PID and strain feedback at single joints, and computed torque."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY
from typing import Annotated, Any, Literal

from flexarm.model.checks import Given
from flexarm.model.drives.base import (
    ControllerParameters,
    Derivative,
    Feedforward,
    FeedforwardKind,
    Proportional,
    SampleTime,
)
from flexarm.model.quantities import NonNegative, Number, PerJoint, Positive
from flexarm.model.wording import Fault


class JointPDParameters(ControllerParameters):
    """Joint PD control: a proportional-derivative controller at each joint along the motion."""

    name = "joint_pd"
    proportional: Proportional
    derivative: Derivative
    sample_time: SampleTime = 0.001


class JointPDKeys(JointPDParameters):
    """Keys of the drive `joint_pd`."""

    feedforward: Feedforward = None


class JointPIDParameters(ControllerParameters):
    """Joint PID control along the motion, with optional gravity compensation."""

    name = "joint_pid"
    proportional: Proportional
    derivative: Derivative
    integral: Annotated[Any, PerJoint(NonNegative)] = 0.0
    """Torque per integral of the angle error, one for all joints or one for each (N m/(rad s))."""
    _: KW_ONLY
    sample_time: SampleTime = 0.001


class JointPIDKeys(JointPIDParameters):
    """Keys of the drive `joint_pid`."""

    gravity: Literal["none", "rigid", "sag"] = "none"
    """Gravity compensation at the measured angles: none, of the rigid arm, or of the arm with bent
    links."""
    torque_limit: Annotated[Any, PerJoint(Positive)] | None = None
    """Torque limit (N m), one for all joints or one for each; no limit by default."""
    feedforward: Feedforward = None

    @classmethod
    def _file_faults(cls, given: Given) -> Iterator[Fault]:
        twice = given.has("gravity") and given.gravity != "none"
        if twice and given.has("feedforward") and given.feedforward != "none":
            yield Fault(("gravity",), f"cannot be combined with feedforward {given.feedforward}")

    @staticmethod
    def _file_balances(drive: Any) -> bool:
        return bool(drive.gravity != "none")


class ComputedTorqueParameters(ControllerParameters):
    """Computed torque of the rigid model along the motion."""

    name = "computed_torque"
    frequency_hz: Annotated[Any, PerJoint(Positive)]
    """Natural frequency of the error (Hz), one for all joints or one for each."""
    damping_ratio: Annotated[Any, PerJoint(NonNegative)] = 1.0
    """Damping ratio of the error, one for all joints or one for each."""
    _: KW_ONLY
    sample_time: SampleTime = 0.001


class ComputedTorqueKeys(ComputedTorqueParameters):
    """Keys of the drive `computed_torque`."""

    feedforward: FeedforwardKind | None = None
    """Torque along the motion, see joint_pd, instead of the torque of the model at the measured
    angles; by default that of the reference of a flexible arm."""

    @staticmethod
    def _file_balances(drive: Any) -> bool:
        return drive.feedforward in (None, "none")


class StrainFeedbackParameters(ControllerParameters):
    """Joint PD control with feedback of the strain at one gauge per joint."""

    name = "strain_feedback"
    proportional: Proportional
    derivative: Derivative
    strain: Annotated[Any, PerJoint(Number)]
    """Torque per strain of the gauge with the same index, one for all joints or one each (N m)."""
    strain_rate: Annotated[Any, PerJoint(Number)] = 0.0
    """Torque per strain rate, one for all joints or one for each (N m s)."""
    _: KW_ONLY
    rate_cutoff: Positive | None = None
    """Cutoff of the filter that differentiates strains (Hz); by default a tenth of the sampling
    frequency."""
    sample_time: SampleTime = 0.001


class StrainFeedbackKeys(StrainFeedbackParameters):
    """Keys of the drive `strain_feedback`."""

    feedforward: Feedforward = None
