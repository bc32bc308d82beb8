"""Joints of a scenario with a prescribed motion; the torque follows from the motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from flexarm.base.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.drives import CONTROLLED
from flexarm.model.quantities import Count, Listed, Number, length_of
from flexarm.model.wording import Fault, look


class _PrescribedJoint(Record):
    """Base of prescribed joints: the number of the joint."""

    joint: Count
    """Number of the joint, counted from 1 at the base."""


class HeldJoint(_PrescribedJoint):
    """A joint that is locked at its initial angle."""

    kind: Literal["hold"] = "hold"


class FollowingJoint(_PrescribedJoint):
    """A joint that follows its part of the motion of the scenario."""

    kind: Literal["motion"] = "motion"


class TabulatedJoint(_PrescribedJoint):
    """A joint that follows a cubic spline through tabulated angles."""

    kind: Literal["table"] = "table"
    times: Listed[Number]
    """Increasing times (s)."""
    angles: Listed[Number]
    """Relative joint angle at each time (rad)."""
    ends: Literal["rest", "free"] = "rest"
    """rest: the joint is at rest before and after the table; free: the table covers the whole
    run."""

    _columns: ClassVar[tuple[str, ...]] = ("times", "angles")

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        times, angles = length_of(given.raw("times")), length_of(given.raw("angles"))
        if times is not None and times < 2:
            yield Fault(("times",), "have at least two values", str(times))
        elif times is not None and angles is not None and angles != times:
            yield Fault(("angles",), f"have length {times}, one value for each time", str(angles))
        if given.has("times"):
            for k in range(1, len(given.times)):
                if given.times[k] <= given.times[k - 1]:
                    rule = f"be greater than {given.times[k - 1]:.9g} (the previous time)"
                    yield Fault(("times", k), rule, shown(given.times[k]))
                    break


PrescribedJoint = Annotated[
    HeldJoint | FollowingJoint | TabulatedJoint, Field(discriminator="kind")
]


def prescribed_faults(given: Given, turning: Sequence[int]) -> Iterator[Fault]:
    """Yield the faults between the prescribed joints of a scenario and its other parts.

    Args:
        turning: numbers of the joints that turn; empty if they are unknown.
    """
    if not given.has("prescribed") or not given.prescribed:
        return
    kind = look(given.raw("drive"), "kind")
    if isinstance(kind, str) and kind in CONTROLLED:
        yield Fault(("prescribed",), f"cannot be combined with drive {kind}")
    seen: dict[int, int] = {}
    for i, joint in enumerate(given.prescribed):
        place = ("prescribed", i, "joint")
        if turning and joint.joint not in turning:
            rule = f"be the number of a joint that is not fixed ({', '.join(map(str, turning))})"
            yield Fault(place, rule, shown(joint.joint))
        if joint.joint in seen:
            rule = f"repeats joint {joint.joint}, which is in prescribed[{seen[joint.joint]}]"
            yield Fault(place, rule)
        seen.setdefault(joint.joint, i)
        if joint.kind == "motion" and given.absent("motion"):
            yield Fault(("motion",), f"is required for prescribed[{i}]")
        if joint.kind == "table" and joint.ends == "free" and given.has("run"):
            yield from _coverage_faults(i, joint.times, given.run.duration)


def _coverage_faults(i: int, times: tuple[float, ...], duration: float) -> Iterator[Fault]:
    margin = 1e-9 * (times[-1] - times[0])
    if times[0] > margin or times[-1] < duration - margin:
        rule = f"cover the run from 0 to {duration:.9g} with 'ends: free'"
        value = f"{times[0]:.9g} to {times[-1]:.9g}"
        hint = "With 'ends: rest' the joint is at rest before and after the table."
        yield Fault(("prescribed", i, "times"), rule, value, hint)
