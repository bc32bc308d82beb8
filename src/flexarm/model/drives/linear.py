"""Controllers designed on linear models of the flexible arm: LQG, MPC, composite."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, Tag

from flexarm.model.drives.base import ControllerDrive, Posture, SampleTime
from flexarm.model.quantities import (
    Count,
    Flag,
    Listed,
    Named,
    NonNegative,
    Number,
    OneOrMany,
    Positive,
    Word,
)

Schedule = Annotated[
    Listed[Listed[Number] | None] | None,
    Field(
        description="For each joint nothing, or rising angles: designs on the grid of them, gains "
        "interpolated between (rad)."
    ),
]
AcceptableTorque = Annotated[
    OneOrMany[Positive] | None,
    Field(
        description="Torque that counts as much, one for all joints or one each (N m); what gives "
        "the rigid arm 10 rad/s^2 where left out."
    ),
]
Measured = Annotated[
    Named[OneOrMany[Positive]] | None,
    Field(
        description="What is measured, of joint_angle, joint_rate, strain and tip, and the "
        "standard deviation of its noise; joint angles to 0.1 mrad and strain to 2e-5 where left "
        "out."
    ),
]
Disturbance = Annotated[
    Named[OneOrMany[Positive]] | None,
    Field(
        description="Inputs that act unseen, such as torque and tip_force, and their standard "
        "deviations; parts of the acceptable torque where left out."
    ),
]
TorqueLimit = Annotated[
    OneOrMany[Positive] | None,
    Field(
        description="Largest torque asked for, one for all joints or one each (N m); none where "
        "left out."
    ),
]
Acceptable = Annotated[
    Named[OneOrMany[Positive]] | None,
    Field(
        description="Outputs and the deviation of each that counts as much as the others'; 10 mrad "
        "of joint_angle, 10 mm of tip and 0.2 rad/s of joint_rate where left out."
    ),
]


def _flag_word_or_names(value: Any) -> str:
    if isinstance(value, dict):
        return "<names>"
    return "<word>" if isinstance(value, str) else "<flag>"


_Integral = Annotated[
    Annotated[Flag, Tag("<flag>")]
    | Annotated[Word, Tag("<word>")]
    | Annotated[Named[OneOrMany[Positive]], Tag("<names>")],
    Discriminator(_flag_word_or_names),
]
Integral = Annotated[
    _Integral | None,
    Field(
        description="Whether the deviation of joint angles is fed back integrated; or which, "
        "joint_angle or tip, with the integral that is acceptable (rad s, m s)."
    ),
]
Preview = Annotated[
    NonNegative, Field(description="Time for which the reference is known ahead (s).")
]


Recovery = Annotated[
    NonNegative,
    Field(
        description="Loop-transfer recovery: fictitious torque noise of the filter, in parts of "
        "acceptable_torque."
    ),
]
RigidityUncertainty = Annotated[
    NonNegative,
    Field(description="Relative error of the links' stiffness to be robust against, such as 0.3."),
]


class LQGDrive(ControllerDrive):
    """LQG: state feedback of the flexible arm by a linear-quadratic regulator and Kalman filter."""

    kind: Literal["lqg"] = "lqg"
    posture: Posture = None
    schedule: Schedule = None
    acceptable: Acceptable = None
    acceptable_torque: AcceptableTorque = None
    measured: Measured = None
    disturbance: Disturbance = None
    integral: Integral = None
    recovery: Recovery = 0.0
    rigidity_uncertainty: RigidityUncertainty = 0.0
    torque_limit: TorqueLimit = None
    preview: Preview = 0.5
    sample_time: SampleTime = 0.001

    per_joint: ClassVar[tuple[str, ...]] = (
        "posture",
        "schedule",
        "acceptable_torque",
        "torque_limit",
    )


class MPCDrive(ControllerDrive):
    """MPC: the regulator of `lqg` with limits of torque and torque rate."""

    kind: Literal["mpc"] = "mpc"
    posture: Posture = None
    torque_limit: OneOrMany[Positive] = Field(
        description="Largest torque, one for all joints or one each (N m)."
    )
    torque_rate: OneOrMany[Positive] | None = Field(
        default=None,
        description="Fastest change of torque, one for all joints or one each (N m/s); any where "
        "left out.",
    )
    horizon: Count = Field(default=40, description="Number of samples looked ahead, 1 to 500.")
    schedule: Schedule = None
    acceptable: Acceptable = None
    acceptable_torque: AcceptableTorque = None
    measured: Measured = None
    disturbance: Disturbance = None
    integral: Integral = None
    recovery: Recovery = 0.0
    rigidity_uncertainty: RigidityUncertainty = 0.0
    preview: Preview = 0.5
    sample_time: SampleTime = 0.005

    per_joint: ClassVar[tuple[str, ...]] = (*LQGDrive.per_joint, "torque_rate")


class CompositeDrive(ControllerDrive):
    """Composite control: computed torque for slow joint motion, damping for fast link vibration."""

    kind: Literal["composite"] = "composite"
    posture: Posture = None
    bandwidth: OneOrMany[Positive] = Field(
        default=4.0, description="Of the joint errors, one for all joints or one each (rad/s)."
    )
    damping_ratio: OneOrMany[Positive] = Field(
        default=1.0, description="Of the joint errors, one for all joints or one each."
    )
    acceptable: Named[OneOrMany[Positive]] | None = Field(
        default=None,
        description="Outputs that bending alone decides and the deviation of each that counts as "
        "much as the others'; 10 mm of link_tip_deflection and 0.1 m/s of "
        "link_tip_deflection_rate where left out.",
    )
    acceptable_torque: AcceptableTorque = None
    schedule: Schedule = None
    measured: Measured = None
    disturbance: Disturbance = None
    recovery: Recovery = 0.0
    rigidity_uncertainty: RigidityUncertainty = 0.0
    torque_limit: TorqueLimit = None
    sample_time: SampleTime = 0.001

    per_joint: ClassVar[tuple[str, ...]] = (*LQGDrive.per_joint, "bandwidth", "damping_ratio")
