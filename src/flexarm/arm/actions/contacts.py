"""The place of contacts in the kernels' arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexarm.arm.actions.loads import marker, place_loads
from flexarm.arm.actions.surfaces import arc_of, pieces_of
from flexarm.arm.assembly.coordinates import Coordinates
from flexarm.kernels.forces.contact import (
    CORNER,
    CORNER_SHARE,
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
from flexarm.kernels.layout import Contacts, empty_contacts
from flexarm.model import Contact, Load, SurfaceTable


def point_of(arm: Coordinates, contact: Contact) -> Load:
    """Return the point of a contact on an arm, as a load of zero."""
    return marker(arm.links if contact.link is None else contact.link, contact.station)


def place_contacts(arm: Coordinates, contacts: Sequence[Contact]) -> Contacts:
    """Convert contacts to the kernels' arrays.

    Raises:
        InputError: if a point is not on the arm.
    """
    marks = [point_of(arm, contact) for contact in contacts]
    points = place_loads(arm, marks, what="Contact")
    tables = [pieces_of(c.surface) for c in contacts if isinstance(c.surface, SurfaceTable)]
    pieces = sum(len(table) for table in tables)
    placed = empty_contacts(arm.assembly.constants, len(contacts), pieces)
    placed.body[:], placed.rows[:] = points.body, points.rows
    placed.shortening[:] = points.shortening
    first = 0
    for law, contact, lever in zip(placed.law, contacts, points.lever, strict=True):
        law[WEIGHT], law[LEVER], law[CORNER] = 1.0, lever, CORNER_SHARE * float(np.sum(arm.lengths))
        law[STIFFNESS], law[EXPONENT] = contact.stiffness, contact.exponent
        law[DAMPING] = contact.damping
        law[FRICTION], law[FRICTION_SPEED] = contact.friction, contact.friction_speed
        if isinstance(contact.surface, SurfaceTable):
            table = pieces_of(contact.surface)
            law[FIRST], law[COUNT] = first, len(table)
            placed.knots[first : first + len(table)] = table
            first += len(table)
        else:
            curvature, point, normal = arc_of(contact.surface)
            law[CURVATURE], law[POINT : POINT + 2], law[NORMAL : NORMAL + 2] = (
                curvature,
                point,
                normal,
            )
    return placed
