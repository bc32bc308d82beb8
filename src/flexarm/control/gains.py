"""Numbers that controllers are given, checked."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from flexarm.control.base import controller_problem
from flexarm.control.measurement import FloatArray
from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.model.wording import nearest


class Gains:
    """Collects what is wrong with the arguments of one controller, to tell it all at once."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._problems: list[Problem] = []

    def one(self, name: str, value: object, *, positive: bool = False) -> float:
        """Return a finite number, at least 0 or greater."""
        return float(self._numbers(name, value, (), positive))

    def each(
        self,
        name: str,
        value: ArrayLike,
        count: int,
        *,
        positive: bool = False,
        what: str = "joint",
    ) -> FloatArray:
        """Return (count,) numbers, from one for all or a list with one for each."""
        shape = () if np.ndim(value) == 0 else (count,)
        try:
            numbers = self._numbers(name, value, shape, positive)
        except InputError:
            rule = f"be one number, or one for each {what}: {count}"
            self._problems.append(Problem(self._where, name, rule, shown(value)))
            return np.zeros(count)
        return np.array(np.broadcast_to(numbers, (count,)))

    def _numbers(
        self, name: str, value: object, shape: tuple[int, ...], positive: bool
    ) -> FloatArray:
        try:
            numbers = check_array(self._where, name, value, shape)
        except InputError as error:
            if shape:
                raise
            self._problems += error.problems
            return np.zeros(())
        if np.any(numbers < 0.0) or (positive and np.any(numbers == 0.0)):
            rule = "be greater than 0" if positive else "be at least 0"
            self._problems.append(Problem(self._where, name, rule, shown(value)))
        return numbers

    def refuse(self, name: str, rule: str, value: object) -> None:
        """Note one more problem."""
        self._problems.append(Problem(self._where, name, rule, shown(value)))

    def known(self, name: str, given: Iterable[str], choices: Iterable[str]) -> None:
        """Refuse names that are not among the choices."""
        for item in given:
            if item not in choices:
                rule, hint = f"be names out of {', '.join(choices)}", nearest(item, choices)
                self._problems.append(Problem(self._where, name, rule, shown(item), hint))

    def controller(self, name: str, value: object) -> None:
        """Refuse what is no controller."""
        problem = controller_problem(self._where, name, value)
        if problem is not None:
            self._problems.append(problem)

    def done(self) -> None:
        """Tell what was wrong.

        Raises:
            InputError: something was.
        """
        if self._problems:
            raise InputError(*self._problems)


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
