"""Controllers for uncertain arms: adaptive, sliding-mode, and radial-basis-function networks."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from flexarm.model.drives.base import ControllerParameters, Feedforward, SampleTime
from flexarm.model.quantities import (
    Count,
    Finite,
    Flag,
    Interval,
    Mapped,
    NonNegative,
    Number,
    OneOrEach,
    OneOrMany,
    PerJoint,
    Positive,
    Typed,
    Word,
    plain,
)

Bandwidth = Annotated[
    Any,
    PerJoint(Positive),
    Field(description="Decay rate of angle errors, one for all joints or one for each (1/s)."),
]
Damping = Annotated[
    Any,
    PerJoint(NonNegative),
    Field(description="Torque per rate error (N m s/rad), one for all joints or one for each."),
]
StrainGain = Annotated[
    Any,
    PerJoint(NonNegative),
    Field(
        description=(
            "Joint rate per curvature at the root of the link (rad/s per 1/m). It damps "
            "vibration and requires a gauge on that link."
        )
    ),
]
Washout = Annotated[
    Any,
    Typed(Positive | None),
    Field(
        description=(
            "Cutoff of the high-pass filter of the curvature (Hz); by default half of the lowest "
            "frequency of the straight arm with locked joints, but at most 0.005 of the sampling "
            "frequency."
        )
    ),
]


class AdaptiveParameters(ControllerParameters):
    """Adaptive control: computed torque of a rigid model whose parameters are estimated online."""

    name = "adaptive"
    bandwidth: Bandwidth
    damping: Damping
    adaptation: Annotated[Any, OneOrEach(NonNegative)]
    """Adaptation gains, one for all parameters or one for each, in the unit of the parameter
    squared per N m rad."""
    # Typed, because pydantic before 2.12 loses the tags of a union in a record that is made twice.
    parameters: Annotated[Any, Typed(OneOrMany[Word])] = "payload"
    """Parameters to adapt: payload (its mass), links (mass, first moment and inertia of each) or
    friction (viscous and Coulomb of each joint), or a list of names such as payload.mass,
    link_2.inertia, joint_1.coulomb."""
    bounds: Mapped[Interval] | None = None
    """Lower and upper bound of parameters by name; by default at least 0."""
    initial: Mapped[NonNegative] | None = None
    """Initial estimates by name, in place of the values of the arm."""
    leakage: NonNegative = 0.0
    """Decay rate of the estimates to their initial values: sigma modification (1/s)."""
    dead_zone: NonNegative = 0.0
    """Norm of the rate errors below which the estimates are constant (rad/s)."""
    strain_gain: StrainGain = 0.0
    washout: Washout = None
    sample_time: SampleTime = 0.001


class SlidingModeParameters(ControllerParameters):
    """Sliding-mode control: torque of the rigid model plus a robust switching torque."""

    name = "sliding_mode"
    bandwidth: Bandwidth
    boundary_layer: Annotated[Any, PerJoint(Positive)]
    """Rate error below which the torque is continuous (rad/s), one for all joints or one for
    each."""
    uncertainty: Mapped[NonNegative] | None = None
    """Largest error of parameters, by names such as payload.mass or link_2.mass."""
    disturbance: Annotated[Any, PerJoint(NonNegative)] = 0.0
    """Bound of other disturbance torques, one for all joints or one for each (N m)."""
    reaching: Annotated[Any, PerJoint(Positive)] | None = None
    """Excess of the switching torque over the bounds, one for all joints or one for each (N m); by
    default 1 % of the torque that accelerates the joint of the straight rigid arm by w^2 / 4; w is
    the lowest angular frequency with locked joints, but at most 0.0064 rad in a sample time."""
    damping: Damping = 0.0
    strain_gain: StrainGain = 0.0
    washout: Washout = None
    sample_time: SampleTime = 0.001


class RBFAdaptiveParameters(ControllerParameters):
    """Adaptive control by a network of radial basis functions that learns the required torque."""

    name = "rbf_adaptive"
    bandwidth: Bandwidth
    damping: Damping
    adaptation: Positive
    """Adaptation gain of the weights."""
    lower: Annotated[Any, PerJoint(Number)]
    """Smallest joint angle of the motion (rad), one for all joints or one for each."""
    upper: Annotated[Any, PerJoint(Number)]
    """Largest joint angle of the motion (rad), one for all joints or one for each."""
    centres: Annotated[Any, PerJoint(Count)] = 5
    """Gaussians along each joint angle, one number for all joints or one for each; 1 for a joint
    whose angle does not affect the dynamics, such as the first one without gravity. Their width is
    their spacing."""
    leakage: NonNegative = 0.0
    """Decay rate of the weights: sigma modification (1/s)."""
    e_modification: NonNegative = 0.01
    """Decay rate of the weights per norm of the rate errors (1/rad)."""
    prior: Flag = False
    """Whether to add the torque of the arm's rigid model, so that the network learns the
    remainder."""
    strain_gain: StrainGain = 0.0
    washout: Washout = None
    sample_time: SampleTime = 0.001


class PrescribedPerformanceParameters(ControllerParameters):
    """Prescribed performance: angle errors stay within bounds that decrease with time.

    The gains need no model and grow without limit towards the bounds.
    """

    name = "prescribed_performance"
    bandwidth: Bandwidth
    damping: Damping
    bound: Annotated[Any, PerJoint(Positive)]
    """Bound of the angle error after a long time (rad), one for all joints or one for each."""
    rate_bound: Annotated[Any, PerJoint(Positive)]
    """Bound of the difference between the joint rate and the requested rate (rad/s), one for all
    joints or one for each."""
    start_bound: Annotated[Any, PerJoint(Positive)] | None = None
    """Bound of the angle error at the start, which must exceed the first error (rad); that after a
    long time by default."""
    decay: Annotated[Any, Typed(NonNegative | None)] = None
    """Rate at which the bound of the angle error decreases (1/s); by default an eighth of the least
    bandwidth."""
    gain_limit: Annotated[Finite, Field(ge=1.01, le=1e6), BeforeValidator(plain)] = 20.0
    """Factor up to which the gains increase towards the bounds; the sampled loop must be stable
    with ``damping`` times this factor."""
    sample_time: SampleTime = 0.001


class PrescribedPerformanceKeys(PrescribedPerformanceParameters):
    """Keys of the drive `prescribed_performance`."""

    feedforward: Feedforward = None
