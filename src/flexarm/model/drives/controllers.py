"""Controllers of files: parameters, and the registry, to which a new controller is added.

Those designed on linear models are in `flexarm.model.drives.linear`, those that contain another
controller in `flexarm.model.drives.around`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY
from itertools import chain
from typing import Annotated, Any, Literal, Union

from pydantic import BeforeValidator, Field

from flexarm.model.checks import Given
from flexarm.model.drives.base import (
    ControllerDrive,
    ControllerParameters,
    Derivative,
    FeedforwardKind,
    Proportional,
    SampleTime,
    drive_of,
)
from flexarm.model.drives.linear import (
    CompositeKeys,
    LoopShapingKeys,
    LQGKeys,
    MPCKeys,
    MuSynthesisParameters,
    NonlinearMPCParameters,
)
from flexarm.model.quantities import (
    Count,
    Finite,
    Flag,
    Interval,
    Listed,
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
from flexarm.model.wording import Fault


class JointPDParameters(ControllerParameters):
    """Joint PD control: a proportional-derivative controller at each joint along the motion."""

    name = "joint_pd"
    takes_feedforward = True
    proportional: Proportional
    derivative: Derivative
    sample_time: SampleTime = 0.001


class JointPIDParameters(ControllerParameters):
    """Joint PID control along the motion, with optional gravity compensation."""

    name = "joint_pid"
    takes_feedforward = True
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
    """Torque limit (N m), one for all joints or one for each; no limit by default. Simulations
    reduce it to that of the motors."""

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
    actuated: Annotated[Any, Typed(Listed[Count] | None)] = None
    """Numbers of the joints with a motor in a mechanism with closures; by default all."""
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
    takes_feedforward = True
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


#: Numbers that the controller derives from its arm if they are None.
_OfArm = Annotated[Any, Typed(NonNegative | None)]
_PositiveOfArm = Annotated[Any, Typed(Positive | None)]
_Delay = Annotated[
    NonNegative,
    Field(
        description="Delay of the loop by motors, instruments and the filter of the joint rates, "
        "to which the default gains are adapted (s)."
    ),
]


class HybridForceParameters(ControllerParameters):
    """Hybrid control: position along a surface, force normal to it.

    Defaults are relative to the arm: to the rate w, its lowest angular frequency, straight with
    locked joints, but at most 0.0064 rad in a sample time, and with a delay less than 0.1 rad in
    it; to its reach L; and to the force F at the reach that accelerates the straight rigid arm
    about its first joint by w^2 / 4.
    """

    name = "hybrid_force"
    frequency: _PositiveOfArm = None
    """Natural frequency of the error along the surface (rad/s); by default 1.25 w."""
    damping_ratio: NonNegative = 1.0
    """Damping ratio of that error."""
    path_integral: _OfArm = None
    """Integral gain of that error; it compensates unmodelled friction within about its inverse
    (1/s); by default 0.32 w."""
    force_integral: _OfArm = None
    """Integral gain of the force error: the bandwidth of the force control, which should be below
    the lowest frequency of the arm in contact (1/s); by default 1.6 w."""
    force_proportional: NonNegative = 0.0
    """Proportional gain of the force error."""
    normal_damping: _OfArm = None
    """Force per speed of the tip normal to the surface (N s/m); by default 16 F / (L w)."""
    approach_speed: _PositiveOfArm = None
    """Speed of approach without contact (m/s); by default 0.0066 L w."""
    touch_force: _OfArm = None
    """Measured force below which there is no contact (N); by default a tenth of the requested
    force."""
    delay: _Delay = 0.0
    sample_time: SampleTime = 0.001


class AdaptiveForceParameters(HybridForceParameters):
    """Hybrid control that adapts to the stiffness, position and friction of the surface."""

    name = "adaptive_force"
    adaptation: _OfArm = None
    """Adaptation gain for stiffness and slope of the surface: the integral gain of the force error
    if force rate and speed have their nominal values (1/s); by default 0.32 w."""
    friction_adaptation: _OfArm = None
    """Rate at which the friction of the surface is estimated at ``nominal_force`` (1/s); by default
    0.16 w."""
    nominal_force: _PositiveOfArm = None
    """Typical force on the surface, and typical change of the force in a time of 2 pi / w (N); by
    default F / 4."""
    nominal_speed: _PositiveOfArm = None
    """Typical speed along the surface, at which the tip certainly slides (m/s); by default
    0.0066 L w."""
    release_time: _OfArm = None
    """Time without a measured force after which the contact counts as lost (s); by default
    0.32 / w."""
    sample_time: SampleTime = 0.001


class NeuralForceParameters(AdaptiveForceParameters):
    """Adaptive force control with a network that learns a surface of unknown shape."""

    name = "neural_force"
    learning: _OfArm = None
    """Adaptation gain of the weights (1/s); by default 1.9 w."""
    features: Count = 40
    """Number of random features of the network."""
    feature_length: _PositiveOfArm = None
    """Distance along the surface over which its shape varies (m); by default 0.04 L."""
    leakage: NonNegative = 0.0
    """Decay rate of the weights (1/s)."""
    e_modification: NonNegative = 0.0
    """Decay rate of the weights per force error (1/(N s))."""
    seed: Count = 1
    """Seed of the random features."""
    sample_time: SampleTime = 0.001


class ImpedanceParameters(ControllerParameters):
    """Impedance control: the tip acts as a spring and a damper towards its path.

    Defaults are relative to the rate w, reach L and force F of the arm, as for `hybrid_force`.
    """

    name = "impedance"
    tangent_stiffness: _OfArm = None
    """Force per distance along the surface (N/m); by default 7.6 F / L."""
    tangent_damping: _OfArm = None
    """Force per speed along the surface (N s/m); by default 6.4 F / (L w)."""
    normal_stiffness: _OfArm = None
    """Force per distance normal to the surface (N/m); by default 2.5 F / L."""
    normal_damping: _OfArm = None
    """Force per speed normal to the surface (N s/m); by default 8 F / (L w)."""
    force_proportional: NonNegative = 0.0
    """Proportional gain of the force error."""
    force_integral: NonNegative = 0.0
    """Integral gain of the force error (1/s)."""
    posture_frequency: _OfArm = None
    """Natural frequency of the posture error of arms with more than two joints, and of all joint
    errors along a motion without force (rad/s); by default 0.8 w."""
    delay: _Delay = 0.0
    sample_time: SampleTime = 0.001


class AdmittanceParameters(ControllerParameters):
    """Admittance control: the measured force moves the reference of a stiff position loop.

    Defaults are relative to the rate w, reach L and force F of the arm, as for `hybrid_force`.
    """

    name = "admittance"
    damping: _PositiveOfArm = None
    """Force error per speed of the reference; the bandwidth is the stiffness of surface and arm in
    series divided by it (N s/m); by default 120 F / (L w)."""
    stiffness: NonNegative = 0.0
    """Stiffness of the spring that moves the reference back (N/m)."""
    frequency: _PositiveOfArm = None
    """Natural frequency of the position loop (rad/s); by default 1.25 w."""
    damping_ratio: NonNegative = 0.7
    """Damping ratio of the position loop."""
    most_speed: _PositiveOfArm = None
    """Largest speed of the reference relative to the motion, and so of the approach without contact
    (m/s); by default 0.0066 L w."""
    delay: _Delay = 0.0
    sample_time: SampleTime = 0.001


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
    takes_feedforward = True
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


_DECLARED: dict[str, tuple[type[ControllerParameters], ...]] = {
    "joint control": (
        JointPDParameters,
        JointPIDKeys,
        ComputedTorqueKeys,
        StrainFeedbackParameters,
    ),
    "linear models of the flexible arm": (
        LQGKeys,
        MPCKeys,
        NonlinearMPCParameters,
        CompositeKeys,
        LoopShapingKeys,
        MuSynthesisParameters,
    ),
    "uncertain arms": (
        AdaptiveParameters,
        SlidingModeParameters,
        RBFAdaptiveParameters,
        PrescribedPerformanceParameters,
    ),
    "tip position and contact force": (
        HybridForceParameters,
        ImpedanceParameters,
        AdmittanceParameters,
        AdaptiveForceParameters,
        NeuralForceParameters,
    ),
}
#: Controllers except those that contain another one, by the title of their group in lists.
GROUPS: dict[str, tuple[type[ControllerDrive], ...]] = {
    title: tuple(map(drive_of, declared)) for title, declared in _DECLARED.items()
}
ALONE: tuple[type[ControllerDrive], ...] = tuple(chain(*GROUPS.values()))


def one_of(records: Sequence[type]) -> Any:
    """Return the type of a value that is one of several records, distinguished by ``kind``."""
    return Annotated[Union[tuple(records)], Field(discriminator="kind")]  # noqa: UP007
