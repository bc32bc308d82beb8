"""Controllers designed on linear models of the flexible arm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Discriminator, Field, Tag

from flexarm.model.drives.base import ControllerParameters, SampleTime
from flexarm.model.quantities import (
    Count,
    Finite,
    Flag,
    Fraction,
    Listed,
    ListPerJoint,
    Named,
    NonNegative,
    Number,
    OneOrEach,
    PerJoint,
    Positive,
    Typed,
    Word,
    plain,
)


def _flag_word_or_names(value: Any) -> str:
    if isinstance(value, Mapping):
        return "<names>"
    return "<word>" if isinstance(value, str) else "<flag>"


_PositiveNumbers = Annotated[Any, OneOrEach(Positive)]
_Integral = Annotated[
    Annotated[Flag, Tag("<flag>")]
    | Annotated[Word, Tag("<word>")]
    | Annotated[Named[_PositiveNumbers], Tag("<names>")],
    Discriminator(_flag_word_or_names),
]
_NamedIntegral = Annotated[
    Annotated[Flag, Tag("<flag>")] | Annotated[Word, Tag("<word>")],
    Discriminator(lambda value: "<word>" if isinstance(value, str) else "<flag>"),
]
# Beyond the upper bound rounding errors dominate a design.
_Robustness = Annotated[Finite, Field(ge=0, le=1e6), BeforeValidator(plain)]
# At 1 the matrix L of (C.144) is singular.
_Suboptimality = Annotated[Finite, Field(ge=1.001, le=100), BeforeValidator(plain)]
_Horizon = Annotated[
    int,
    Field(strict=True, ge=1, le=500, description="Prediction horizon in samples."),
    BeforeValidator(plain),
]


class LinearParameters(ControllerParameters):
    """Parameters of all controllers that are designed on linear models of the flexible arm."""

    plans_bending = True
    posture: Annotated[Any, ListPerJoint(Number)] | None = None
    """Joint angles of the design; zero by default (rad)."""
    _: KW_ONLY
    schedule: Annotated[Any, ListPerJoint(Listed[Number] | None)] | None = None
    """For each joint nothing, or increasing angles: designs on the grid of these angles, between
    which gains are interpolated (rad)."""
    acceptable_torque: Annotated[Any, PerJoint(Positive)] | None = None
    """Acceptable torque, one for all joints or one for each (N m); by default the torque that
    accelerates each joint of the rigid model by a quarter of the square of the arm's typical rate:
    the lowest angular frequency of the straight arm with locked joints, but at most 0.08 rad in a
    sample time; 0.0064 rad in one for rigid arms. Accelerations, deviations and noise of sliding
    joints are by default multiplied by the length of the arm."""
    measured: Named[_PositiveNumbers] | None = None
    """Measured signals (joint_angle, joint_rate, strain, tip) and the standard deviations of their
    noise; by default 0.1 mrad of joint_angle, and 2e-5 of strain if the arm has gauges, and the
    hardware of the design, if given, an instrument of them."""
    disturbance: Named[_PositiveNumbers] | None = None
    """Inputs that act as unmeasured disturbances, such as torque and tip_force, and their standard
    deviations; by default a tenth of the acceptable torque, and as tip_force a fifth of the largest
    one divided by the length of the arm."""
    recovery: _Robustness = 0.0
    """Loop-transfer recovery: fictitious torque noise of the filter, relative to acceptable_torque.
    A larger value brings the margins closer to those of a regulator that measures the whole state,
    and amplifies noise (Doyle and Stein 1981)."""
    rigidity_uncertainty: Fraction = 0.0
    """Relative error of the stiffness of the links for which the design is robust, at most 1, such
    as 0.3: elastic forces of this relative size are noise of the filter, and the regulator damps
    vibrations more (Tahk and Speyer 1987)."""
    delay: NonNegative = 0.0
    """Delay of the loop by motors and instruments for which the design is made, in whole samples:
    the state is predicted over it (s)."""
    torque_limit: Annotated[Any, PerJoint(Positive)] | None = None
    """Largest requested torque, one for all joints or one for each (N m); no limit by default.
    Simulations reduce it to that of the motors."""
    sample_time: SampleTime = 0.001


class LQGParameters(LinearParameters):
    """LQG: state feedback of the flexible arm by a linear-quadratic regulator and Kalman filter."""

    name = "lqg"
    _: KW_ONLY
    actuated: Annotated[Any, Typed(Listed[Count] | None)] = None
    """Numbers of the joints with a motor; by default all."""
    acceptable: Named[_PositiveNumbers] | None = None
    """Acceptable deviations of outputs of linear models by name, which determine the weights
    (Bryson's rule); by default 10 mrad of joint_angle, 0.4 % of the length of the arm of tip, and
    0.032 times the typical rate of joint_rate."""
    integral: _Integral | None = None
    """Integral feedback: true for the joint angles; or the name of an output, joint_angle, tip
    (which must be measured) or chord_angle (of the lines between joints and to the tip, by the
    strains: it returns the tip under an unknown payload); or a mapping from this name to its
    acceptable integral (rad s, m s)."""
    preview: NonNegative | None = None
    """Span of the reference that the preview uses, at most 60,000 samples (s); by default 3.2
    divided by the typical rate."""


class MPCParameters(LQGParameters):
    """MPC: the regulator of `lqg` with limits of torque and torque rate."""

    name = "mpc"
    _: KW_ONLY
    delay: ClassVar[float] = 0.0  # type: ignore[misc]
    torque_limit: Annotated[Any, PerJoint(Positive)]
    """Torque limit (N m), one for all joints or one for each."""
    torque_rate: Annotated[Any, PerJoint(Positive)] | None = None
    """Largest rate of change of torques from sample to sample, one for all joints or one for each
    (N m/s); no limit by default."""
    horizon: _Horizon = 40
    sample_time: SampleTime = 0.005


class NonlinearMPCParameters(MPCParameters):
    """Nonlinear MPC: as `mpc`, with the nonlinear dynamics of the arm as prediction model."""

    name = "nonlinear_mpc"
    _: KW_ONLY
    horizon: _Horizon = 20
    modes: Count | None = None
    """Number of modes of each link (of each segment) in the model of the controller; links with
    fewer modes keep theirs. By default those of the arm."""
    iterations: Count = 1
    """Number of times at each sample that the prediction is linearised and the torques are
    optimised; 1 for real-time iterations."""
    sample_time: SampleTime = 0.01


class CompositeParameters(LinearParameters):
    """Composite control: computed torque for slow joint motion, damping for fast link vibration."""

    name = "composite"
    _: KW_ONLY
    bandwidth: Annotated[Any, PerJoint(Positive)] | None = None
    """Bandwidth of the joint errors, one for all joints or one for each (rad/s); by default 0.64
    times the typical rate, halved until the loop with the model is stable."""
    damping_ratio: Annotated[Any, PerJoint(Positive)] = 1.0
    """Damping ratio of the joint errors, one for all joints or one for each."""
    recovery: _Robustness = 1.0
    """Loop-transfer recovery: fictitious torque noise of the filter, relative to acceptable_torque.
    Without it the loop is unstable near the posture of the design on many arms."""
    rigidity_uncertainty: Fraction = 1.0
    """Relative error of the stiffness of the links for which the design is robust, at most 1:
    elastic forces of this relative size are noise of the filter, and the regulator damps vibrations
    more. The slow part cancels inertial coupling, which changes with the posture."""
    integral: Annotated[Any, Typed(_NamedIntegral | None)] = None
    """Integral feedback: true for the joint angles, or the name joint_angle or chord_angle as for
    `lqg`; it removes constant errors, such as those by an unknown payload, at 0.3 times the
    bandwidth. By default true under gravity."""
    acceptable: Named[_PositiveNumbers] | None = None
    """Acceptable deviations of outputs that depend on bending only, by name; by default 0.4 % of
    the length of the arm of link_tip_deflection, and of link_tip_deflection_rate 1.6 times this
    times the typical rate."""


class _HardwareKeys(ControllerParameters):
    """Key of the drives whose design may include the hardware of the scenario."""

    hardware: Annotated[Any, Typed(Flag | None)] = None
    """Whether the motors and instruments of the scenario are part of the design: their delays, lag
    and filtered rates are states of its model. Cannot be combined with delay."""


class LQGKeys(_HardwareKeys, LQGParameters):
    """Keys of the drive `lqg`."""


class MPCKeys(_HardwareKeys, MPCParameters):
    """Keys of the drive `mpc`."""


class CompositeKeys(_HardwareKeys, CompositeParameters):
    """Keys of the drive `composite`."""


class RobustParameters(ControllerParameters):
    """Parameters of the robust controllers of joint angles and rates."""

    takes_feedforward = True
    posture: Annotated[Any, ListPerJoint(Number)] | None = None
    """Joint angles of the design; zero by default (rad)."""
    bandwidth: Annotated[Any, PerJoint(Positive)] | None = None
    """Crossover frequency of the loops of the rigid arm, approximately, one for all joints or one
    for each (rad/s); by default 1.25 times the typical rate of `lqg`."""


class LoopShapingParameters(RobustParameters):
    """H-infinity loop shaping: robust feedback of joint angles and rates."""

    name = "loop_shaping"
    _: KW_ONLY
    integral: Annotated[Any, PerJoint(NonNegative)] = 0.0
    """Frequency below which the feedback is integral, one for all joints or one for each; 0 for
    none, otherwise a tenth of the bandwidth or less (rad/s)."""
    rigidity_uncertainty: Fraction = 0.0
    """Relative error of the stiffness of the links for which the design is robust, at most 1, such
    as 0.3: a third of it is added to the damping ratios of the design model, so that the controller
    does not rely on the frequencies of the links (Collins, King and Bernstein 1992). The arm must
    have damping, too."""
    delay: NonNegative = 0.0
    """Delay of the loop by motors and instruments, in whole samples, for which the controller is
    designed (s)."""
    suboptimality: _Suboptimality = 1.1
    """Ratio of the largest possible stability margin to that of the design."""
    schedule: Annotated[Any, ListPerJoint(Listed[Number] | None)] | None = None
    """For each joint nothing, or increasing angles: designs on the grid of these angles, between
    which the controllers are interpolated (rad)."""
    sample_time: SampleTime = 0.001


class LoopShapingKeys(_HardwareKeys, LoopShapingParameters):
    """Keys of the drive `loop_shaping`."""


class MuSynthesisParameters(RobustParameters):
    """mu synthesis: feedback of joint angles and rates for uncertain rigidity and payload."""

    name = "mu_synthesis"
    _: KW_ONLY
    rigidity_uncertainty: Fraction = 0.1
    """Relative change of the rigidity of all links, at most 1. A third of it is added to the
    damping ratios of the design model, as for `LoopShaping`."""
    payload_uncertainty: Fraction = 0.2
    """Relative change of the payload, at most 1."""
    sensitivity: Annotated[Finite, Field(gt=1, le=100), BeforeValidator(plain)] = 2.0
    """Largest accepted sensitivity at the motors, in torques normalised by the inertia, above 1."""
    iterations: Annotated[int, Field(strict=True, ge=1, le=100), BeforeValidator(plain)] = 3
    """Number of syntheses, at most 100."""
    scaling_order: Annotated[int, Field(strict=True, ge=0, le=2), BeforeValidator(plain)] = 1
    """Largest order of the fitted scalings, 0 to 2."""
    sample_time: SampleTime = 0.001
