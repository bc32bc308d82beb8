"""Contacts between points of the arm and surfaces, and their place in the kernels' arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from flexarm.arguments import check_kind, check_list_of
from flexarm.coordinates import Coordinates
from flexarm.errors import InputError, Problem, check_array, is_count, shown
from flexarm.kernels.contact import (
    COUNT,
    CURVATURE,
    DAMPING,
    EXPONENT,
    FIRST,
    FRICTION,
    FRICTION_SPEED,
    LEVER,
    NORMAL,
    POINT,
    STIFFNESS,
    WEIGHT,
)
from flexarm.kernels.layout import Contacts, Loads, empty_contacts
from flexarm.loads import Load, place_loads
from flexarm.surfaces import RoundWall, Surface, SurfaceTable, Wall

_NUMBERS = ("station", "stiffness", "exponent", "damping", "friction", "friction_speed")
#: Bounds of the exponent: below one the stiffness would be infinite at the beginning of a contact.
LEAST_EXPONENT, MOST_EXPONENT = 1.0, 5.0


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact of a point on the axis of the arm with a surface.

    At a penetration depth d the surface pushes the point back along its normal with
    ``stiffness * d**exponent * (1 + damping * rate of d)`` and never pulls (Hunt and Crossley
    1975). Friction acts against the sliding motion with ``friction`` times the normal force; theory
    page "contact".

    Args:
        surface: `Wall`, `RoundWall` or `SurfaceTable`.
        stiffness: N/m, for another exponent N/m^exponent.
        link: number of the link, counted from 1 at the base; None: the last.
        station: distance of the point from the link's root, m; None: the link's tip.
        exponent: 1 for a spring, 1.5 for a ball on a plane (Hertz); 1 to 5.
        damping: s/m, 3/2 (1 - e) / (e v) for a coefficient of restitution e at an impact speed v:
            the error of the rebound speed is less than 0.003 v down to e = 0.7, and 0.013 v down
            to e = 0.5.
        friction: coefficient of Coulomb friction.
        friction_speed: m/s, sliding speed below which friction decreases to zero: the point creeps
            slowly where a real one would stick.

    Raises:
        InputError: if a value has the wrong type, is not finite, or is out of bounds.
    """

    surface: Surface
    stiffness: float
    link: int | None = None
    station: float | None = None
    exponent: float = 1.0
    damping: float = 0.0
    friction: float = 0.0
    friction_speed: float = 1e-3

    def __post_init__(self) -> None:
        problems: list[Problem] = []
        if not isinstance(self.surface, Wall | RoundWall | SurfaceTable):
            rule = "be a Wall, a RoundWall or a SurfaceTable"
            problems.append(Problem("Contact", "surface", rule, shown(self.surface)))
        if self.link is not None and not is_count(self.link):
            rule = "be the number of a link, 1 or more, or None for the last"
            problems.append(Problem("Contact", "link", rule, shown(self.link)))
        for name in _NUMBERS:
            if name == "station" and self.station is None:
                continue
            try:
                value = float(check_array("Contact", name, getattr(self, name), ()))
            except InputError as error:
                problems += error.problems
                continue
            rule = _bound_broken(name, value)
            if rule:
                problems.append(Problem("Contact", name, rule, shown(value)))
        if problems:
            raise InputError(*problems)

    def place(self, arm: Coordinates) -> Load:
        """Return the position on an arm, as a load without a value."""
        arm = check_kind("Contact.place", "arm", arm, Coordinates, "an Arm")
        return Load(arm.links if self.link is None else self.link, station=self.station)


def _bound_broken(name: str, value: float) -> str:
    """Return the rule that a number of a contact breaks, or an empty text."""
    if name in ("stiffness", "friction_speed"):
        return "" if value > 0.0 else "be greater than 0"
    if name == "exponent":
        inside = LEAST_EXPONENT <= value <= MOST_EXPONENT
        return "" if inside else f"be from {LEAST_EXPONENT:g} to {MOST_EXPONENT:g}"
    return "" if value >= 0.0 else "be at least 0"


def place_contacts(arm: Coordinates, where: str, contacts: Sequence[Contact]) -> Contacts:
    """Convert contacts to the kernels' arrays.

    Raises:
        InputError: if ``contacts`` is not a list of `Contact` objects, or a point is not on the
            arm.
    """
    contacts = check_list_of(where, "contacts", contacts, Contact)
    points = place_loads(arm, where, [contact.place(arm) for contact in contacts], what="Contact")
    tables = [c.surface.pieces for c in contacts if isinstance(c.surface, SurfaceTable)]
    pieces = sum(len(table) for table in tables)
    placed = empty_contacts(arm.assembly.constants, len(contacts), pieces)
    placed.body[:], placed.rows[:] = points.body, points.rows
    placed.shortening[:] = points.shortening
    first = 0
    for law, contact, lever in zip(placed.law, contacts, points.lever, strict=True):
        law[WEIGHT], law[LEVER] = 1.0, lever
        law[STIFFNESS], law[EXPONENT] = contact.stiffness, contact.exponent
        law[DAMPING] = contact.damping
        law[FRICTION], law[FRICTION_SPEED] = contact.friction, contact.friction_speed
        if isinstance(contact.surface, SurfaceTable):
            table = contact.surface.pieces
            law[FIRST], law[COUNT] = first, len(table)
            placed.knots[first : first + len(table)] = table
            first += len(table)
        else:
            curvature, point, normal = contact.surface.arc
            law[CURVATURE], law[POINT : POINT + 2], law[NORMAL : NORMAL + 2] = (
                curvature,
                point,
                normal,
            )
    return placed


def place_outside(
    arm: Coordinates,
    where: str,
    loads: Sequence[Load],
    base_acceleration: ArrayLike | None,
    contacts: Sequence[Contact],
) -> Loads:
    """Convert loads, the base acceleration and contacts to the kernels' arrays, for one state.

    Raises:
        InputError: as in ``place_loads`` and ``place_contacts``.
    """
    placed = place_loads(arm, where, loads, base_acceleration)
    if isinstance(contacts, list | tuple) and not contacts:
        return placed
    return placed._replace(contacts=place_contacts(arm, where, contacts))
