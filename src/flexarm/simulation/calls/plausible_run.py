"""Implausible numbers of a call that simulates: angles, times and limits of motors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import about_degrees
from flexarm.integrate.base import FloatArray
from flexarm.model import Hardware
from flexarm.model.arm.plausibility import weights
from flexarm.model.plausible import Number, Range, judge

#: Samples in a run; samples of a controller; durations of a run and of its motion over each other.
_SAMPLES, _UPDATES = Range(1.0 - 1e-9, 1e3, np.inf), Range(1.0 - 1e-9, 1e3, np.inf)
_MOTION = Range(3e-3, 1.0, 500.0)
#: Largest torque of a motor over that by which the weight turns the horizontal arm.
_TORQUE = Range(1e-2, 3.0, 1e5)


def implausible_run(
    arm: Arm,
    duration: float,
    rate: float,
    angles: FloatArray | None = None,
    controller: Any = None,
    reference: Any = None,
    hardware: Hardware | None = None,
) -> list[str]:
    """Return a sentence for each implausible number of a run.

    Args:
        arm: the simulated arm. duration: s. rate: of the samples, Hz.
        angles: joint angles at the start, if they are given, rad.
    """
    findings: list[str] = []
    if angles is not None and (text := about_degrees("initial", angles)):
        findings.append(text)
    if duration * rate < _SAMPLES.low:
        text = f"rate is {rate:.4g} Hz, less than one sample in the duration of {duration:.4g} s"
        findings.append(f"{text}: did you mean {1.0 / rate:.4g} Hz ({rate:.4g} s between samples)?")
    if controller is not None:
        step = Number("controller.sample_time", float(controller.sample_time), "s", -1.0)
        judge(findings, duration / step.value, _UPDATES, "longer than the run", step)
    length = getattr(reference, "duration", None)
    if isinstance(length, float) and length > 0.0:
        times = Number("duration", duration, "s"), Number("reference.duration", length, "s", -1.0)
        short = duration < length
        statement = f"but the motion takes {length:.4g} s"
        if short:
            times, statement = times[::-1], f"but the run takes {duration:.4g} s"
        judge(findings, duration / length, _MOTION, statement, *times)
    if hardware is not None and hardware.motors is not None:
        _judge_motors(findings, arm, hardware.motors.torque_limit)
    return findings


def _judge_motors(findings: list[str], arm: Arm, limit: ArrayLike) -> None:
    """Judge the torque limits of motors by the weight of the arm, if it has any."""
    statement = "{ratio} of the torque by which the weight turns the horizontal arm"
    torques = [weights(arm.spec)[seat.link] for seat in arm.assembly.seats]
    limits = np.asarray(limit, dtype=np.float64)
    if limits.ndim and limits.shape != (len(torques),):
        return  # the run refuses them
    for most, torque in zip(np.broadcast_to(limits, len(torques)), torques, strict=True):
        if torque > 0.0 and np.isfinite(most):
            number = Number("hardware.motors.torque_limit", float(most), "N m")
            judge(findings, float(most) / torque, _TORQUE, statement, number)
