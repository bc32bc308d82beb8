"""Common options of commands: names, one number for each joint, and the posture of the arm."""

from __future__ import annotations

import math

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem, shown


def comma_separated(text: str) -> list[str]:
    """Return the names in a text, which commas separate."""
    return [part.strip() for part in text.split(",") if part.strip()]


def joint_numbers(option: str, arm: Arm, text: str | None, unit: str) -> list[float]:
    """Parse one number for each joint, separated by commas; return zeros for None.

    Raises:
        InputError: if the text is not one finite number for each joint.
    """
    if text is None:
        return [0.0] * arm.joints
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if not arm.joints:
        raise InputError(Problem(option, "is not supported for an arm whose joints are all fixed"))
    if len(values) != arm.joints or not all(math.isfinite(value) for value in values):
        rule = f"be {arm.joints} numbers separated by commas, one for each joint ({unit})"
        raise InputError(Problem(option, rule, shown(text)))
    return values


def at(angles: list[float]) -> str:
    """Return the posture as text for a title; empty for an arm without movable joints."""
    return f", at {listed(angles)} rad" if angles else ""


def listed(angles: list[float]) -> str:
    """Format angles as text, at most the first eight."""
    more = ", ..." if len(angles) > 8 else ""
    return ", ".join(f"{angle:.4g}" for angle in angles[:8]) + more
