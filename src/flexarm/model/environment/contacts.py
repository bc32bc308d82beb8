"""Contacts: surfaces (fixed in the axes of the arm's base), and the contact law."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, Field

from flexarm.model.arm.spec import place_faults
from flexarm.model.checks import Given, Record
from flexarm.model.environment.polygon import closed_polygon, polygon_faults
from flexarm.model.quantities import (
    Count,
    Direction,
    Finite,
    Flag,
    Listed,
    NonNegative,
    Number,
    Pair,
    Positive,
    length_of,
    plain,
)
from flexarm.model.wording import Fault

Exponent = Annotated[Finite, Field(ge=1, le=5), BeforeValidator(plain)]


class Wall(Record, kw_only=False):
    """A straight surface; the half-plane behind it, opposite to the normal, is solid."""

    kind: Literal["wall"] = Field(default="wall", kw_only=True)
    point: Pair
    """Any point on it [x, y], world frame (m)."""
    normal: Direction
    """Normal out of the solid [x, y], of any length."""


class RoundWall(Record, kw_only=False):
    """A circular surface with contact from outside (a post) or from inside (a round room)."""

    kind: Literal["round"] = Field(default="round", kw_only=True)
    center: Pair
    """Centre [x, y], world frame (m)."""
    radius: Positive
    """Radius (m)."""
    inside: Flag = False
    """Whether the arm is inside the circle."""


class SurfaceTable(Record, kw_only=False):
    """A smooth curve through points; the side to the right of its direction is solid.

    The curve is a cubic spline over the length of the polygon through the points. A profile with
    increasing x is therefore solid below. An open curve continues straight beyond its ends. The
    arm is inside a closed curve that runs counter-clockwise, and outside a clockwise one.
    """

    kind: Literal["table"] = Field(default="table", kw_only=True)
    x: Listed[Number]
    """x of at least three points (m)."""
    y: Listed[Number]
    """y of each point (m); consecutive points differ."""
    closed: Flag = False
    """Whether the last point is connected to the first."""

    _columns: ClassVar[tuple[str, ...]] = ("x", "y")

    @property
    def points(self) -> list[tuple[float, float]]:
        """The points; those of a closed curve begin and end with the same one."""
        if self.closed:
            return closed_polygon(self.x, self.y)
        return list(zip(self.x, self.y, strict=True))

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        x, y = length_of(given.raw("x")), length_of(given.raw("y"))
        if x is not None and x < 3:
            yield Fault(("x",), "have at least three points", str(x))
        elif x is not None and y is not None and x != y:
            yield Fault(("y",), f"have length {x}, one value for each point", str(y))
        elif given.has("x", "y"):
            yield from polygon_faults(given.x, given.y, given.has("closed") and given.closed)


Surface = Annotated[Wall | RoundWall | SurfaceTable, Field(discriminator="kind")]


class Contact(Record, kw_only=False):
    """Contact of a point on the axis of the arm with a surface.

    At a penetration depth d the surface pushes the point back along its normal with
    ``stiffness * d**exponent * (1 + damping * rate of d)`` and never pulls (Hunt and Crossley
    1975). Friction acts against the sliding motion with ``friction`` times the normal force; theory
    page "contact". A damping of 3/2 (1 - e) / (e v) gives a coefficient of restitution e at an
    impact speed v; the error of the rebound speed is less than 0.003 v down to e = 0.7, and
    0.013 v down to e = 0.5.
    """

    surface: Surface
    """Surface of the contact."""
    stiffness: Positive
    """Force per depth (N/m); with exponent, per depth to that power, N/m^exponent."""
    link: Count | None = None
    """Number of the link, counted from 1 at the base; by default the last one."""
    station: NonNegative | None = None
    """Distance from the root of the link (m); by default its tip."""
    exponent: Exponent = 1.0
    """Exponent of the depth: 1 for a spring, 1.5 for a sphere on a plane."""
    damping: NonNegative = 0.0
    """Relative increase of the force per speed of penetration (s/m)."""
    friction: NonNegative = 0.0
    """Coefficient of Coulomb friction."""
    friction_speed: Positive = 1e-3
    """Sliding speed below which the friction force decreases to zero (m/s)."""

    _hints: ClassVar[dict[str, str]] = {
        "surface": "A surface is a Wall, a RoundWall or a SurfaceTable.",
    }


def contact_faults(given: Given) -> Iterator[Fault]:
    """Yield the contacts of a scenario that are not on its arm."""
    if not given.has("arm", "contacts"):
        return
    for i, contact in enumerate(given.contacts):
        link = len(given.arm.links) if contact.link is None else contact.link
        for fault in place_faults(given.arm, link, contact.station):
            yield fault.inside("contacts", i)
