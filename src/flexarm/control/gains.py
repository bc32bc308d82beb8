"""Checks that several controllers share."""

from __future__ import annotations

from collections.abc import Mapping

from flexarm.errors import Problem
from flexarm.model.quantities import length_of


def joint_problems(joints: int, given: Mapping[str, object]) -> list[Problem]:
    """Return a problem for each list that does not have one value for each joint."""
    rule = f"have length {joints}, one value for each joint"
    lengths = {name: length_of(value) for name, value in given.items()}
    wrong = {name: length for name, length in lengths.items() if length not in (None, joints)}
    return [Problem(name, rule, str(length)) for name, length in wrong.items()]
