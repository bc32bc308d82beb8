"""Events of a scenario: a joint that reaches an angle, a tip that crosses a line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from flexarm.base.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Count, Direction, Flag, Number, Pair, Word
from flexarm.model.wording import Fault

#: Names of other ends of a run, not permitted for events.
DURATION, FAILURE = "duration", "failure"


def event_names(events: Sequence[Any]) -> list[str]:
    """Return the names of events: the given ones, or by default event_1 and so on."""
    return [event.name or f"event_{k}" for k, event in enumerate(events, start=1)]


class _Event(Record):
    """Base of events: name, direction of the crossing, and whether the run ends."""

    name: Word | None = None
    """Name in results; by default its number, such as event_1."""
    direction: Literal["both", "rising", "falling"] = "both"
    """Direction of the zero crossings that are located."""
    terminal: Flag = False
    """Whether the event ends the run."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("name") and given.name in (DURATION, FAILURE):
            rule = f"not be {DURATION!r} or {FAILURE!r} (other ends of a run)"
            yield Fault(("name",), rule, shown(given.name))


class JointEvent(_Event):
    """A joint passes an angle or reaches a stop; rising means an increasing angle."""

    kind: Literal["joint_angle"] = "joint_angle"
    joint: Count
    """Number of the joint, counted from 1 at the base."""
    angle: Number | None = None
    """Relative joint angle (rad)."""
    stop: Literal["lower", "upper"] | None = None
    """Limit of the joint, instead of an angle."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        yield from super()._faults(given)
        if given.absent("angle") and given.absent("stop"):
            yield Fault(("angle",), "is required if there is no stop")
        elif not given.absent("angle") and not given.absent("stop"):
            yield Fault(("angle",), "cannot be combined with stop")


class TipEvent(_Event):
    """The tip crosses a straight line; rising means along the normal."""

    kind: Literal["tip_line"] = "tip_line"
    point: Pair
    """Any point of the line [x, y], world frame (m)."""
    normal: Direction
    """Normal of the line [x, y], of any length."""


EventSpec = Annotated[JointEvent | TipEvent, Field(discriminator="kind")]


def event_faults(given: Given, turning: Sequence[int]) -> Iterator[Fault]:
    """Yield the faults of events whose name is not unique or that do not fit the arm.

    Args:
        turning: numbers of the joints that turn; empty if they are unknown.
    """
    if not given.has("events"):
        return
    names: list[str] = []
    for i, event in enumerate(given.events):
        name = event.name or f"event_{i + 1}"
        if name in names:
            rule = f"repeats {name!r}, the name of events[{names.index(name)}]"
            yield Fault(("events", i, "name"), rule)
        names.append(name)
        if event.kind != "joint_angle":
            continue
        if given.has("arm") and event.joint not in turning:
            known = ", ".join(map(str, turning)) or "there are none"
            rule = f"be the number of a joint that is not fixed ({known})"
            yield Fault(("events", i, "joint"), rule, shown(event.joint))
        elif event.stop and given.has("arm") and given.arm.joints[event.joint - 1].limits is None:
            rule = f"is not supported: joint {event.joint} has no limits"
            yield Fault(("events", i, "stop"), rule)
