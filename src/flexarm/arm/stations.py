"""Stations along the links, and the parts of the links inboard of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flexarm.arm.actions import SAME_PLACE, loads_inboard, parts_of
from flexarm.arm.assembly.assemble import FloatArray, IntArray, move_masses, place_inertia
from flexarm.arm.assembly.coordinates import Coordinates
from flexarm.arm.beams.invariants import (
    PartConstants,
    part_constants,
    shortening_matrices,
)
from flexarm.base.arguments import check_count
from flexarm.base.errors import InputError, Problem, shown
from flexarm.kernels import layout
from flexarm.kernels.observation.section_forces import section_forces
from flexarm.model import Load

#: Maximum number of stations on a link; more give no information, because elements are smooth.
MOST_STATIONS = 1000


def check_stations(stations: object) -> int:
    """Return the number of stations of each link, 0 for none; InputError if it is 1, or wrong."""
    count = check_count("stations", stations, 0, MOST_STATIONS)
    if count == 1:
        raise InputError(Problem("stations", "be 0, or at least 2 (root and tip)", "1"))
    return count


@dataclass(frozen=True, eq=False)
class Cut:
    """One section on each link, and the constants of the links' parts inboard of it."""

    stations: layout.Stations  # the sections, (links,) in total
    #: Constants of bodies that end at their section; those of bodies without a section are
    #: meaningless
    constants: layout.ArmConstants
    sizes: layout.Sizes  # sizes of these constants
    #: (n,) m from the root of each body's piece to its section; 0 without a section
    reach: FloatArray


def place_stations(arm: Coordinates, count: int) -> layout.Stations:
    """Divide each link evenly by ``count`` stations, including root and tip: (links * count,)."""
    # A station between two segments is the tip of the inboard one.
    m, g = arm.assembly.modes, arm.assembly.constants.D0.shape[1]
    total = arm.n_links * count
    placed = layout.Stations(
        body=np.zeros(total, dtype=np.intp),
        x=np.zeros(total),
        rows=np.zeros((total, m)),
        turns=np.zeros((total, m)),
        shortening=np.zeros((total, g, g)),
    )
    for i, link in enumerate(arm.spec.links):
        pieces, stations = arm.assembly.pieces_of(i), np.linspace(0.0, link.length, count)
        starts, lengths = np.array([(p.start, p.shapes.length) for p in pieces]).T
        first = np.searchsorted(starts + lengths, stations - SAME_PLACE * link.length)
        chosen, link_rows = np.minimum(first, len(pieces) - 1), slice(i * count, (i + 1) * count)
        placed.body[link_rows] = np.array([p.body for p in pieces])[chosen]
        placed.x[link_rows] = np.clip(stations - starts[chosen], 0.0, lengths[chosen])
    for piece in arm.assembly.pieces:
        here, k = np.flatnonzero(placed.body == piece.body), piece.shapes.w2.size
        if k and here.size:
            placed.rows[here, :k] = piece.shapes.deflection(placed.x[here])
            placed.turns[here, :k] = piece.shapes.rotation(placed.x[here])
        if k and g and here.size:
            placed.shortening[here, :k, :k] = shortening_matrices(piece.shapes, placed.x[here])
        placed.x[here] += piece.offset
    return placed


def place_gauges(
    arm: Coordinates, gauges: Sequence[tuple[int, float, float]]
) -> tuple[FloatArray, IntArray]:
    """Return strain per modal coordinate at gauges (link, station m, distance m), and bodies."""
    rows = np.zeros((len(gauges), arm.assembly.modes))
    bodies = np.zeros(len(gauges), dtype=np.intp)
    for k, (i, station, distance) in enumerate(gauges):
        piece = arm.assembly.piece_at(i, station)
        bodies[k] = piece.body
        if piece.shapes.w2.size:
            curvature = piece.shapes.recovered_curvature([station - piece.start])[0]
            with np.errstate(over="ignore"):
                rows[k, : curvature.size] = -distance * curvature
            if not np.isfinite(rows[k]).all():
                rule = "be small enough for finite strains"
                raise InputError(Problem("gauges.distance", rule, shown(distance)))
    return rows, bodies


def cuts_at(arm: Coordinates, count: int) -> tuple[Cut, ...]:
    """Return ``count`` cuts; cut k contains the section at station k of every link."""
    placed = place_stations(arm, count)
    whole = arm.assembly.constants
    n, m = whole.S.shape
    cuts = []
    for k in range(count):
        constants = whole._replace(
            body=whole.body.copy(),
            mode=whole.mode.copy(),
            shortening=whole.shortening.copy(),
            # The mass matrix of a part is not the identity, so this term is always necessary.
            centrifugal=np.zeros((n, m, m)),
        )
        stations = layout.Stations(*(np.ascontiguousarray(array[k::count]) for array in placed))
        cuts.append(Cut(stations, constants, layout.run_time_sizes(constants), np.zeros(n)))
    for piece in arm.assembly.pieces:
        own = np.flatnonzero(placed.body == piece.body)
        if own.size:
            second_order = arm.spec.theory == "second_order"
            inner = placed.x[own] - piece.offset
            parts = part_constants(piece.shapes, inner, shortening=second_order)
            hub = arm.spec.joints[piece.link].hub_inertia if piece.start == 0.0 else 0.0
            for row, station in enumerate(own):
                cut = cuts[station % count]
                cut.reach[piece.body] = inner[row]
                part = PartConstants(*(column[row] for column in parts))
                place_inertia(cut.constants, piece.body, part)
                modes = part.S.size
                cut.constants.centrifugal[piece.body, :modes, :modes] = part.spread - np.eye(modes)
                move_masses(cut.constants, piece.body, piece.offset)
                cut.constants.inertia[piece.body] += hub
    return tuple(cuts)


def forces_at(
    arm: Coordinates,
    cuts: Sequence[Cut],
    state: FloatArray,
    acceleration: FloatArray,
    loads: Sequence[Load],
    placed: layout.Loads,
    work: layout.Workspace,
    kernel: Callable[..., None] = section_forces,
) -> FloatArray:
    """Return axial force, shear force and bending moment (N, N m) of one state: (links, cuts, 3).

    ``state`` (2, n, 1 + m) and ``acceleration`` (n, 1 + m) have the kernels' layout; ``placed``
    contains ``loads`` in it; ``work`` contains the results of ``inverse_dynamics`` for all of
    these; ``kernel`` is the plain function for arrays of objects.
    """
    forces = np.zeros((len(cuts), arm.n_links, 3), dtype=state.dtype)
    owners = parts_of(arm, loads)
    for cut, values in zip(cuts, forces, strict=True):
        kept = loads_inboard(arm, owners, placed, cut.reach)
        kernel(cut.sizes, cut.constants, cut.stations, state, acceleration, kept, work, values)
    return np.ascontiguousarray(np.moveaxis(forces, 0, 1))
