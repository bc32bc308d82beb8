"""Hardware between a controller and an arm: instruments and motors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arguments import (
    check_count,
    check_kind,
    check_limits,
    check_list_of,
    check_nonnegative,
    check_numbers,
)
from flexarm.errors import InputError, Problem
from flexarm.hardware.instruments import Instrument

FloatArray = NDArray[np.float64]

_POSITIVE = ("torque_limit", "torque_constant", "current_limit", "voltage_limit", "resistance")


@dataclass(frozen=True)
class Motors:
    """Motors with delay, limits and lag.

    A torque that a controller requests is delayed by ``delay``, clipped to the limits at the joint
    rates of that instant, and reached by the motors as ``1 - exp(-t / time_constant)``.

    Args:
        torque_limit: N m at the joint, one number or one per joint, positive.
        delay: s from the sample time to the instant at which the torque starts to act.
        time_constant: s, lag of the current loop; 0 for none.
        torque_constant: N m at the joint per A, gear included; one number or one per joint.
            Required with ``current_limit`` or ``voltage_limit``.
        current_limit: A.
        voltage_limit: V. It reduces the available torque of fast motors, because
            ``torque_constant`` is also the constant of the back electromotive force, V s/rad at
            the joint.
        resistance: ohm, of the winding; required with ``voltage_limit``.

    Raises:
        InputError: if a number is not positive, ``delay`` or ``time_constant`` is negative, or a
            limit is given without the arguments that it requires.
    """

    torque_limit: ArrayLike = math.inf
    delay: float = 0.0
    time_constant: float = 0.0
    torque_constant: ArrayLike | None = None
    current_limit: ArrayLike = math.inf
    voltage_limit: ArrayLike = math.inf
    resistance: ArrayLike | None = None

    def __post_init__(self) -> None:
        problems: list[Problem] = []
        for name in ("delay", "time_constant"):
            check_nonnegative("Motors", name, getattr(self, name))
        for name in _POSITIVE:
            value = getattr(self, name)
            if value is None:
                continue
            try:
                check_limits("Motors", name, value)
            except InputError as error:
                problems += error.problems
        if problems:
            raise InputError(*problems)
        limited = np.isfinite(_numbers(self.voltage_limit)).any()
        if (
            limited or np.isfinite(_numbers(self.current_limit)).any()
        ) and self.torque_constant is None:
            problems.append(_missing("torque_constant", "a limit of current or voltage"))
        if limited and self.resistance is None:
            problems.append(_missing("resistance", "a limit of voltage"))
        if problems:
            raise InputError(*problems)

    def check_joints(self, joints: int) -> None:
        """Check that lists have one number for each joint of an arm.

        Raises:
            InputError: if the length of a list differs from ``joints``.
        """
        check_count("Motors.check_joints", "joints", joints, least=0)
        problems = []
        for name in _POSITIVE:
            value = getattr(self, name)
            count = np.size(value) if np.ndim(value) else joints
            if count != joints:
                rule = f"be one number, or one for each of the {joints} joints"
                problems.append(Problem("Motors", name, rule, f"{count} numbers"))
        if problems:
            raise InputError(*problems)

    def allowed(self, torque: FloatArray, rate: FloatArray) -> FloatArray:
        """Return a torque (joints,) clipped to the limits at joint rates (joints,)."""
        if type(torque) is not np.ndarray or torque.dtype != np.float64:
            torque = check_numbers("Motors.allowed", "torque", torque, _OF_JOINTS)
        if type(rate) is not np.ndarray or rate.dtype != np.float64:
            rate = check_numbers("Motors.allowed", "rate", rate, _OF_JOINTS)
        limit = _numbers(self.torque_limit)
        if self.torque_constant is not None:
            constant = _numbers(self.torque_constant)
            limit = np.minimum(limit, constant * _numbers(self.current_limit))
            if self.resistance is not None:
                # The supply voltage less the back electromotive force drives the current.
                supply, resistance = _numbers(self.voltage_limit), _numbers(self.resistance)
                most = constant * (supply - constant * rate) / resistance
                least = constant * (-supply - constant * rate) / resistance
                torque = np.clip(torque, least, most)
        return np.clip(torque, -limit, limit)


_OF_JOINTS = "be numbers of shape (joints,)"


def _numbers(value: ArrayLike | None) -> FloatArray:
    return np.asarray(value, dtype=np.float64)


@dataclass(frozen=True)
class Hardware:
    """Instruments and motors between a controller and an arm, for ``simulate(hardware=...)``.

    Args:
        instruments: instruments whose readings form the measurement; None for exact
            ``joint_angle``, ``joint_rate`` and, with gauges, ``strain``.
        motors: None for ideal motors, without delay, lag or limits.
        seed: seed of all noise; the same seed gives the same run.

    Raises:
        InputError: if two readings have the same name, an entry is not an instrument, or
            ``motors`` is not a `Motors` object.
    """

    instruments: Sequence[Instrument] | None = None
    motors: Motors | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.instruments is not None:
            check_list_of("Hardware", "instruments", self.instruments, Instrument)
        if self.motors is not None:
            check_kind("Hardware", "motors", self.motors, Motors, "a Motors object")
        names = [label for item in self.instruments or () for label in item.labels]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            rule = "have different names"
            raise InputError(Problem("Hardware", "instruments", rule, ", ".join(twice)))
        check_count("Hardware", "seed", self.seed, least=0, most=2**63 - 1)


def _missing(name: str, why: str) -> Problem:
    return Problem("Motors", name, f"is required with {why}")
