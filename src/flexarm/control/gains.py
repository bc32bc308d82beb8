"""Numbers that controllers are given, checked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from flexarm.control.measurement import FloatArray
from flexarm.errors import InputError, Problem, check_array, shown


def check_gains(where: str, name: str, value: ArrayLike) -> FloatArray:
    """Return gains, one number or one per joint, none negative.

    Raises:
        InputError: one is negative or not finite, or they are no numbers.
    """
    gains = check_array(where, name, value, np.shape(value)[:1])
    if np.any(gains < 0.0):
        raise InputError(Problem(where, name, "hold finite gains >= 0", shown(value)))
    return gains


def check_positive(where: str, name: str, value: ArrayLike) -> FloatArray:
    """Return numbers, one or one per joint, all positive; infinity is one.

    Raises:
        InputError: one is zero, negative or NaN, or they are no numbers.
    """
    numbers = np.asarray(value)
    if numbers.dtype.kind not in "iuf" or numbers.ndim > 1 or not np.all(numbers > 0.0):
        rule = "be a number greater than 0, or one for each joint"
        raise InputError(Problem(where, name, rule, shown(value)))
    return numbers.astype(np.float64)


def check_sample_time(where: str, value: float) -> float:
    """Return a sample time, s.

    Raises:
        InputError: it is not a positive finite time.
    """
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float | np.number)
        or not (np.isfinite(value) and value > 0)
    ):
        raise InputError(Problem(where, "sample_time", "be a positive time", shown(value)))
    return float(value)


def check_joints(where: str, joints: int, **given: FloatArray) -> None:
    """Refuse lists that do not have one number for each joint.

    Raises:
        InputError: so it is.
    """
    problems = [
        Problem(where, name, f"be one number, or one for each of {joints} joints", f"{v.size} long")
        for name, v in given.items()
        if v.ndim and v.size != joints
    ]
    if problems:
        raise InputError(*problems)
