"""External forces and moments on an arm, and their place in the kernels' arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_function, check_list_of, check_nonnegative
from flexarm.assemble import FloatArray, Piece
from flexarm.beams import LinkConstants
from flexarm.beams.shortening import shortening_matrices
from flexarm.coordinates import Coordinates
from flexarm.errors import InputError, Problem, check_array, is_count, shown
from flexarm.kernels.contact import LEVER, WEIGHT
from flexarm.kernels.layout import Contacts, Loads, empty_loads
from flexarm.model.tables import order_fault

FRAMES = ("world", "link")
#: Positions closer than this fraction of a length are equal, because sums of lengths are rounded.
SAME_PLACE = 1e-9
#: Gauss points on each piece of a distributed load: exact for the cubic shapes of an element.
_POINTS = 4

#: Times (k,) s and values (k,) or (k, columns): linear in between, constant beyond both ends.
Table = tuple[ArrayLike, ArrayLike]


@dataclass(frozen=True, eq=False)
class Load:
    """A force and a moment at a station of a link, or a distributed force on a part of it.

    Args:
        link: number of the link, counted from 1 at the base, as in results.
        force: (Fx, Fy) N; for a distributed load N/m.
        moment: N m, at the station; zero for a distributed load.
        station: distance from the link's root, m; None: its tip.
        spread: (start, end), m from the link's root, for a distributed load: the force is per
            length between them.
        frame: "world" keeps the direction, "link" rotates it with the root tangent of the link (of
            the segment that carries it).
        factor: factor of the load over time: a function, or a table ``(times, values)`` of two
            lists (s, 1), linear between the times and constant beyond the ends, where two equal
            times define a jump; None for a constant load.

    Raises:
        InputError: if a value is not finite, a station is negative, the frame is unknown, or the
            times of a table decrease.
    """

    link: int
    force: ArrayLike = (0.0, 0.0)
    moment: float = 0.0
    station: float | None = None
    spread: tuple[float, float] | None = None
    frame: str = "world"
    factor: Callable[[float], float] | Table | None = None

    def __post_init__(self) -> None:
        check_array("Load", "force", self.force, (2,))
        check_array("Load", "moment", self.moment, ())
        problems = []
        if not isinstance(self.frame, str) or self.frame not in FRAMES:
            rule = "be one of " + ", ".join(map(repr, FRAMES))
            problems.append(Problem("Load", "frame", rule, shown(self.frame)))
        if self.spread is not None:
            start, end = check_array("Load", "spread", self.spread, (2,))
            if not 0.0 <= start < end:
                rule = "be a start and an end beyond it, from the link's root"
                problems.append(Problem("Load", "spread", rule, shown(self.spread)))
            if self.station is not None or self.moment != 0.0:
                rule = "be left out of a load that has a station or a moment"
                problems.append(Problem("Load", "spread", rule, shown(self.spread)))
        if self.station is not None:
            check_nonnegative("Load", "station", self.station)
        if problems:
            raise InputError(*problems)
        if callable(self.factor):
            check_function("Load", "factor", self.factor)
        elif self.factor is not None:
            check_table("Load", "factor", self.factor, 1)

    @property
    def value(self) -> FloatArray:
        """Fx, Fy, Mz (3,)."""
        return np.append(np.asarray(self.force, dtype=np.float64), self.moment)


def is_table(value: Any) -> bool:
    """Return whether a value has the form of a table: a pair whose first item is a list."""
    if not isinstance(value, tuple | list) or len(value) != 2:
        return False
    return isinstance(value[0], tuple | list) or getattr(value[0], "ndim", 0) > 0


def check_table(where: str, name: str, table: object, columns: int) -> tuple[FloatArray, ...]:
    """Return the times (k,) and values (k, columns) of a table; one column may be given flat.

    Raises:
        InputError: if it is not a pair of equally long lists, or its times are not in order.
    """
    if not is_table(table):
        rule = "be a function of time or a table (times, values)"
        raise InputError(Problem(where, name, rule, shown(table)))
    times = check_array(where, f"{name}[0]", table[0], (-1,))  # type: ignore[index]
    shape = (times.size,) if columns == 1 else (times.size, columns)
    values = check_array(where, f"{name}[1]", table[1], shape)  # type: ignore[index]
    if times.size == 0:
        raise InputError(Problem(where, f"{name}[0]", "hold at least one time", "empty"))
    fault = order_fault(times.tolist())
    if fault is not None:
        k, rule = fault
        raise InputError(Problem(where, f"{name}[0][{k}]", rule, shown(float(times[k]))))
    return times, values.reshape(times.size, columns)


def tip_load(arm: Coordinates, where: str, tip_force: ArrayLike | None) -> list[Load]:
    """Return (Fx, Fy) or (Fx, Fy, Mz) on the last tip, world axes, as a list of at most one load.

    The list is empty for None.
    """
    if tip_force is None:
        return []
    force = check_array(where, "tip_force", tip_force, (-1,))
    size = force.size if force.size in (2, 3) else 3
    force = check_array(where, "tip_force", force, (size,))
    moment = float(force[2]) if size == 3 else 0.0
    return [Load(link=arm.links, force=force[:2], moment=moment)]


def acting_loads(
    arm: Coordinates, where: str, tip_force: ArrayLike | None, loads: Sequence[Load]
) -> list[Load]:
    """Return the force on the last tip and the loads in one list.

    Raises:
        InputError: if ``loads`` is not a list of `Load` objects.
    """
    return [*tip_load(arm, where, tip_force), *check_list_of(where, "loads", loads, Load)]


def place_loads(
    arm: Coordinates,
    where: str,
    loads: Sequence[Load],
    base_acceleration: ArrayLike | None = None,
    what: str = "Load",
) -> Loads:
    """Convert loads to the kernels' arrays; ``what`` is their name in messages.

    Raises:
        InputError: if a load is not on a link of the arm, or beyond its length.
    """
    parts: list[tuple[int, float, float, FloatArray, FloatArray, FloatArray, Load]] = []
    for load in loads:
        _check_place(arm, where, load, what)
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
    if base_acceleration is not None:
        placed.base_acceleration[:] = check_array(
            where, "base_acceleration", base_acceleration, (2,)
        )
    return placed


def parts_of(arm: Coordinates, loads: Sequence[Load]) -> list[Load]:
    """Return the load of each entry of placed loads: distributed ones may have several entries."""
    found: list[Load] = []
    for load in loads:
        found += [load] * (1 if load.spread is None else len(_spread(arm, load)))
    return found


def loads_inboard(
    arm: Coordinates, owners: Sequence[Load], placed: Loads, reach: FloatArray
) -> Loads:
    """Return the placed loads that act on each body between its root and a section.

    Args:
        owners: loads of the entries of ``placed``, from ``parts_of``.
        reach: (n,) m from each body's root to its section. A load at the same position is beyond
            the section; at the root, where ``reach`` is zero, it is inboard.

    Returns:
        Loads in the same order, in new arrays. Those beyond the section have weight 0, also
        contacts. The base acceleration is zero, because it is in the accelerations of the roots.
    """
    kept = empty_loads(arm.assembly.constants, placed.body.size)
    kept.body[:], kept.follower[:], kept.value[:] = placed.body, placed.follower, placed.value
    for k, load in enumerate(owners):
        piece, x = arm.assembly.piece_of(placed.body[k]), reach[placed.body[k]]
        same = SAME_PLACE * piece.shapes.length
        if load.spread is None:
            inside = _inboard(float(placed.lever[k]), x, same)
            share = placed if inside else kept
            kept.weight[k], kept.lever[k] = share.weight[k], share.lever[k]
            kept.rows[k], kept.shortening[k] = share.rows[k], share.shortening[k]
            continue
        start, end = _covered(load, piece)
        if min(end, x) > start:
            weight, lever, row, matrix = _integrals(piece.shapes, start, min(end, x))
            kept.weight[k], kept.lever[k] = weight, lever
            kept.rows[k, : row.size] = row
            if kept.shortening.shape[1]:
                kept.shortening[k, : row.size, : row.size] = matrix
    return kept._replace(contacts=_contacts_inboard(arm, placed.contacts, reach))


def _inboard(lever: float, reach: float, same: float) -> bool:
    """Return whether a point is inboard of a section by more than ``same``, or at the root."""
    return lever <= (same if reach <= same else reach - same)


def _contacts_inboard(arm: Coordinates, contacts: Contacts, reach: FloatArray) -> Contacts:
    law = contacts.law.copy()
    for row, body in zip(law, contacts.body, strict=True):
        same = SAME_PLACE * arm.assembly.piece_of(body).shapes.length
        row[WEIGHT] *= _inboard(row[LEVER], reach[body], same)
    return contacts._replace(law=law)


def _check_place(arm: Coordinates, where: str, load: Load, what: str) -> None:
    if not (is_count(load.link) and load.link <= arm.links):
        rule = f"be the number of a link, 1 to {arm.links}"
        raise InputError(Problem(where, f"{what}.link", rule, shown(load.link)))
    length = arm.spec.links[load.link - 1].length
    furthest = load.station if load.spread is None else load.spread[1]
    if furthest is not None and furthest > length * (1.0 + 1e-9):
        rule = f"lie within the link, whose length is {length:g}"
        name = f"{what}.station" if load.spread is None else f"{what}.spread"
        raise InputError(Problem(where, name, rule, shown(furthest)))


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
    return piece.body, 1.0, x, row, slope, matrix, load


@lru_cache(maxsize=128)
def _shapes_at(shapes: LinkConstants, x: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return deflections (m,), rotations (m,) and shortening (m, m) of the shapes at x (m).

    A search for an equilibrium places the same points hundreds of times.
    """
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
            weight, lever, row, matrix = _integrals(piece.shapes, start, end)
            parts.append((piece.body, weight, lever, row, np.zeros_like(row), matrix, load))
    return parts


def _covered(load: Load, piece: Piece) -> tuple[float, float]:
    """Return start and end (m) of a distributed load on a piece; no overlap if end <= start."""
    assert load.spread is not None
    start, end = load.spread
    return max(start - piece.start, 0.0), min(end - piece.start, piece.shapes.length)


def _integrals(
    shapes: LinkConstants, start: float, end: float
) -> tuple[float, float, FloatArray, FloatArray]:
    """Integrate 1, x, Phi (m,) and g (m, m) over an interval, element by element."""
    points, weights = np.polynomial.legendre.leggauss(_POINTS)
    ends = np.linspace(0.0, shapes.length, shapes.elements + 1)
    cuts = np.concatenate([[start], ends[(ends > start) & (ends < end)], [end]])
    half = np.diff(cuts)[:, None] / 2
    x = (cuts[:-1, None] + half + half * points).ravel()
    w = (half * weights).ravel()
    matrix = np.einsum("k,kij->ij", w, shortening_matrices(shapes, x))
    return float(w.sum()), float(w @ x), w @ shapes.deflection(x), matrix
