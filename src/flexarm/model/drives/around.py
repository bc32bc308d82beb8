"""Controllers that contain another one, which is described by a drive inside the drive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from flexarm.model.checks import Given, Record
from flexarm.model.drives.base import (
    ControllerParameters,
    Parameters,
    drive_of,
    parameters_of,
    record_of,
)
from flexarm.model.drives.controllers import ALONE, GROUPS, one_of
from flexarm.model.hardware import Instrument
from flexarm.model.quantities import (
    Count,
    Finite,
    Fraction,
    Listed,
    ListPerJoint,
    Mapped,
    NonNegative,
    Number,
    PerJoint,
    Positive,
    Typed,
    plain,
)
from flexarm.model.wording import Fault

_Damping = Annotated[Finite, Field(gt=0, lt=1), BeforeValidator(plain)]


class DisturbanceObserverParameters(ControllerParameters):
    """Disturbance observer: subtracts torques that the rigid model does not explain.

    The corrected torques are those of an inner controller.
    """

    name = "disturbance_observer"
    inner: Annotated[Any, Typed(one_of(ALONE))]
    """The controller whose torque is corrected; both have the same sample time."""
    cutoff: Annotated[Any, PerJoint(Positive)] | None = None
    """Cutoff of the filter of the estimate, one for all joints or one for each (Hz). It should be
    below the lowest frequency of the links, because bending acts as a disturbance, too; by default
    it is half of that frequency of the straight arm with locked joints, but at most 0.005 of the
    sampling frequency."""
    compensation: Fraction = 1.0
    """Fraction of the estimate that is subtracted from the torque; 0 observes only."""
    _: KW_ONLY
    actuated: Annotated[Any, Typed(Listed[Count] | None)] = None
    """Numbers of the joints with a motor in a mechanism with closures; by default all."""


class RepetitiveParameters(ControllerParameters):
    """Repetitive control: learns the torque of a periodic motion or disturbance in every period.

    The learned torque is added to that of an inner controller.
    """

    name = "repetitive"
    inner: Annotated[Any, Typed(one_of(ALONE))]
    """The controller to whose torque the learned one is added; both have the same sample time."""
    period: Positive
    """Period of the motion or the disturbance, a multiple of the sample time (s)."""
    proportional: Annotated[Any, PerJoint(NonNegative)]
    """Learned torque per angle error of the last period, one for all joints or one for each, such
    as half of the gain of the inner controller (N m/rad)."""
    derivative: Annotated[Any, PerJoint(NonNegative)] = 0.0
    """Learned torque per rate error, likewise (N m s/rad)."""
    cutoff: Annotated[Any, Typed(Positive | None)] = None
    """Cutoff of the filter of the learned torque, which has no phase shift; it should be below the
    frequency at which the motion opposes the torque (Hz). By default 10 divided by the period: ten
    harmonics are learned."""
    lead: NonNegative = 0.0
    """Time by which the learned torque precedes the error; about the delay of the closed loop
    (s)."""


class FilterParameters(Parameters):
    """A Kalman filter for the bending of the arm and its payload."""

    instruments: Annotated[Any, Typed(Listed[Instrument] | None)] = None
    """Instruments of the filter; by default those of the hardware."""
    torque_noise: Annotated[Any, PerJoint(NonNegative)] | None = None
    """Standard deviation of a random torque error in each sample, one for all joints or one for
    each: it represents all errors of the model (N m); by default 1 % of the acceptable torque of
    `LQG`."""
    payload_deviation: NonNegative = 0.0
    """Standard deviation of the payload mass, 0 for a known payload (kg). A large value raises the
    initial mean, because masses are not negative."""
    payload_drift: NonNegative = 0.0
    """Intensity of a random walk of the payload mass (kg/s^0.5)."""
    rate_deviation: NonNegative | None = None
    """Standard deviation of the initial joint rates (rad/s); for sliding joints it is multiplied by
    the reach; by default 1/80 of the arm's typical rate. This rate is the lowest angular frequency
    of the straight arm with locked joints, but at most 0.08 rad in a sample time; 0.0064 rad in one
    for rigid arms."""
    energy_deviation: NonNegative | None = None
    """Expected initial energy of vibration in each mode (J); by default that of the rigid arm that
    turns by 1/80 of the typical rate about its first joint."""
    _: KW_ONLY
    parameters: Mapped[Positive] | None = None
    """Standard deviations of further uncertain numbers of the arm, by paths such as
    joints[0].friction.coulomb, in their units; the arm has their means. Numbers of joints, payload,
    gravity, damping, and rigidities of whole links."""
    parameter_drift: Mapped[NonNegative] | None = None
    """Intensities of random walks of these numbers, by path (unit/s^0.5); those that are not listed
    are constant."""
    disturbance_deviation: Annotated[Any, PerJoint(NonNegative)] = 0.0
    """Standard deviation of the initial disturbance torques of the joints, one for all joints or
    one for each; they are estimated if this or their drift is not 0 (N m)."""
    disturbance_drift: Annotated[Any, PerJoint(NonNegative)] = 0.0
    """Intensity of a random walk of the disturbance torques, one for all joints or one for each (N
    m/s^0.5)."""
    bias_deviation: Mapped[NonNegative] | None = None
    """Standard deviations of constant errors of instruments, by the name of the reading, in its
    unit; each error is estimated."""
    bias_drift: Mapped[NonNegative] | None = None
    """Intensities of random walks of these errors, likewise (unit/s^0.5)."""


class MovingHorizonParameters(FilterParameters):
    """A moving-horizon estimator for the bending of the arm and its payload."""

    _: KW_ONLY
    horizon: Count = 20
    """Number of samples that are estimated again at each sample."""
    lower_bounds: Mapped[Number] | None = None
    """Lower bounds by payload.mass (0 by default), paths of parameters, and disturbance for the
    torques of all joints."""
    upper_bounds: Mapped[Number] | None = None
    """Upper bounds, likewise; none by default."""


#: Keys of files that only a moving-horizon estimator has.
_OF_HORIZON = ("horizon", "lower_bounds", "upper_bounds")


class _FilterRecord(Record):
    """Base of the record of a filter in a file."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.raw("kind") != "moving_horizon":
            for key in _OF_HORIZON:
                # JSON of a record contains the defaults.
                if given.raw(key) not in (None, cls.model_fields[key].default):
                    yield Fault((key,), "requires kind: moving_horizon")


