"""Joint control with feedback of strains at gauges, which damps vibration of the links."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_each
from flexarm.base.errors import InputError, Problem, check_array
from flexarm.control.contract.base import ControllerRequirements, FloatArray, Measurement, Reference
from flexarm.control.contract.gains import applied
from flexarm.control.contract.requirements import JOINTS
from flexarm.control.hardware.instruments import filter_of
from flexarm.control.laws.joint.follower import JointFollower
from flexarm.model.drives.joint import StrainFeedbackParameters

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

    memory = ("_last", "_rate")
    vectorized = True

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
        self._last: FloatArray | None = None
        self._rate = np.zeros(0)

    def reset(self) -> None:
        """Clear the stored angles and strains."""
        super().reset()
        self._last = None

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """See ``Controller.requirements``."""
        fed = [self.strain, *([self.strain_rate] if np.any(self.strain_rate) else [])]
        joints = self._joints_for(arm, *fed)
        there = len(arm.gauges)
        counts = (gains.shape[1] if gains.ndim == 2 else joints for gains in fed)
        gauges = next((count for count in counts if count != there), there)
        return ControllerRequirements(joints, (*JOINTS, "strain"), gauges)

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        angle, rate = self._desired(t, measurement, reference)
        torque: FloatArray = self.proportional * (angle - measurement.joint_angle)
        torque = torque + self.derivative * (rate - measurement.joint_rate)
        strain = measurement.strain
        torque = torque - _at_joints(self.strain, "strain", strain, torque.shape[-1])
        if np.any(self.strain_rate):
            slope = self._strain_rate(strain)
            torque = torque - _at_joints(self.strain_rate, "strain_rate", slope, torque.shape[-1])
        if self.feedforward is not None:
            torque = torque + self._fed_forward(t)
        return torque

    def _strain_rate(self, strain: FloatArray) -> FloatArray:
        """Return the filtered rates: Tustin's rule for s / (1 + s / (2 pi cutoff)), from rest."""
        if self._last is None:
            self._rate = np.zeros_like(strain)
        else:
            cutoff = self.rate_cutoff or _CUTOFF / self.sample_time
            kept, per_change = filter_of(cutoff, self.sample_time)
            self._rate = kept * self._rate + per_change * (strain - self._last)
        self._last = strain.copy()
        return self._rate


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
