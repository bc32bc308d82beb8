"""The place of contacts in the kernels' arrays, and the geometry of their surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from flexarm.arm.actions.loads import marker, place_loads
from flexarm.arm.assembly.assemble import FloatArray
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
from flexarm.model import Contact, Load, RoundWall, SurfaceTable, Wall

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


def point_of(arm: Coordinates, contact: Contact) -> Load:
    """Return the point of a contact on an arm, as a load of zero."""
    return marker(arm.links if contact.link is None else contact.link, contact.station)


def place_contacts(arm: Coordinates, contacts: Sequence[Contact]) -> Contacts:
    """Convert contacts to the kernels' arrays; InputError if a point is not on the arm."""
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


#: Maximum rotation (rad) of the tangent of a tabulated surface within a piece, so that the nearest
#: knot is a good initial value for Newton's method.
_TURN = 0.25
_MOST_CUTS = 64


def arc_of(surface: Wall | RoundWall) -> tuple[float, FloatArray, FloatArray]:
    """Return the curvature (1/m, negative inside a circle), a point (2,) m and the normal there."""
    if isinstance(surface, Wall):
        normal = np.asarray(surface.normal, dtype=np.float64)
        normal = normal / np.max(np.abs(normal))  # prevents an overflow of the squares
        return 0.0, np.asarray(surface.point, dtype=np.float64), normal / np.linalg.norm(normal)
    outward = np.array([1.0, 0.0])
    sign = -1.0 if surface.inside else 1.0
    point = np.asarray(surface.center, dtype=np.float64) + surface.radius * outward
    return sign / surface.radius, point, sign * outward


@lru_cache(maxsize=32)
def pieces_of(surface: SurfaceTable) -> FloatArray:
    """Return rows (pieces, 9) of the spline through the points of a surface; see ``_cut``."""
    from scipy.interpolate import CubicSpline

    points = np.array(surface.points)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    ends = "periodic" if surface.closed else "natural"
    spline = CubicSpline(np.append(0.0, np.cumsum(lengths)), points, bc_type=ends)
    return _cut(spline, surface.closed)


def _cut(spline: CubicSpline, closed: bool) -> FloatArray:
    """Return rows (pieces, 9): start (polygon length, m), cubics of x, y; open at both ends."""
    starts = []
    for a, b in zip(spline.x[:-1], spline.x[1:], strict=True):
        slopes = spline(np.linspace(a, b, 17), 1)
        angles = np.unwrap(np.arctan2(slopes[:, 1], slopes[:, 0]))
        turn = np.abs(np.diff(angles)).sum()
        cuts = min(_MOST_CUTS, max(1, int(np.ceil(turn / _TURN))))
        starts += np.linspace(a, b, cuts, endpoint=False).tolist()
    s = np.array(starts)
    powers = [spline(s, k) / factor for k, factor in enumerate((1.0, 1.0, 2.0))]
    # The third derivative is discontinuous at knots, so evaluate it inside each piece.
    ends = np.append(s[1:], spline.x[-1])
    powers.append(spline(0.5 * (s + ends), 3) / 6.0)
    rows = np.column_stack([s, *(np.stack(powers, axis=2).reshape(len(s), 8).T)])
    first, last = rows[:1].copy(), rows[-1:].copy()
    if closed:
        before, after = last, first
        before[0, 0] = rows[0, 0] - (spline.x[-1] - rows[-1, 0])
        after[0, 0] = spline.x[-1]
    else:
        before, after = first, last
        end = spline.x[-1]
        before[0, 3:5] = before[0, 7:9] = 0.0
        after[0] = 0.0
        after[0, 0] = end
        after[0, [1, 5]], after[0, [2, 6]] = spline(end), spline(end, 1)
    table: FloatArray = np.concatenate([before, rows, after])
    table.setflags(write=False)
    return table