_KIND = Field(default="extended", description="Kind of the filter.")
FilterSpec = record_of(
    "FilterSpec",
    FilterParameters.__doc__ or "",
    parameters_of(MovingHorizonParameters),
    _FilterRecord,
    kind=(Literal["extended", "unscented", "moving_horizon"], _KIND),
)
_OBSERVED = drive_of(DisturbanceObserverParameters)
_REPETITIVE = drive_of(RepetitiveParameters)
_LINEAR = GROUPS["linear models of the flexible arm"]
_OF_JOINTS = (
    *GROUPS["joint control"],
    *GROUPS["uncertain arms"],
    *(drive for drive in _LINEAR if not drive.declaration.plans_bending),
)
#: Names of the controllers of the joint angles, which do not plan the bending.
JOINT_CONTROLLERS = tuple(drive.declaration.name for drive in _OF_JOINTS)


class StrainDampingParameters(ControllerParameters):
    """Parameters of controllers that damp vibration by strain feedback around a joint loop."""

    inner: Annotated[Any, Typed(one_of(_OF_JOINTS))]
    """The controller of the joint angles; both have the same sample time."""
    damping_ratio: _Damping = 0.3
    """Damping ratio of the modes for joints that follow their reference exactly; above 0 and below
    1."""
    modes: Count = 1
    """Number of lowest modes with locked joints to damp; at most one for each joint and each
    gauge."""
    posture: Annotated[Any, ListPerJoint(Number)] | None = None
    """Joint angles of the design; zero by default (rad)."""


class PositivePositionFeedbackParameters(StrainDampingParameters):
    """Positive position feedback: resonant filters of the strains move the joints of an inner loop.

    Higher modes are hardly affected.
    """

    name = "positive_position_feedback"


class IntegralResonantControlParameters(StrainDampingParameters):
    """Integral resonant control: integrals of the strains move the joints of an inner loop."""

    name = "integral_resonant_control"


class WaveBasedControlParameters(StrainDampingParameters):
    """Wave-based control: the joints absorb the waves that return from the links.

    They move the reference of an inner loop.
    """

    name = "wave_based_control"
    damping_ratio: _Damping = 0.5
    """Damping ratio of the modes for joints that follow their reference exactly; above 0 and below
    1."""
    leakage: NonNegative = 0.2
    """Decay rate of the motion of the joints, relative to the angular frequency of the mode, so
    that constant strains that the model does not explain turn them by a limited angle."""


class OutputRedefinitionParameters(StrainDampingParameters):
    """Output redefinition: an inner loop controls angles to the tips of the links.

    Or to points between joints and tips, or on the other side: the reflected tip.
    """

    name = "output_redefinition"
    damping_ratio: ClassVar[None] = None  # type: ignore[misc, assignment]
    modes: Count | None = None  # type: ignore[assignment]
    """Number of lowest modes with locked joints whose bending the gauges determine; by default as
    many as there are gauges."""
    weight: Number = 1.0
    """Fraction of the rotation of the chord of each link by its bending that is added to the joint
    angle: 0 for the joint angle, 1 for the tip, -1 for the reflected tip."""
    cutoff: Positive | None = None
    """Cutoff of the low-pass filter of these rotations; by default a twentieth of the lowest
    frequency with locked joints (Hz)."""


class EstimatorParameters(ControllerParameters):
    """An inner controller whose measurement is the estimate of a Kalman filter."""

    name = "estimator"
    estimator: Annotated[Any, Typed(FilterSpec)] = FilterSpec()
    """The filter; it has the sample time of the controller."""
    inner: Annotated[Any, Typed(one_of((*ALONE, _OBSERVED)))]  # type: ignore[misc]
    """The controller that receives the estimate."""
    compensation: Fraction = 1.0
    """Fraction of the estimated disturbance torques that is subtracted from the torque of the inner
    controller."""


#: Controllers that contain another one.
AROUND = (
    _OBSERVED,
    _REPETITIVE,
    drive_of(EstimatorParameters),
    drive_of(PositivePositionFeedbackParameters),
    drive_of(IntegralResonantControlParameters),
    drive_of(WaveBasedControlParameters),
    drive_of(OutputRedefinitionParameters),
)
