"""Search for a linear controller with a given disk margin for several arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_kind, check_number
from flexarm.base.errors import InputError, Problem
from flexarm.control.analysis.margins import loop_margins, named_arms
from flexarm.control.contract.base import Controller

C = TypeVar("C", bound=Controller)

#: Pairs of rigidity uncertainty and recovery, in increasing order of lost performance.
_TRIED = tuple(
    (unsure, recovery) for unsure in (0.0, 0.1, 0.3, 0.6, 1.0) for recovery in (0.0, 0.3, 1.0, 3.0)
)


def for_margin(
    kind: type[C],
    arm: Arm,
    posture: ArrayLike | None,
    plants: Arm | Sequence[Arm] | Mapping[str, Arm],
    disk_margin: float,
    postures: ArrayLike | None,
    options: dict[str, Any],
) -> C:
    """Return the first controller of ``_TRIED`` with the margin; see ``LQG.for_margin``.

    Raises:
        InputError: if no controller has the margin, an argument is wrong, or ``options`` has
            ``rigidity_uncertainty`` or ``recovery``.
    """
    rule = "be greater than 0 and less than 2"
    required = check_number("disk_margin", disk_margin, lambda margin: 0.0 < margin < 2.0, rule)
    for name in ("rigidity_uncertainty", "recovery"):
        if name in options:
            raise InputError(Problem(name, "is not supported, because the design searches for it"))
    arms = [check_kind("arm", arm, Arm), *named_arms(plants).values()]
    make: Any = kind
    best, found = -1.0, (0.0, 0.0)
    for unsure, recovery in _TRIED:
        made: C = make(arm, posture, rigidity_uncertainty=unsure, recovery=recovery, **options)
        margin = _least(made.at_rest(), arms, postures, best)  # type: ignore[attr-defined]
        if margin >= required:
            return made
        if margin > best:
            best, found = margin, (unsure, recovery)
    hint = (
        f"Best with rigidity_uncertainty={found[0]:g} and recovery={found[1]:g}. Accept larger "
        "deviations or less torque, or add gauges."
    )
    rule = f"of {required:g} cannot be reached: the best found is {best:.3g}"
    raise InputError(Problem("disk_margin", rule, hint=hint))


def _least(
    controller: Controller, arms: Sequence[Arm], postures: ArrayLike | None, enough: float
) -> float:
    """Return the least disk margin of several arms; stop early once it is at most ``enough``."""
    least = 2.0
    for arm in arms:
        least = min(least, float(loop_margins(controller, arm, postures).disk_margin.min()))
        if least <= enough:
            break
    return least
