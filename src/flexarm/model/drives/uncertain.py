"""Controllers for uncertain arms: adaptive, sliding-mode, and radial-basis-function networks."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from flexarm.model.drives.base import (
    Bandwidth,
    ControllerDrive,
    SampleTime,
    StrainGain,
    Washout,
)
from flexarm.model.quantities import (
    Count,
    Flag,
    Named,
    NonNegative,
    Number,
    OneOrMany,
    Pair,
    Positive,
    Word,
)

Damping = Annotated[
    OneOrMany[NonNegative],
    Field(description="Torque per error of rate, one for all joints or one each (N m s/rad)."),
]


class AdaptiveDrive(ControllerDrive):
    """Adaptive control: computed torque of a rigid model whose parameters are estimated online."""

    kind: Literal["adaptive"] = "adaptive"
    bandwidth: Bandwidth
    damping: Damping
    adaptation: OneOrMany[NonNegative] = Field(
        description="How fast parameters move, one for all or one each: the parameter's unit "
        "squared per (N m rad)."
    )
    parameters: OneOrMany[Word] = Field(
        default="payload",
        description="What is learned: payload, links or friction, or a list of names such as "
        "payload.mass, link_2.inertia, joint_1.coulomb.",
    )
    bounds: Named[Pair] | None = Field(
        default=None,
        description="Lowest and largest value of parameters by name; at least 0 where left out.",
    )
    initial: Named[NonNegative] | None = Field(
        default=None, description="Values to begin with in place of the arm's, by name."
    )
    leakage: NonNegative = Field(
        default=0.0, description="Pulls estimates back to where they began (1/s)."
    )
    dead_zone: NonNegative = Field(
        default=0.0, description="Error of rate below which nothing is learned (rad/s)."
    )
    strain_gain: StrainGain = 0.0
    washout: Washout = 0.5
    sample_time: SampleTime = 0.001

    per_joint: ClassVar[tuple[str, ...]] = ("bandwidth", "damping", "strain_gain")


class SlidingModeDrive(ControllerDrive):
    """Sliding-mode control: torque of the rigid model plus a robust switching torque."""

    kind: Literal["sliding_mode"] = "sliding_mode"
    bandwidth: Bandwidth
    boundary_layer: OneOrMany[Positive] = Field(
        description="Error of rate within which the torque does not switch, one for all joints or "
        "one each (rad/s)."
    )
    uncertainty: Named[NonNegative] | None = Field(
        default=None,
        description="Largest error of parameters, by names such as payload.mass or link_2.mass.",
    )
    disturbance: OneOrMany[NonNegative] = Field(
        default=0.0,
        description="What else may push, at most, one for all joints or one each (N m).",
    )
    reaching: OneOrMany[Positive] = Field(
        default=0.1,
        description="Switching torque beyond the bounds, one for all joints or one each (N m).",
    )
    damping: Damping = 0.0
    strain_gain: StrainGain = 0.0
    washout: Washout = 0.5
    sample_time: SampleTime = 0.001

    per_joint: ClassVar[tuple[str, ...]] = (
        "bandwidth",
        "boundary_layer",
        "disturbance",
        "reaching",
        "damping",
        "strain_gain",
    )


class RBFAdaptiveDrive(ControllerDrive):
    """Adaptive control by a network of radial basis functions that learns the required torque."""

    kind: Literal["rbf_adaptive"] = "rbf_adaptive"
    bandwidth: Bandwidth
    damping: Damping
    adaptation: Positive = Field(description="How fast the network learns.")
    lower: OneOrMany[Number] = Field(
        description="Smallest joint angle of the motion, one for all joints or one each (rad)."
    )
    upper: OneOrMany[Number] = Field(
        description="Largest joint angle of the motion, one for all joints or one each (rad)."
    )
    centres: OneOrMany[Count] = Field(
        default=5,
        description="Gaussians along each joint angle, one number for all joints or one each; 1 "
        "for a joint whose angle changes nothing.",
    )
    leakage: NonNegative = Field(default=0.0, description="Forgets what was learned (1/s).")
    e_modification: NonNegative = Field(
        default=0.01, description="Forgets it the faster, the larger the error of rate (1/rad)."
    )
    prior: Flag = Field(
        default=False,
        description="Whether the arm's rigid model is added, so that the network learns the rest.",
    )
    strain_gain: StrainGain = 0.0
    washout: Washout = 0.5
    sample_time: SampleTime = 0.001

    per_joint: ClassVar[tuple[str, ...]] = (
        "bandwidth",
        "damping",
        "lower",
        "upper",
        "centres",
        "strain_gain",
    )
