"""External actions on an arm, as arrays of the kernels: loads, contacts, base acceleration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.assembly.assemble import FloatArray, Piece
from flexarm.arm.assembly.coordinates import Coordinates
from flexarm.arm.assembly.surfaces import surface_rows
from flexarm.arm.beams import LinkConstants
from flexarm.arm.beams.invariants import shortening_matrices
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import InputError, Problem, check_array, shown
from flexarm.kernels.forces.contact import (
    CORNER,
    CORNER_SHARE,
    DAMPING,
    EXPONENT,
    FRICTION,
    FRICTION_SPEED,
    LEVER,
    STIFFNESS,
    SURFACE,
    WEIGHT,
)
from flexarm.kernels.layout import Contacts, Loads, empty_contacts, empty_loads
from flexarm.model import AccelerationTable, Contact, Load
from flexarm.model.environment import place_faults_of

#: Positions closer than this fraction of a length are equal, because sums of lengths are rounded.
SAME_PLACE = 1e-9
#: Gauss points on each piece of a distributed load: exact for the cubic shapes of an element.
_POINTS = 4


def tip_load(arm: Coordinates, tip_force: ArrayLike | None) -> list[Load]:
    """Return (Fx, Fy) or (Fx, Fy, Mz) on the last tip, world axes, as a list: empty for None."""
    if tip_force is None:
        return []
    try:
        shape = np.shape(tip_force)
    except ValueError:  # rows of different lengths
        shape = ()
    if shape not in ((2,), (3,)):
        hint = "Pass a force elsewhere on the arm, or over time, as loads=[fa.Load(...)]."
        raise InputError(
            Problem("tip_force", "be (Fx, Fy) or (Fx, Fy, Mz)", shown(tip_force), hint)
        )
    force = check_array("tip_force", tip_force, shape)
    moment = float(force[2]) if force.size == 3 else 0.0
    return [Load(link=arm.n_links, force=tuple(force[:2].tolist()), moment=moment)]


def marker(link: int, station: float | None) -> Load:
    """Return a load of zero, which marks a point of an arm: ``station`` (m) from a link's root."""
    return Load(link=link, force=(0.0, 0.0), station=station)


def place_loads(arm: Coordinates, loads: Sequence[Load], what: str = "Load") -> Loads:
    """Convert loads to the kernels' arrays; InputError about ``what`` if one is not on the arm."""
    parts: list[tuple[int, float, float, FloatArray, FloatArray, FloatArray, Load]] = []
    for load in loads:
        problems = [fault.problem() for fault in place_faults_of(arm.spec, load)]
        if problems:
            raise InputError(*(replace(p, name=f"{what}.{p.name}") for p in problems))
        if load.spread is None:
            parts.append(_point(arm, load))
        else:
            parts += _spread(arm, load)
    placed = empty_loads(arm.assembly.constants, len(parts))
    for k, (body, weight, lever, row, slope, matrix, load) in enumerate(parts):
        placed.body[k], placed.weight[k], placed.lever[k] = body, weight, lever
        placed.rows[k, : row.size] = row
        placed.slopes[k, : slope.size] = slope
        if placed.shortening.shape[1]:
            placed.shortening[k, : row.size, : row.size] = matrix
        placed.follower[k] = float(load.frame == "link")
        placed.value[k] = load.value
    return placed


def parts_of(arm: Coordinates, loads: Sequence[Load]) -> list[Load]:
    """Return the load of each entry of placed loads: distributed ones may have several entries."""
    parts: list[Load] = []
    for load in loads:
        parts += [load] * (1 if load.spread is None else len(_spread(arm, load)))
    return parts


def loads_inboard(
    arm: Coordinates, owners: Sequence[Load], placed: Loads, reach: FloatArray
) -> Loads:
    """Return the placed loads that act on each body between its root and a section.

    ``owners`` are the loads of the entries of ``placed``, ``reach`` (n,) m the distance from the
    root of each body's piece to its section. A load at the same position is beyond the section; at
    the root, where ``reach`` is zero, it is inboard. Loads beyond the section, and contacts, have
    weight 0. The base acceleration is zero, because it is in the accelerations of the roots.
    """
    kept = empty_loads(arm.assembly.constants, placed.body.size)
    kept.body[:], kept.follower[:], kept.value[:] = placed.body, placed.follower, placed.value
    for k, load in enumerate(owners):
        piece, x = arm.assembly.piece_of(placed.body[k]), reach[placed.body[k]]
        same = SAME_PLACE * piece.shapes.length
        if load.spread is None:
            inside = _inboard(float(placed.lever[k]) - piece.offset, x, same)
            share = placed if inside else kept
            kept.weight[k], kept.lever[k] = share.weight[k], share.lever[k]
            kept.rows[k], kept.shortening[k] = share.rows[k], share.shortening[k]
            continue
        start, end = _covered(load, piece)
        if min(end, x) > start:
            weight, lever, row, matrix = _integrals(piece, start, min(end, x))
            kept.weight[k], kept.lever[k] = weight, lever
            kept.rows[k, : row.size] = row
            if kept.shortening.shape[1]:
                kept.shortening[k, : row.size, : row.size] = matrix
    law = placed.contacts.law.copy()
    for row, body in zip(law, placed.contacts.body, strict=True):
        piece = arm.assembly.piece_of(body)
        same = SAME_PLACE * piece.shapes.length
        row[WEIGHT] *= _inboard(row[LEVER] - piece.offset, reach[body], same)
    return kept._replace(contacts=placed.contacts._replace(law=law))


def _inboard(lever: float, reach: float, same: float) -> bool:
    """Return whether a point is inboard of a section by more than ``same``, or at the root."""
    return lever <= (same if reach <= same else reach - same)


