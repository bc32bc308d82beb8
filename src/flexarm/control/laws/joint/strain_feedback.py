"""Joint control with feedback of strains at gauges, which damps vibration of the links."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_each
from flexarm.base.errors import InputError, Problem, check_array
from flexarm.control.contract.base import (
    JOINTS,
    Arrays,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    Step,
    applied,
)
from flexarm.control.hardware.measurement import filter_of
from flexarm.control.laws.joint.joint_pd import JointFollower
from flexarm.model.drives.controllers import StrainFeedbackParameters

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
        if self.feedforward is not None:
            torque = torque + inputs["feedforward"]
        return memory, torque


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
