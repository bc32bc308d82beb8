"""Controller that passes the estimates of a filter to an inner controller."""

from __future__ import annotations

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.control.contract.base import (
    Around,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    requirements_of,
)
from flexarm.control.contract.parametrised import Parametrised
from flexarm.control.filters.estimator import StateEstimator
from flexarm.model.drives.around import EstimatorParameters

#: Entries of the measurement that the filter supplies to the inner controller.
_ESTIMATED = ("joint_angle", "joint_rate", "q", "qd", "payload_mass", "disturbance")


class EstimatorController(Parametrised, EstimatorParameters, Around):
    """Controller that passes the estimates of a filter to an inner controller.

    The measurement of the inner controller has the estimated ``joint_angle`` and ``joint_rate``,
    ``q`` (dof,), ``qd`` (dof,), ``payload_mass`` (1,) kg and ``disturbance`` (joints,) N m, and the
    other readings unchanged. Estimated disturbance torques are subtracted from its torque.

    The filter predicts with the measured "torque" if an instrument reads it, and with the requested
    torque otherwise.

    Raises:
        InputError: if ``estimator`` is not an estimator such as `ExtendedKalmanFilter`, or
            ``inner`` is not a controller.
    """

    estimator: StateEstimator
    inner: Controller

    def __post_init__(self) -> None:
        self._commanded: FloatArray | None = None
        self.estimator.sample_time = self.inner.sample_time

    def reset(self) -> None:
        """Clear the state of the previous run, including the filter and the inner controller."""
        self.estimator.sample_time = self.inner.sample_time
        self.estimator.reset()
        super().reset()
        self._commanded = None

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """Return the readings of the filter, and those of ``inner`` that it does not supply."""
        inner = requirements_of(self.inner, arm, reference)
        own = [item.label for item in self.estimator.instruments]
        more = [name for name in inner.measured if name not in _ESTIMATED]
        joints = self.estimator.arm.n_joints
        gauges = len(self.estimator.arm.gauges) if "strain" in own else None
        return ControllerRequirements(
            joints if joints != arm.n_joints else inner.joints,
            tuple(dict.fromkeys([*own, *more])),
            gauges if gauges not in (None, len(arm.gauges)) else inner.gauges,
        )

    def report(self) -> dict[str, float]:
        """Return the reports of the estimator and of the inner controller."""
        return self.estimator.report() | super().report()

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        estimator = self.estimator
        if self._commanded is not None:
            estimator.predict(measurement.get("torque", self._commanded))
        estimator.correct(measurement)
        q, qd, joints = estimator.q, estimator.qd, estimator.arm.joint_index
        seen = dict(measurement) | {"joint_angle": q[joints], "joint_rate": qd[joints]}
        seen |= {"q": q, "qd": qd, "payload_mass": np.array([estimator.payload_mass])}
        seen["disturbance"] = estimator.disturbance
        torque = self.inner.update(t, Measurement(**seen), reference)
        corrected = np.asarray(torque, dtype=np.float64) - self.compensation * estimator.disturbance
        self._commanded = corrected
        return self._commanded.copy()
