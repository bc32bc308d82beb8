"""Controllers of the joint angles along a reference."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import KW_ONLY
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_each, check_flag, check_limits, check_numbers
from flexarm.base.errors import InputError, Problem, check_array, public_call, raise_any, shown
from flexarm.base.late import optimize
from flexarm.control.contract.base import (
    JOINTS,
    Arrays,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    SampledFeedforward,
    Step,
    applied,
    joint_problems,
    joints_of,
)
from flexarm.control.contract.parametrised import OfArm, Parametrised
from flexarm.control.design.arm_scales import check_sample_time
from flexarm.control.design.rigid_model import RigidModel, SaggingArm
from flexarm.control.hardware.measurement import filter_of
from flexarm.model.drives.controllers import (
    ComputedTorqueParameters,
    JointPDParameters,
    JointPIDParameters,
    PrescribedPerformanceParameters,
    StrainFeedbackParameters,
)


class JointFollower(Parametrised, Controller):
    """Base of joint controllers that follow a reference, or keep the first angles without one."""

    _: KW_ONLY
    feedforward: Callable[[float], ArrayLike] | None = Field(
        default=None,
        description="Function of time that returns torques (joints,) N m, such as "
        "``rigid_torque(arm, motion)``; None for none. It is evaluated in the middle of each "
        "sample.",
    )

    def __post_init__(self) -> None:
        if self.feedforward is not None and not callable(self.feedforward):
            rule = "be a function of time that returns torques, or None"
            raise InputError(Problem("feedforward", rule, shown(self.feedforward)))
        self._ahead: SampledFeedforward | None = None

    def reset(self) -> None:
        """Clear the memory and the feedforward torques computed in advance."""
        super().reset()
        self._ahead = None

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """Return the requirements: joint readings, and the number of joints of the parameters."""
        return ControllerRequirements(self._joints_for(arm), JOINTS)

    def _joints_for(self, arm: Arm, *more: FloatArray) -> int:
        """Return the number of joints of all parameters with a value for each, and of ``more``."""
        return joints_of(arm.n_joints, *self._per_joint(), *more)

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the reference angles and rates, and the feedforward torque."""
        inputs = {
            "reference_angle": reference.joint_angle(t),
            "reference_rate": reference.joint_rate(t),
        }
        if self.feedforward is not None:
            if self._ahead is None:
                # In the middle of the sample, because a zero-order hold delays its input by half a
                # sample. With a good model that delay would be the largest disturbance.
                later = 0.5 * self.sample_time
                self._ahead = SampledFeedforward(self.feedforward, self.sample_time, later)
            inputs["feedforward"] = self._ahead(t)
        return inputs

    def _with_feedforward(self, torque: FloatArray, inputs: Arrays) -> FloatArray:
        """Return a torque plus the feedforward torque, if there is any."""
        return torque if self.feedforward is None else torque + inputs["feedforward"]


class JointPD(JointFollower, JointPDParameters):
    """Proportional and derivative feedback of each joint angle, plus a feedforward torque.

    Without a reference the controller keeps the angles of its first measurement.
    """

    vectorized = analytic = True

    feedforward: Callable[[float], ArrayLike] | None = Field(default=None)  # also by position

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        torque: FloatArray = self.proportional * (inputs["reference_angle"] - readings.joint_angle)
        torque = torque + self.derivative * (inputs["reference_rate"] - readings.joint_rate)
        return memory, self._with_feedforward(torque, inputs)


