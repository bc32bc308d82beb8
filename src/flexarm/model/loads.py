"""External actions on an arm in a scenario: loads, and acceleration of the base."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from flexarm.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Count, NonNegative, Number, Pair, plain
from flexarm.model.spec import ArmSpec
from flexarm.model.tables import AccelerationTable, FactorTable
from flexarm.model.wording import Fault


class LoadSpec(Record):
    """A force and a moment at a station of a link, or a distributed force along part of it."""

    link: Count = Field(description="Number of the link, counted from 1 at the base.")
    force: Pair | None = Field(
        default=None, description="Force [x, y] (N); per length, N/m, where spread is given."
    )
    moment: Number | None = Field(default=None, description="Moment at the station (N m).")
    station: NonNegative | None = Field(
        default=None, description="Distance from the link's root (m); the tip where left out."
    )
    spread: Pair | None = Field(
        default=None,
        description="Start and end (m) from the link's root, between which the force is spread.",
    )
    frame: Literal["world", "link"] = Field(
        default="world",
        description="Whether the force keeps its direction (world) or turns with the link's root "
        "tangent (link).",
    )
    factor: FactorTable | None = Field(
        default=None, description="What scales the load over time; constant where left out."
    )

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.absent("force") and given.absent("moment"):
            yield Fault(("force",), "is required without a moment")
        if given.absent("spread"):
            return
        for name in ("station", "moment"):
            if not given.absent(name):
                yield Fault((name,), "cannot be combined with spread")
        if given.absent("force") and not given.absent("moment"):
            yield Fault(("force",), "is required with spread")
        if given.has("spread") and not 0.0 <= given.spread[0] < given.spread[1]:
            rule = "be two increasing distances from the root of the link"
            yield Fault(("spread",), rule, shown(list(given.spread)))


def _pair_or_table(value: Any) -> str:
    return "<table>" if isinstance(plain(value), dict | AccelerationTable) else "<pair>"


BaseAcceleration = Annotated[
    Annotated[Pair, Tag("<pair>")] | Annotated[AccelerationTable, Tag("<table>")],
    Discriminator(_pair_or_table),
]


def load_faults(given: Given) -> Iterator[Fault]:
    """Yield the faults of loads of a scenario that are not on its arm."""
    if given.has("arm", "loads"):
        yield from off_the_arm(given.arm, given.loads)


def off_the_arm(arm: ArmSpec, loads: Sequence[LoadSpec]) -> Iterator[Fault]:
    """Yield the faults of ``loads`` that are not on an arm."""
    links = arm.links
    for i, load in enumerate(loads):
        if load.link > len(links):
            rule = f"be the number of a link, 1 to {len(links)}"
            yield Fault(("loads", i, "link"), rule, shown(load.link))
            continue
        length = links[load.link - 1].length
        name = "station" if load.spread is None else "spread"
        furthest = load.station if load.spread is None else load.spread[1]
        if furthest is not None and furthest > length * (1.0 + 1e-9):
            rule = f"be at most {length:.9g}, the length of the link"
            yield Fault(("loads", i, name), rule, shown(furthest))