def _point(
    arm: Coordinates, load: Load
) -> tuple[int, float, float, FloatArray, FloatArray, FloatArray, Load]:
    link = load.link - 1
    station = arm.spec.links[link].length if load.station is None else float(load.station)
    piece = arm.assembly.piece_at(link, station)
    if load.station is None:
        piece = arm.assembly.pieces_of(link)[-1]
    shapes, x = piece.shapes, float(min(station - piece.start, piece.shapes.length))
    row, slope, matrix = _shapes_at(shapes, x)
    if load.station is None:
        row, slope = shapes.P, shapes.dP
    return piece.body, 1.0, piece.offset + x, row, slope, matrix, load


@lru_cache(maxsize=128)
def _shapes_at(shapes: LinkConstants, x: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return deflections (m,), rotations (m,) and shortening (m, m) of the shapes at x (m)."""
    at = np.array([x])
    # A moment acts on the rotation.
    return shapes.deflection(at)[0], shapes.rotation(at)[0], shortening_matrices(shapes, at)[0]


def _spread(
    arm: Coordinates, load: Load
) -> list[tuple[int, float, float, FloatArray, FloatArray, FloatArray, Load]]:
    """Integrate over the loaded part of each piece, element by element."""
    assert load.spread is not None
    parts = []
    for piece in arm.assembly.pieces_of(load.link - 1):
        start, end = _covered(load, piece)
        if end > start:
            weight, lever, row, matrix = _integrals(piece, start, end)
            parts.append((piece.body, weight, lever, row, np.zeros_like(row), matrix, load))
    return parts


def _covered(load: Load, piece: Piece) -> tuple[float, float]:
    """Return start and end (m) of a distributed load on a piece; no overlap if end <= start."""
    assert load.spread is not None
    start, end = load.spread
    return max(start - piece.start, 0.0), min(end - piece.start, piece.shapes.length)


def _integrals(
    piece: Piece, start: float, end: float
) -> tuple[float, float, FloatArray, FloatArray]:
    """Integrate 1, x, Phi (m,), g (m, m) from the root of the piece, element by element."""
    shapes = piece.shapes
    points, weights = np.polynomial.legendre.leggauss(_POINTS)
    ends = np.linspace(0.0, shapes.length, shapes.elements + 1)
    cuts = np.concatenate([[start], ends[(ends > start) & (ends < end)], [end]])
    half = np.diff(cuts)[:, None] / 2
    x = (cuts[:-1, None] + half + half * points).ravel()
    w = (half * weights).ravel()
    matrix = np.einsum("k,kij->ij", w, shortening_matrices(shapes, x))
    return float(w.sum()), float(w @ (piece.offset + x)), w @ shapes.deflection(x), matrix


def point_of(arm: Coordinates, contact: Contact) -> Load:
    """Return the point of a contact on an arm, as a load of zero."""
    return marker(arm.n_links if contact.link is None else contact.link, contact.station)


def place_contacts(arm: Coordinates, contacts: Sequence[Contact]) -> Contacts:
    """Convert contacts to the kernels' arrays; InputError if a point is not on the arm."""
    marks = [point_of(arm, contact) for contact in contacts]
    points = place_loads(arm, marks, what="Contact")
    rows, knots = surface_rows([contact.surface for contact in contacts])
    placed = empty_contacts(arm.assembly.constants, len(contacts), len(knots))
    placed.body[:], placed.rows[:] = points.body, points.rows
    placed.shortening[:] = points.shortening
    placed.knots[:] = knots
    placed.law[:, SURFACE : SURFACE + rows.shape[1]] = rows
    for law, contact, lever in zip(placed.law, contacts, points.lever, strict=True):
        law[WEIGHT], law[LEVER], law[CORNER] = 1.0, lever, CORNER_SHARE * arm.reach
        law[STIFFNESS], law[EXPONENT] = contact.stiffness, contact.exponent
        law[DAMPING] = contact.damping
        law[FRICTION], law[FRICTION_SPEED] = contact.friction, contact.friction_speed
    return placed


#: Acceleration (2,) m/s^2 in world axes, a function of time (s) that returns it, or a table.
BaseAcceleration = ArrayLike | Callable[[float], ArrayLike] | AccelerationTable


@dataclass(frozen=True, eq=False)
class Environment:
    """External actions on an arm.

    Public functions take them as separate arguments and combine them at once with ``of``; all
    other functions pass the environment on.
    """

    loads: Sequence[Load] = ()  # forces and moments, including the force at the tip
    base_acceleration: BaseAcceleration | None = None  # None for a base at rest
    contacts: Sequence[Contact] = ()  # of points of the arm with surfaces

    @classmethod
    def of(
        cls,
        arm: Coordinates,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: BaseAcceleration | None = None,
        contacts: Sequence[Contact] = (),
    ) -> Environment:
        """Combine the arguments of a public function, after validation.

        ``tip_force`` is (Fx, Fy) or (Fx, Fy, Mz) on the last tip, world axes, N and N m.
        """
        return cls(
            [*tip_load(arm, tip_force), *check_list_of("loads", loads, Load)],
            base_acceleration,
            check_list_of("contacts", contacts, Contact),
        )

    def placed(self, arm: Coordinates) -> Loads:
        """Return the kernels' arrays for one state; time factors of loads are ignored."""
        placed = place_loads(arm, self.loads)
        base = self.base_acceleration
        if base is not None:
            placed.base_acceleration[:] = check_array("base_acceleration", base, (2,))
        if not self.contacts:
            return placed
        return placed._replace(contacts=place_contacts(arm, self.contacts))


#: The environment of an arm on which nothing acts except gravity.
EMPTY = Environment()
