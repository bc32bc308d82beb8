"""Checks that several controllers share."""

from __future__ import annotations

from collections.abc import Mapping

from flexarm.arguments import check_positive
from flexarm.errors import InputError, Problem, shown
from flexarm.model.quantities import length_of


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


def joint_problems(where: str, joints: int, given: Mapping[str, object]) -> list[Problem]:
    """Return a problem for each list that does not have one value for each joint."""
    rule = f"have length {joints}, one value for each joint"
    lengths = {name: length_of(value) for name, value in given.items()}
    wrong = {name: length for name, length in lengths.items() if length not in (None, joints)}
    return [Problem(where, name, rule, str(length)) for name, length in wrong.items()]
