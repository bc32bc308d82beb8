"""Options that several commands share: numbers for each joint, and where the arm is."""

from __future__ import annotations

import math

from flexarm.arm import Arm
from flexarm.errors import InputError, Problem, shown


def joint_numbers(where: str, option: str, arm: Arm, text: str | None, unit: str) -> list[float]:
    """Read one number for each joint, commas between; zeros for None.

    Raises:
        InputError: other than that many finite numbers.
    """
    if text is None:
        return [0.0] * arm.joints
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if not arm.joints:
        rule = "be left out: no joint of this arm turns"
        raise InputError(Problem(where, option, rule, shown(text)))
    if len(values) != arm.joints or not all(math.isfinite(value) for value in values):
        rule = f"be {arm.joints} numbers with commas between, one for each joint ({unit})"
        raise InputError(Problem(where, option, rule, shown(text)))
    return values


def at(angles: list[float]) -> str:
    """Where the arm is, for a title; nothing of an arm whose joints are all fixed."""
    return f", at {told(angles)} rad" if angles else ""


def told(angles: list[float]) -> str:
    """Angles as text, the first eight of many."""
    more = ", ..." if len(angles) > 8 else ""
    return ", ".join(f"{angle:.4g}" for angle in angles[:8]) + more