class JointPID(JointFollower, JointPIDParameters):
    """Proportional, integral and derivative feedback of each joint angle; gravity compensation.

    Without a reference the controller keeps the angles of its first measurement. Theory page:
    (C.1).

    Raises:
        InputError: if a gain is negative or not finite, a limit or the sample time is not positive,
            ``sag`` is given without ``arm``, or the length of a list differs from the number of
            joints of ``arm``.
    """

    knows_limits = True

    _: KW_ONLY
    arm: Arm | None = Field(
        default=None,
        description="Model for gravity compensation at the measured angles; None for no "
        "compensation.",
    )
    sag: bool = Field(
        default=False,
        description="Whether the compensation includes the sag of the links under gravity; if "
        "False, the links are straight.",
    )
    torque_limit: Any = Field(
        default=math.inf,
        description="Largest requested torque (N m), one number or one per joint. At the limit the "
        "integral is not advanced in the direction of more torque (anti-windup). Simulations "
        "reduce it to that of the motors.",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        arm = self.arm
        self._limit_torque(check_limits("torque_limit", self.torque_limit))
        self.sag = check_flag("sag", self.sag)
        self._weight: RigidModel | SaggingArm | None = None
        if arm is not None:
            limits = {"torque_limit": self.torque_limit}
            raise_any(joint_problems(arm.n_joints, limits))
            self._weight = SaggingArm(arm) if self.sag else RigidModel(arm)
        elif self.sag:
            raise InputError(Problem("arm", "is required with sag"))

    def _limit_torque(self, limit: Any) -> None:
        super()._limit_torque(limit)
        self._limited = bool(np.any(np.isfinite(limit)))

    @property
    def vectorized(self) -> bool:  # type: ignore[override]
        """Whether ``step`` accepts the readings of many runs; the sag of the links is of one."""
        return not self.sag

    @property
    def analytic(self) -> bool:  # type: ignore[override]
        """Whether ``step`` accepts complex numbers; the model of the gravity does not."""
        return self.arm is None

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        return ControllerRequirements(self._joints_for(arm, self.torque_limit), JOINTS)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        start = {"integral": 0.0 * readings.joint_angle}
        if isinstance(self._weight, SaggingArm):
            start["_sag"] = self._weight.first_sag(readings.joint_angle)
        return start

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after = dict(memory)
        error: FloatArray = inputs["reference_angle"] - readings.joint_angle
        torque: FloatArray = self.proportional * error + memory["integral"]
        torque = torque + self.derivative * (inputs["reference_rate"] - readings.joint_rate)
        if isinstance(self._weight, SaggingArm):
            pull, after["_sag"] = self._weight.gravity_torque(readings.joint_angle, memory["_sag"])
            torque = torque + pull
        elif self._weight is not None:
            torque = torque + self._weight.gravity_torque(readings.joint_angle)
        torque = self._with_feedforward(torque, inputs)
        rise = self.integral * (self.sample_time * error)
        if self._limited:
            wanted, limit = torque, self.torque_limit
            torque = np.minimum(np.maximum(wanted, -limit), limit)
            rise = ((wanted == torque) | (error * wanted < 0.0)) * rise
        after["integral"] = memory["integral"] + rise
        return after, torque


class ComputedTorque(JointFollower, ComputedTorqueParameters, OfArm):
    """Computed torque with the rigid model of an arm.

    In a mechanism with closures the actuated joints follow their errors, and the other joints
    follow them as the closures require; theory page "mechanisms", (M.24). A free base has the
    momentum zero: then the joints of a free-flying arm follow their errors, too, (M.27).

    Without a reference the controller keeps the angles of its first measurement. On a rigid arm the
    errors satisfy a linear equation of second order, (C.2). The model has no flexible links, so on
    a flexible arm the frequency should be below the lowest one with locked joints.
    """

    vectorized = True
    _unsupported = ()

    _: KW_ONLY
    feedforward: Callable[[float], ArrayLike] | None = Field(
        default=None,
        description="None for feedback linearisation, with the torques of the model at the "
        "measured angles and rates; or a function of time that returns torques (joints,) N m to "
        "follow the reference, such as the ``torque`` of `tip_inversion` together with its "
        "``reference``. The mass matrix of the model then converts only the errors to torques.",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_sample_time(self.arm, self.sample_time)
        self._model = RigidModel(self.arm, self.actuated)
        omega = 2.0 * np.pi * self.frequency_hz
        self._proportional, self._derivative = omega**2, 2.0 * self.damping_ratio * omega

    def planned(self, t: float, reference: Reference) -> Arrays:
        more = (
            {} if self.feedforward else {"reference_acceleration": reference.joint_acceleration(t)}
        )
        return {**super().planned(t, reference), **more}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        now, speed = readings.joint_angle, readings.joint_rate
        desired: FloatArray = self._proportional * (inputs["reference_angle"] - now)
        desired = desired + self._derivative * (inputs["reference_rate"] - speed)
        if self.feedforward is not None:
            errors = applied(self._model.mass_matrix(now), desired)
            return memory, inputs["feedforward"] + errors
        desired = desired + inputs["reference_acceleration"]
        # Return a copy, because the next call of the model overwrites the array.
        return memory, self._model.torque(now, speed, desired).copy()


#: Default cutoff of the strain rates, relative to the sampling frequency.
_CUTOFF = 0.1


class StrainFeedback(JointFollower, StrainFeedbackParameters):
    """Proportional and derivative feedback of each joint angle, and of strains at gauges.

    The torque is that of `JointPD` minus ``strain`` times the strains and ``strain_rate`` times
    their rates. With a large derivative gain the joint rates follow the strains, which is direct
    strain feedback.

    Without a reference the controller keeps the angles of its first measurement. The poles of the
    sampled loop show whether gains are stable: theory page, (C.11) and (C.12).

    Raises:
        InputError: if a joint's gain is negative or not finite, or a time or cutoff is not
            positive.

    The difference of two gauges near the root of a link is proportional to the shear force there.

    References:
        Z.-H. Luo, IEEE Trans. Automatic Control 38 (1993) 1610-1622: curvature at the root.
        Z.-H. Luo and B.-Z. Guo, IEEE Trans. Automatic Control 42 (1997) 53-65: shear force.
        S. S. Ge, T. H. Lee and G. Zhu, IEEE Trans. Robotics and Automation 14 (1998) 179-185.
    """

    vectorized = analytic = True

    strain: Any = Field(
        description="Gains (N m): one number or one per joint, where gauge k acts on joint k; or a "
        "matrix (joints, gauges). Positive gains add damping if the distances of the gauges are "
        "positive."
    )
    strain_rate: Any = Field(default=0.0, description="Gains (N m s), in the same form.")

    def __post_init__(self) -> None:
        super().__post_init__()
        self.strain = _of_gauges("strain", self.strain)
        self.strain_rate = _of_gauges("strain_rate", self.strain_rate)

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        fed = [self.strain, *([self.strain_rate] if np.any(self.strain_rate) else [])]
        joints = self._joints_for(arm, *fed)
        there = len(arm.gauges)
        counts = (gains.shape[1] if gains.ndim == 2 else joints for gains in fed)
        gauges = next((count for count in counts if count != there), there)
        return ControllerRequirements(joints, (*JOINTS, "strain"), gauges)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        """Return the strains and their filtered rates, zero; nothing without rate gains."""
        strain = readings.strain
        return {"strain": strain, "rate": 0.0 * strain} if np.any(self.strain_rate) else {}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        torque: FloatArray = self.proportional * (inputs["reference_angle"] - readings.joint_angle)
        torque = torque + self.derivative * (inputs["reference_rate"] - readings.joint_rate)
        strain = readings.strain
        torque = torque - _at_joints(self.strain, "strain", strain, torque.shape[-1])
        if memory:
            # Tustin's rule for s / (1 + s / (2 pi cutoff)), from rest.
            cutoff = self.rate_cutoff or _CUTOFF / self.sample_time
            decay, per_change = filter_of(cutoff, self.sample_time)
            rate = decay * memory["rate"] + per_change * (strain - memory["strain"])
            memory = {"strain": strain.copy(), "rate": rate}
            torque = torque - _at_joints(self.strain_rate, "strain_rate", rate, torque.shape[-1])
        return memory, self._with_feedforward(torque, inputs)


def _at_joints(gains: FloatArray, name: str, of_gauges: FloatArray, joints: int) -> FloatArray:
    gauges = of_gauges.shape[-1]
    if gains.ndim == 2 and gains.shape == (joints, gauges):
        return applied(gains, of_gauges)
    if gains.ndim < 2 and gauges == joints and gains.size in (1, joints):
        return gains * of_gauges
    rule = f"be a matrix ({joints}, {gauges}): one row for each joint, one column for each gauge"
    if gauges == joints:
        rule += ", or one number for each"
    shape = "one number" if gains.ndim == 0 else f"shape {gains.shape}"
    raise InputError(Problem(name, rule, shape))


def _of_gauges(name: str, value: ArrayLike) -> FloatArray:
    if isinstance(value, list | tuple) and any(isinstance(row, list | tuple) for row in value):
        return check_array(name, value, (-1, -1))
    if isinstance(value, np.ndarray) and value.ndim >= 2:
        return check_array(name, value, (-1, -1))
    return check_each(name, value)


#: Default decay rate of the bounds, relative to that of the errors.
_DECAY = 0.125


class PrescribedPerformance(JointFollower, PrescribedPerformanceParameters):
    """Joint control that keeps angle errors within bounds that decrease exponentially.

    Near zero errors it is `JointPD` with the gains ``bandwidth`` times ``damping`` and ``damping``.
    Towards its bound, the gain from an angle error to a requested rate grows, and so does the gain
    from the rate error to the torque. If they grow without limit, in continuous time, no bound is
    exceeded on an arm with damped links, whatever its payload and friction. A sampled loop is
    stable only up to certain gains, so both grow up to ``gain_limit`` times their values at zero,
    and a bound can be exceeded. The bounds are those of the joints: stiff joints damp the links
    little.

    Without a reference the controller keeps the angles of its first measurement.

    The attribute ``bound_exceeded`` of results is the number of samples ``outside``; ``simulate``
    warns if there are any.

    Raises:
        InputError: if a number is out of range, or ``start_bound`` is less than ``bound``.
    """

    vectorized = True
    references: ClassVar[str] = "BechlioulisRovithakis2008 BechlioulisRovithakis2014"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start_bound is None:
            self.start_bound = self.bound
        if self.decay is None:
            self.decay = _DECAY * float(np.min(self.bandwidth))
        start, end = np.size(self.start_bound), np.size(self.bound)
        if start != end and 1 not in (start, end):
            rule = f"have length {end}, one value for each joint"
            raise InputError(Problem("start_bound", rule, str(start)))
        if np.any(self.start_bound < self.bound):
            raise InputError(Problem("start_bound", "be at least bound", shown(self.start_bound)))
        self._angle_end = math.sqrt(1.0 - 1.0 / self.gain_limit)

        def excess(x: float) -> float:  # of the derivative of artanh(x) / (1 - x^2)
            return (1.0 + 2.0 * x * math.atanh(x)) / (1.0 - x * x) ** 2 - self.gain_limit

        self._rate_end = optimize.brentq(excess, 0.0, self._angle_end)

    @property
    def outside(self) -> int:
        """Number of samples of the last run with a measured angle error outside its bound."""
        return int(self.memory.get("outside", 0))

    @public_call
    def angle_bound(self, t: ArrayLike) -> FloatArray:
        """Return the bounds (T, joints) rad of the angle errors at times (T,) s.

        The shape is (T, 1) with one bound for all joints.

        Raises:
            InputError: if t does not consist of numbers.
        """
        fading = np.exp(-self.decay * check_numbers("t", t))[..., None]
        return np.asarray(self.bound + (self.start_bound - self.bound) * fading)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        error = inputs["reference_angle"] - readings.joint_angle
        start = np.ones((*error.shape[:-1], 1))
        bound = self.bound + start * (self.start_bound - self.bound)
        return {"fading": start, "outside": 0, "_first": _largest(error / bound)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        # Not the excess itself, because an analysis of the loop varies its memory below zero, too.
        bound = self.bound + memory["fading"] * (self.start_bound - self.bound)
        after = dict(memory, fading=np.exp(-self.decay * self.sample_time) * memory["fading"])
        ratio = (inputs["reference_angle"] - readings.joint_angle) / bound
        after["outside"] = memory["outside"] + (_largest(ratio) > 1.0)
        near, beyond = _split(ratio, self._angle_end)
        grown = np.arctanh(near) + self.gain_limit * beyond
        requested = inputs["reference_rate"] + self.bandwidth * bound * grown
        ratio = (requested - readings.joint_rate) / self.rate_bound
        near, beyond = _split(ratio, self._rate_end)
        grown = np.arctanh(near) / (1.0 - near * near) + self.gain_limit * beyond
        torque: FloatArray = self.damping * self.rate_bound * grown
        return after, self._with_feedforward(torque, inputs)

    def report(self) -> dict[str, float]:
        """Return the number of samples outside the bound, and the first error over its bound."""
        return {
            "bound_exceeded": self.outside,
            "bound_first_ratio": float(self.memory.get("_first", 0.0)),
        }


def _largest(ratio: FloatArray) -> Any:
    """Return the largest ratio of each run; 0 for symbols, which are not counted."""
    return np.abs(ratio).max(axis=-1) if ratio.dtype.kind == "f" else 0.0


def _split(ratio: FloatArray, end: float) -> tuple[FloatArray, FloatArray]:
    """Return the parts of a ratio within ``end``, and beyond it."""
    near = np.minimum(np.maximum(ratio, -end), end)
    return near, ratio - near
