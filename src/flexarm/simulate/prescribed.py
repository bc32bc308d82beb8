"""Joints that follow a given motion exactly, whatever torque it takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm import Arm
from flexarm.errors import InputError, Problem, shown
from flexarm.integrate.base import FloatArray
from flexarm.motion import Motion
from flexarm.simulate.torque_history import TorqueHistory, function_torque


@dataclass(frozen=True)
class PrescribedAngle:
    """A joint angle as a function of time, with its derivatives.

    Args:
        angle, rate, acceleration: functions of time (s): rad, rad/s, rad/s^2 of the relative
            joint angle. They must belong together: the simulation starts from angle and rate and
            integrates the acceleration.
        breaks: times where the acceleration jumps or bends.
    """

    angle: Callable[[float], float]
    rate: Callable[[float], float]
    acceleration: Callable[[float], float]
    breaks: tuple[float, ...] = ()


Prescribed = Mapping[int, PrescribedAngle | Motion]


def prescribe(
    arm: Arm,
    prescribed: Prescribed,
    state: FloatArray,
    history: TorqueHistory,
    duration: float,
    relative: float,
) -> TorqueHistory:
    """Put accelerations in place of torques, and the start of the motion into ``state``.

    Args:
        prescribed: by joint number, counted from 1: its own angle, or a motion of all joints of
            which this joint's part is taken.
        state: (2, n, 1 + m), changed in place.
        history: of the other joints' torques.

    Raises:
        InputError: no such joint.
    """
    for joint, motion in prescribed.items():
        numbers = arm.joint_numbers.tolist()
        if joint not in numbers:
            rule = f"name joints that turn: {', '.join(map(str, numbers)) or 'there is none'}"
            raise InputError(Problem("simulate", "prescribed", rule, shown(joint)))
        index = numbers.index(joint)
        own = _of_joint(motion, index)
        body = arm.assembly.joint_body[index]
        state[0, body, 0], state[1, body, 0] = own.angle(0.0), own.rate(0.0)

        column = function_torque(_row(motion, own, index), duration, 1, relative, own.breaks)
        history = _replaced(history, index, column)
    return history


def _row(
    motion: PrescribedAngle | Motion, own: PrescribedAngle, index: int
) -> Callable[[float], ArrayLike]:
    """The joint's acceleration as a function to (1,), for many times at once where it can be."""
    if isinstance(motion, PrescribedAngle):
        return lambda t: np.array([own.acceleration(t)])

    def rows(t: ArrayLike) -> FloatArray:
        return motion.joint_acceleration(t)[..., index : index + 1]

    rows.vectorized = True  # type: ignore[attr-defined]
    return rows


def _of_joint(motion: PrescribedAngle | Motion, index: int) -> PrescribedAngle:
    if isinstance(motion, PrescribedAngle):
        return motion

    def part(of: Callable[[float], ArrayLike]) -> Callable[[float], float]:
        return lambda t: float(np.asarray(of(t))[index])

    return PrescribedAngle(
        part(motion.joint_angle),
        part(motion.joint_rate),
        part(motion.joint_acceleration),
        tuple(motion.breaks),
    )


def _replaced(history: TorqueHistory, index: int, column: TorqueHistory) -> TorqueHistory:
    """Cut both histories at each other's breaks, and put one column of the first in its place."""
    breaks = np.unique(np.concatenate([history.breaks, column.breaks]))
    coefficients = _cut(history, breaks)
    coefficients[:, :, index] = _cut(column, breaks)[:, :, 0]
    stops = np.unique(np.concatenate([history.stops, column.stops]))
    return TorqueHistory(breaks, coefficients, stops)


def _cut(history: TorqueHistory, breaks: FloatArray) -> FloatArray:
    """Coefficients (pieces, 4, columns) of the same function over finer pieces."""
    last = len(history.breaks) - 2
    starts = breaks[:-1]
    k = np.clip(np.searchsorted(history.breaks, starts, side="right") - 1, 0, last)
    x = (starts - history.breaks[k])[:, None]
    c0, c1, c2, c3 = (history.coefficients[k, p] for p in range(4))
    shifted = [
        c0 + x * (c1 + x * (c2 + x * c3)),
        c1 + x * (2.0 * c2 + 3.0 * x * c3),
        c2 + 3.0 * x * c3,
        c3,
    ]
    return np.stack(shifted, axis=1)
