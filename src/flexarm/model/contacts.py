"""Contacts of a scenario: surfaces, and the contact law."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from flexarm.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import (
    Count,
    Flag,
    Listed,
    NonNegative,
    Number,
    Pair,
    Positive,
    finite,
    length_of,
)
from flexarm.model.wording import Fault

Exponent = Annotated[float, Field(ge=1, le=5), BeforeValidator(finite)]


class WallSpec(Record):
    """A straight surface; the half-plane behind it, opposite to the normal, is solid."""

    kind: Literal["wall"] = "wall"
    point: Pair = Field(description="Any point on it [x, y], world frame (m).")
    normal: Pair = Field(description="Direction away from it [x, y], of any length.")

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("normal") and not any(given.normal):
            yield Fault(("normal",), "have a length greater than 0", shown(list(given.normal)))


class RoundWallSpec(Record):
    """A circular surface with contact from outside (a post) or from inside (a round room)."""

    kind: Literal["round"] = "round"
    center: Pair = Field(description="Centre [x, y], world frame (m).")
    radius: Positive = Field(description="Radius (m).")
    inside: Flag = Field(default=False, description="Whether the arm is inside of it.")


class SurfaceTableSpec(Record):
    """A smooth curve through points; the side to the right of its direction is solid."""

    kind: Literal["table"] = "table"
    x: Listed[Number] = Field(description="x of three points or more (m).")
    y: Listed[Number] = Field(description="y of each point (m).")
    closed: Flag = Field(
        default=False, description="Whether it goes on from the last point to the first."
    )

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        x, y = length_of(given.raw("x")), length_of(given.raw("y"))
        if x is not None and x < 3:
            yield Fault(("x",), "have at least three points", str(x))
        elif x is not None and y is not None and x != y:
            yield Fault(("y",), f"have length {x}, one value for each point", str(y))
        elif given.has("x", "y"):
            points = list(zip(given.x, given.y, strict=True))
            for k in range(1, len(points)):
                if points[k] == points[k - 1]:
                    rule = "differ from the previous point in x or y"
                    yield Fault(("x", k), rule, shown(points[k][0]))
                    return


SurfaceSpec = Annotated[WallSpec | RoundWallSpec | SurfaceTableSpec, Field(discriminator="kind")]


class ContactSpec(Record):
    """Contact between a point of a link and a surface, and its contact law."""

    surface: SurfaceSpec = Field(description="What it may touch.")
    stiffness: Positive = Field(
        description="Force per depth (N/m); per depth to the exponent, N/m^exponent."
    )
    link: Count | None = Field(
        default=None, description="Number of the link, counted from 1 at the base; the last one."
    )
    station: NonNegative | None = Field(
        default=None, description="Distance from the link's root (m); the tip where left out."
    )
    exponent: Exponent = Field(
        default=1.0, description="Power of the depth: 1 for a spring, 1.5 for a ball on a plane."
    )
    damping: NonNegative = Field(
        default=0.0, description="Rise of the force per speed of going in (s/m)."
    )
    friction: NonNegative = Field(default=0.0, description="Coefficient of Coulomb friction.")
    friction_speed: Positive = Field(
        default=1e-3, description="Speed of sliding below which friction fades (m/s)."
    )


def contact_faults(given: Given) -> Iterator[Fault]:
    """Yield the contacts of a scenario that are not on its arm."""
    if not given.has("arm", "contacts"):
        return
    links = given.arm.links
    for i, contact in enumerate(given.contacts):
        number = len(links) if contact.link is None else contact.link
        if number > len(links):
            rule = f"be the number of a link, 1 to {len(links)}"
            yield Fault(("contacts", i, "link"), rule, shown(number))
            continue
        length = links[number - 1].length
        if contact.station is not None and contact.station > length * (1.0 + 1e-9):
            rule = f"be at most {length:.9g}, the length of the link"
            yield Fault(("contacts", i, "station"), rule, shown(contact.station))
