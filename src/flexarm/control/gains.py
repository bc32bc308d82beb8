"""Checks of the gains and other arguments of controllers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_each, check_flag, check_mapping, check_numbers, check_positive
from flexarm.control.base import controller_problem
from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.hardware.measurement import FloatArray
from flexarm.model.wording import nearest


class Gains:
    """Collector of argument problems of one controller, to report all of them in one error."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._problems: list[Problem] = []

    def one(self, name: str, value: object, *, positive: bool = False) -> float:
        """Return a finite number, at least 0, or above 0 if ``positive``."""
        try:
            number = check_array(self._where, name, value, ())
        except InputError as error:
            self._problems += error.problems
            return 0.0
        return float(number) if self._in_range(name, value, number, positive) else 1.0

    def flag(self, name: str, value: object) -> bool:
        """Return a Boolean."""
        try:
            return check_flag(self._where, name, value)
        except InputError as error:
            self._problems += error.problems
            return False

    def mapping(self, name: str, value: object) -> dict[str, Any]:
        """Return values by name; an empty dictionary for None."""
        try:
            words = "names and values"
            return {} if value is None else dict(check_mapping(self._where, name, value, words))
        except InputError as error:
            self._problems += error.problems
            return {}

    def each(
        self,
        name: str,
        value: ArrayLike,
        count: int,
        *,
        positive: bool = False,
        negative: bool = False,
        what: str = "joint",
    ) -> FloatArray:
        """Return (count,) numbers, from one number for all or a list with one for each.

        They are at least 0; above 0 if ``positive``; of any sign if ``negative``.
        """
        try:
            numbers = check_each(self._where, name, value, count)
        except InputError as error:
            problems = error.problems
            if "finite" not in problems[0].rule:
                rule = f"be one number, or {count} numbers, one for each {what}"
                problems = (Problem(self._where, name, rule, shown(value)),)
            self._problems += problems
            return np.zeros(count)
        if not negative:
            self._in_range(name, value, numbers, positive)
        return np.array(np.broadcast_to(numbers, (count,)))

    def _in_range(self, name: str, value: object, numbers: FloatArray, positive: bool) -> bool:
        if np.any(numbers < 0.0) or (positive and np.any(numbers == 0.0)):
            rule = "be greater than 0" if positive else "be at least 0"
            self._problems.append(Problem(self._where, name, rule, shown(value)))
            return False
        return True

    def range(self, name: str, value: object) -> tuple[float, float]:
        """Return a lower and an upper bound; infinite ones are allowed."""
        try:
            pair = check_numbers(self._where, name, value)
        except InputError:
            pair = np.zeros(0)
        if pair.shape != (2,) or not pair[0] <= pair[1]:
            self.refuse(name, "be two numbers in increasing order", value)
            return -np.inf, np.inf
        return float(pair[0]), float(pair[1])

    def refuse(self, name: str, rule: str, value: object) -> None:
        """Add a problem."""
        self._problems.append(Problem(self._where, name, rule, shown(value)))

    def known(self, name: str, given: Iterable[str], choices: Iterable[str]) -> None:
        """Add a problem for each name that is not among the choices."""
        for item in given:
            if not isinstance(item, str) or item not in choices:
                rule, hint = f"be names from {', '.join(choices)}", nearest(item, choices)
                self._problems.append(Problem(self._where, name, rule, shown(item), hint))

    def controller(self, name: str, value: object) -> None:
        """Add a problem if a value is not a controller."""
        problem = controller_problem(self._where, name, value)
        if problem is not None:
            self._problems.append(problem)

    def done(self) -> None:
        """Raise one error with all problems, if there are any.

        Raises:
            InputError: if a problem was added.
        """
        if self._problems:
            raise InputError(*self._problems)


def check_gains(where: str, name: str, value: ArrayLike) -> FloatArray:
    """Return nonnegative gains, one number or one per joint.

    Raises:
        InputError: if a gain is negative, not finite or not a number.
    """
    gains = check_each(where, name, value)
    if np.any(gains < 0.0):
        raise InputError(Problem(where, name, "be finite gains, at least 0", shown(value)))
    return gains


def check_sample_time(where: str, value: float) -> float:
    """Return a sample time, s.

    Raises:
        InputError: if it is not positive and finite.
    """
    try:
        return check_positive(where, "sample_time", value)
    except InputError:
        raise InputError(
            Problem(where, "sample_time", "be a positive time", shown(value))
        ) from None


def check_joints(where: str, joints: int, **given: FloatArray) -> None:
    """Check that lists have one number for each joint.

    Raises:
        InputError: if the length of a list differs from ``joints``.
    """
    problems = [
        Problem(
            where,
            name,
            f"be one number, or one for each of the {joints} joints",
            f"{v.size} numbers",
        )
        for name, v in given.items()
        if v.ndim and v.size != joints
    ]
    if problems:
        raise InputError(*problems)
