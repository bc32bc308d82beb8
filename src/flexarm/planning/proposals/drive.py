"""The drive of a proposal: the hardware of a machine, or a typical one, and its delay."""

from __future__ import annotations

import math

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.integrate.base import FloatArray
from flexarm.model import Hardware, Instrument, Motors
from flexarm.model.hardware import instrument_faults

#: Bits of a typical encoder, and cutoff of the filter of its rates relative to the sampling
#: frequency.
_BITS, _CUTOFF = 17, 0.1
#: Noise of typical instruments of the tip, relative to the length of the arm, and of the force,
#: relative to that of the task.
_TIP_NOISE, _FORCE_NOISE = 5e-5, 4e-3
#: Readings by which each of the sensors of `flexarm.design` is recognised.
READINGS = {"gauges": "strain", "tip": "tip", "force": "contact_force"}
#: Torque (N m) beyond every limit.
_UNLIMITED = 1e300


def typical_hardware(
    arm: Arm, sensors: frozenset[str], sample_time: float, force: float
) -> Hardware:
    """Return the hardware of a typical drive: encoders, filtered rates and one sample of delay."""
    encoder = Instrument(
        signal="joint_angle",
        resolution=float(f"{2.0 * math.pi / 2**_BITS:.4g}"),
        rate_cutoff=float(f"{_CUTOFF / sample_time:.3g}"),
    )
    noise = {"tip": _TIP_NOISE * arm.reach, "force": _FORCE_NOISE * force}
    others = [
        Instrument(signal=signal, noise=float(f"{noise.get(name, 0.0):.2g}"))
        for name, signal in READINGS.items()
        if name in sensors
    ]
    return Hardware(instruments=[encoder, *others], motors=Motors(delay=sample_time))


def checked_hardware(arm: Arm, hardware: Hardware, task: str) -> Hardware:
    """Return the hardware of a machine; InputError if it does not fit the arm or the task."""
    faults = instrument_faults(arm.spec, hardware, task == "force")
    if problems := [fault.problem("hardware") for fault in faults]:
        raise InputError(*problems)
    if hardware.instruments is None:
        return hardware
    read = readings_of(hardware)
    if missing := [name for name in ("joint_angle", "joint_rate") if name not in read]:
        rule = f"must measure {' and '.join(missing)}"
        hint = "Give the instrument of joint_angle a rate_cutoff, which derives the rate."
        raise InputError(Problem("hardware", rule, hint=hint))
    return hardware


def readings_of(hardware: Hardware) -> set[str]:
    """Return the names of the readings of listed instruments."""
    return {name for item in hardware.instruments or () for name in item.labels}


def torque_limit_of(arm: Arm, hardware: Hardware) -> FloatArray | None:
    """Return the limits (joints,) N m of motors at rest; None if a joint has none."""
    if hardware.motors is None:
        return None
    request = np.full(arm.n_joints, _UNLIMITED)
    limit = np.asarray(hardware.motors.allowed(request, np.zeros(arm.n_joints)), dtype=np.float64)
    return limit if (limit < _UNLIMITED).all() else None


def with_torque_limit(arm: Arm, hardware: Hardware, limit: FloatArray | None) -> Hardware:
    """Return hardware with the argument ``torque_limit`` (N m) as a limit of its motors."""
    if limit is None:
        return hardware
    if torque_limit_of(arm, hardware) is not None:
        rule = "cannot be combined with hardware whose motors have limits"
        raise InputError(Problem("torque_limit", rule))
    each = [float(f"{value:.3g}") for value in np.broadcast_to(limit, (arm.n_joints,)).tolist()]
    return hardware.replace(motors=(hardware.motors or Motors()).replace(torque_limit=each))


def delay_of(hardware: Hardware) -> float:
    """Return the delay (s) of a loop by its hardware, without sampling and filters of rates."""
    motors = hardware.motors or Motors()
    readings = max((item.delay for item in hardware.instruments or ()), default=0.0)
    return motors.delay + motors.time_constant + readings


def quicker(hardware: Hardware, factor: float) -> Hardware:
    """Return hardware whose delays and lags, apart from filters of rates, are multiplied."""
    motors = hardware.motors or Motors()
    times = {"delay": factor * motors.delay, "time_constant": factor * motors.time_constant}
    items = hardware.instruments
    if items is not None:
        items = [item.replace(delay=factor * item.delay) for item in items]
    return hardware.replace(motors=motors.replace(**times), instruments=items)


def rate_lag_of(hardware: Hardware) -> float:
    """Return the lag (s) of the joint rates by their filter."""
    read = [item for item in hardware.instruments or () if "joint_rate" in item.labels]
    return sum(0.5 / (math.pi * item.rate_cutoff) for item in read if item.rate_cutoff)


def typical_text(hardware: Hardware) -> str:
    """Return a sentence about a typical drive."""
    encoder = (hardware.instruments or ())[0]
    delay = (hardware.motors or Motors()).delay
    return (
        f"A typical drive is assumed, because no hardware is given: encoders with {_BITS} bits, "
        f"rates through a filter of {encoder.rate_cutoff:.3g} Hz, and one sample "
        f"({1e3 * delay:.3g} ms) of delay. Give that of your machine as hardware."
    )
