"""Recorded run of a filter: readings with noise, and the estimates of Python."""

from __future__ import annotations

import warnings
from copy import deepcopy

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import FlexarmWarning
from flexarm.bridges.c_code.observer import Observer
from flexarm.control.filters.extended_kalman import ExtendedKalmanFilter
from flexarm.control.hardware.measurement import Measurement
from flexarm.linear.step_derivatives.sampled_step import SampledStep

#: Initial joint angles and rates, and torques in rad/s^2 of a straight arm.
_ANGLE, _RATE, _TORQUE = 0.4, 1.0, 3.0


def record_observer(observer: Observer, samples: int) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return the inputs (samples, size) of the filter by name, and its estimates, in rows."""
    with warnings.catch_warnings():
        # The run only compares two programs: it may leave the validity of the theory.
        warnings.simplefilter("ignore", FlexarmWarning)
        inputs = _readings(observer.filter, samples)
        return inputs, estimates(observer.filter, inputs)


def estimates(of: ExtendedKalmanFilter, inputs: dict[str, FloatArray]) -> FloatArray:
    """Return q, qd, payload and innovation (samples, 2 dof + 2) of a filter from its start."""
    mine, rows = deepcopy(of), []
    mine.reset()
    ends = np.cumsum([0, *of._readings.counts])
    for k, (values, torque) in enumerate(
        zip(inputs["readings"], inputs["last_torque"], strict=True)
    ):
        if k:
            mine.predict(torque)
        parts = zip(of.instruments, ends, ends[1:], strict=False)
        mine.correct(Measurement(**{one.label: values[a:b] for one, a, b in parts}))
        rows.append([*mine.q, *mine.qd, mine.payload_mass, mine._latest.innovation])
    return np.array(rows)


def _readings(of: ExtendedKalmanFilter, samples: int) -> dict[str, FloatArray]:
    """Move the arm of the filter under smooth torques; return readings with noise, and torques."""
    arm, shown, random = of.arm, of._readings, np.random.default_rng(0)
    step = SampledStep(arm, of.sample_time)
    M = arm.mass_matrix(np.zeros(arm.dof))[arm.joint_index, arm.joint_index]
    x = np.zeros(2 * arm.dof)
    x[arm.joint_index], x[arm.dof + arm.joint_index] = _ANGLE, _RATE
    torque, rows, torques = np.zeros(arm.joints), [], []
    for k in range(samples):
        noise = np.sqrt(shown.variance) * random.standard_normal(shown.size)
        rows.append(shown.values(x, torque, step.free.at()) + noise)
        torques.append(torque)
        phase = 2.0 * np.pi * k / samples * np.arange(1, arm.joints + 1)
        torque = _TORQUE * M * np.sin(phase)
        x = step.advance(x, torque)
    return {"readings": np.array(rows), "last_torque": np.array(torques)}
