"""Assembly of the kernels' arrays from the specification of an arm.

Only this module uses both: the model layer contains no arrays, and the kernels contain no links.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.assembly.surfaces import surface_rows
from flexarm.arm.beams import BeamTable, LinkConstants, link_constants, rigid_constants
from flexarm.arm.beams.assembly import interpolation_error
from flexarm.arm.beams.invariants import PartConstants, inverse_inertia
from flexarm.base.errors import InputError
from flexarm.kernels.columns import (
    CURVE_CURVATURE,
    HAS_BRISTLES,
    HAS_JOINT_LAWS,
    IS_FREE,
    IS_TREE,
)
from flexarm.kernels.layout import ArmConstants, Sizes, empty_constants, run_time_sizes
from flexarm.kernels.recursion.closures import ROWS
from flexarm.model import ArmSpec, Base, Joint, Link, RayleighDamping, Surface

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


class Piece(NamedTuple):
    """A body that is a link, or a segment of a link."""

    link: int  # index of the link
    body: int  # index of the body
    start: float  # distance of the piece's root from the link's root (m)
    shapes: LinkConstants  # constants of the piece
    first: int  # index of its first modal coordinate in q
    rows: slice  # rows of the link's nodal values that belong to this piece
    #: Distance of the piece's root from the origin of the body (m), the hub radius or 0
    offset: float = 0.0

    @property
    def modal(self) -> slice:
        """Indices of the modal coordinates in q."""
        return slice(self.first, self.first + self.shapes.w2.size)


class Seat(NamedTuple):
    """A joint that is not fixed, at the root of a link."""

    link: int  # index of the link
    #: Index of the body that the motor rotates: the link's first one or, with an elastic joint, a
    #: body of zero length before it
    body: int
    angle: int  # index of the joint angle in q
    twist: int | None  # index of the elastic joint's twist in q, or None
    backlash: bool = False  # whether the spring of the elastic joint has one


class BaseCoordinate(NamedTuple):
    """A coordinate of the base that moves."""

    name: str  # x, y or angle
    body: int  # index of the body that it moves; the last of them is the base itself
    place: int  # index of the coordinate in q


@dataclass(frozen=True, eq=False)
class Assembly:
    """Kernel constants of an arm, and the positions of its coordinates in the arrays."""

    #: Constants of n bodies with m modes each, padded; friction is a function of the rate
    constants: ArmConstants
    pieces: tuple[Piece, ...]  # the bodies that form the links, from the base outwards
    seats: tuple[Seat, ...]  # the joints that are not fixed, from the base outwards
    link_body: IntArray  # (links,) first body of each link
    #: (links,) body on which the joint of each link acts: that body, or the massless one before it
    #: that carries links or closures at the root
    link_root: IntArray
    coordinates: IntArray  # (dof,) index of each entry of q in the flattened (n, 1 + m) array
    base: tuple[BaseCoordinate, ...] = ()  # coordinates of the base that move

    @cached_property
    def has_bristles(self) -> bool:
        """Whether the friction of any joint has bristles."""
        return bool(self.constants.bristles[:, 0].any())

    @cached_property
    def has_sticking(self) -> bool:
        """Whether the friction of any joint holds it at rest in runs."""
        return bool(np.any(self.constants.holds[self.joint_body] * self.breakaway > 0.0))

    @cached_property
    def breakaway(self) -> FloatArray:
        """Largest torques (joints,) N m of dry friction at rest; forces (N) of sliding joints."""
        coulomb, rise, *_, excess, _ = self.constants.friction[self.joint_body].T
        return np.asarray(coulomb + rise + np.maximum(excess, 0.0))

    @property
    def least_damping(self) -> FloatArray:
        """Least viscous damping (joints,) N m s/rad of motors; N s/m of sliding joints."""
        *_, viscous, _, excess = self.constants.friction[self.joint_body].T
        rubbing = viscous + np.minimum(excess, 0.0)
        return np.asarray(self.constants.joint_damping[self.joint_body] + rubbing)

    @cached_property
    def run_constants(self) -> ArmConstants:
        """Constants for states of runs, which contain the deflections of bristles.

        Coordinates q and qd do not contain them; for functions of these, bristles are in their
        steady state, in which friction is a function of the rate.
        """
        if not self.has_bristles:
            return self.constants
        arm = self.constants.arm.copy()
        arm[HAS_BRISTLES] = 1.0
        return self.constants._replace(arm=arm)

    @cached_property
    def sizes(self) -> Sizes:
        """Loop lengths of kernels with the ``run_constants``, as values at run time."""
        return run_time_sizes(self.run_constants)

    @cached_property
    def joint_body(self) -> IntArray:
        """Bodies that the motors rotate, (joints,)."""
        return np.array([seat.body for seat in self.seats], dtype=np.intp)

    @cached_property
    def joint_index(self) -> IntArray:
        """Indices of the joint angles in q, (joints,)."""
        return np.array([seat.angle for seat in self.seats], dtype=np.intp)

    @cached_property
    def bodies(self) -> int:
        """Number of bodies n, including a payload offset from the tip."""
        return int(self.constants.mass.size)

    @cached_property
    def modes(self) -> int:
        """Number of modes m to which each body is padded, with one for bristles."""
        return int(self.constants.S.shape[1])

    @property
    def links(self) -> tuple[LinkConstants, ...]:
        """Constants of each piece, which is a whole link if the link has one segment."""
        return tuple(piece.shapes for piece in self.pieces)

    def pieces_of(self, link: int) -> tuple[Piece, ...]:
        """Return the pieces of one link, from its root outwards."""
        return tuple(piece for piece in self.pieces if piece.link == link)

    def piece_of(self, body: int) -> Piece:
        """Return the piece of a body; the motor's end of an elastic joint has none."""
        return next(piece for piece in self.pieces if piece.body == body)

    def piece_at(self, link: int, station: float) -> Piece:
        """Return the piece of a link at a station (m from the link's root)."""
        own = self.pieces_of(link)
        return next((p for p in reversed(own) if p.start <= station), own[0])


def assemble(spec: ArmSpec) -> Assembly:
    """Compute the constants of an arm; InputError if a link's mass matrix is indefinite."""
    pieces: list[Piece] = []
    seats: list[Seat] = []
    link_body: list[int] = []
    link_root: list[int] = []
    base = tuple(BaseCoordinate(name, i, i) for i, name in enumerate(_moving(spec.base)))
    places = [(i, 0) for i in range(len(base))]  # body and column of each coordinate
    body = len(base)
    carried = _stations_of_children(spec)
    for index, (link, joint) in enumerate(zip(spec.links, spec.joints, strict=True)):
        if not joint.fixed:
            twist = len(places) + 1 if joint.elastic else None
            seats.append(Seat(index, body, len(places), twist, joint.backlash > 0.0))
            places += [(body, 0), (body + 1, 0)] if joint.elastic else [(body, 0)]
            body += joint.elastic
        link_root.append(body)
        body += 0.0 in carried[index]  # a massless body between the joint and the link
        link_body.append(body)
        start, rows, offset = 0.0, 0, link.hub_radius
        for shapes in _kept_segments(link, index, carried[index]):
            count = shapes.elements
            nodes = slice(rows, rows + count)
            pieces.append(Piece(index, body, start, shapes, len(places), nodes, offset))
            places += [(body, 1 + j) for j in range(shapes.w2.size)]
            start, rows, offset = start + shapes.length, rows + count, 0.0
            body += 1
    constants = constants_of_links(spec, pieces)
    place_joints_and_payload(constants, spec, pieces, seats)
    stride = 1 + constants.S.shape[1]
    return Assembly(
        constants=constants,
        pieces=tuple(pieces),
        seats=tuple(seats),
        link_body=np.array(link_body, dtype=np.intp),
        link_root=np.array(link_root, dtype=np.intp),
        coordinates=np.array([i * stride + column for i, column in places], dtype=np.intp),
        base=base,
    )


def _moving(base: Base) -> tuple[str, ...]:
    """Return the names of the coordinates of a base that move, in the order of their bodies."""
    return tuple(name for name in ("x", "y", "angle") if name in base.free)


def _stations_of_children(spec: ArmSpec) -> list[tuple[float, ...]]:
    """Return, for each link, the stations (m) below its tip that carry links or closures."""
    stations: list[set[float]] = [set() for _ in spec.links]
    points: list[tuple[int | None, float | None]] = [
        (parent + 1, link.parent_station)
        for parent, link in zip(spec.parents, spec.links, strict=True)
    ]
    for closure in spec.closures:
        points += [(closure.link, closure.station), (closure.to_link, closure.to_station)]
    for number, station in points:
        if number and station is not None and station < spec.links[number - 1].length:
            stations[number - 1].add(station)
    return [tuple(sorted(places)) for places in stations]


def _kept_segments(link: Link, index: int, carried: tuple[float, ...]) -> tuple[LinkConstants, ...]:
    """Return the constants of a link's segments, from the cache if possible; errors name it."""
    try:
        try:
            return _segments(link, carried)
        except TypeError:  # a link that contains a list has no hash
            return _segments.__wrapped__(link, carried)
    except InputError as error:
        raise error.at(f"arm.links[{index}]") from None


@lru_cache(maxsize=64)
def table_error(link: Link) -> float:
    """Return ``interpolation_error`` of a link; zero if it is rigid or has no table."""
    if link.table is None or not link.flexible:
        return 0.0
    columns = {name: np.array(values) for name, values in link.beam() if values is not None}
    return interpolation_error(BeamTable(**columns))


@lru_cache(maxsize=64)
def _segments(link: Link, carried: tuple[float, ...]) -> tuple[LinkConstants, ...]:
    """Compute the read-only constants of the segments of a link, from its root outwards.

    The link is also divided at the stations ``carried`` that carry other links. A part with one
    mode is too stiff under the force or the moment of the next one: the tip of the link would
    move up to a quarter too little, however many parts there are.
    """
    beam, count = link.beam(), link.segments
    ends = {link.length * k / count for k in range(1, count + 1)}
    inner = {s for s in carried if s > 0.0 and not np.isclose(s, list(ends), rtol=1e-9).any()}
    edges = [0.0, *sorted(ends | inner)]
    columns = {name: np.array(values) for name, values in beam if values is not None}
    x = columns.pop("x")
    if not link.flexible:
        columns["flexural_rigidity"] = np.ones(x.shape)
        columns.pop("shear_rigidity", None)
        edges = [0.0, *sorted(inner), link.length]
    segments = []
    # Numbers of elements are in proportion to the lengths, at least 1 each.
    shares = link.elements * np.diff(edges) / (edges[-1] - edges[0])
    counts = np.maximum(1, np.floor(shares + 1e-9)).astype(int)
    while counts.sum() < link.elements:
        counts[np.argmax(shares - counts)] += 1
    for (a, b), elements in zip(pairwise(edges), [int(count) for count in counts], strict=True):
        stations = np.concatenate([[a], x[(x > a) & (x < b)], [b]])
        parts = {name: np.interp(stations, x, column) for name, column in columns.items()}
        table = BeamTable(stations - a, **parts)
        if link.flexible:
            least = 1 if len(edges) == 2 else 2
            modes = None if link.modes is None else min(max(link.modes, least), 2 * elements)
            segments.append(link_constants(table, elements, modes))
        else:
            segments.append(rigid_constants(table, elements))
    return tuple(segments)


def constants_of_links(spec: ArmSpec, pieces: Sequence[Piece]) -> ArmConstants:
    """Allocate the constants of an arm and fill in the links, without their damping."""
    payload_body = spec.payload.mass > 0 and any(spec.payload.offset)
    n = pieces[-1].body + 1 + payload_body
    bristles = any(joint.friction and joint.friction.bristle_stiffness for joint in spec.joints)
    m = max(piece.shapes.w2.size for piece in pieces) + bristles
    g = m if spec.theory == "second_order" else 0
    c = m if bristles or any(np.any(piece.shapes.rotary) for piece in pieces) else 0
    rows = sum(len(ROWS[closure.kind]) for closure in spec.closures)
    knots = surface_rows(_curves(spec))[1]
    constants = empty_constants(n, m, c, g, rows, len(knots))
    constants.knots[:] = knots
    constants.arm[HAS_JOINT_LAWS] = float(
        any(joint.friction or joint.limits or joint.rotor_inertia for joint in spec.joints)
    )
    constants.mobility[:] = 1.0
    for piece in pieces:
        _place_link(constants, piece.body, piece.shapes)
    if bristles:  # the integral of their deflection is no displacement and has no inertia
        constants.centrifugal[:, -1, -1] = -1.0
    return constants


def _curves(spec: ArmSpec) -> list[Surface]:
    return [closure.shape for closure in spec.closures if closure.shape]


def place_joints_and_payload(
    constants: ArmConstants, spec: ArmSpec, pieces: Sequence[Piece], seats: Sequence[Seat]
) -> None:
    """Complete ``constants_of_links``: joints, payload, gravity, and the damping of links.

    The numbers of ``spec`` may be symbols in arrays of objects, because no branch depends on them.
    """
    constants.gravity[:] = spec.gravity
    constants.friction[:] = 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0
    constants.limits[:] = -1.0, 1.0, 0.0, 0.0
    constants.rotor[:] = 0.0, 1.0
    carriers = _place_tree(constants, spec, pieces, seats)
    for piece in pieces:
        i, k = piece.body, piece.shapes.w2.size
        constants.damping[i, :k] = _modal_damping(spec.links[piece.link], constants.w2[i, :k])
        if piece.start == 0.0:
            radius = spec.links[piece.link].hub_radius
            # Move the root outwards, without the length. Beams have their constants about their
            # root. A rigid, massless hub in line with the root tangent adds its radius to every
            # distance from the joint. The modes do not change, so no kernel knows the hub; theory
            # page "link", (L.50). The changes are linear in the constants, so that they apply to
            # derivatives of them, too.
            move_masses(constants, i, radius)
            inertia, tip = constants.residual_inertia[i], constants.residual_tip[i]
            inertia[2] += radius * (2.0 * inertia[1] + radius * inertia[0])
            inertia[1] += radius * inertia[0]
            tip[1] += radius * tip[0]
            tip[3] += radius * tip[2]
            constants.length[i] += radius
            inboard = carriers[piece.link]
            joint = spec.joints[piece.link]
            constants.inertia[i] += joint.hub_inertia
            constants.hub[i] = joint.hub_inertia
            constants.residual_inertia[i, 2] += joint.hub_inertia
            if inboard >= 0:
                constants.tip_mass[inboard] += joint.mass
                constants.tip_inertia[inboard] += joint.housing_inertia
    for seat in seats:
        _place_motor(constants, seat, spec.joints[seat.link])
    if constants.mass.size > pieces[-1].body + 1:
        # A payload with an offset is a rigid body of zero length on a fixed joint.
        payload = spec.payload
        _place_rigid_body(constants, -1, payload.mass, payload.inertia, payload.offset)
        constants.residual_tip[-1] = 1.0, 0.0, 0.0, 1.0
        constants.free[-1] = 0.0
    else:
        constants.tip_mass[-1] += spec.payload.mass
        constants.tip_inertia[-1] += spec.payload.inertia


class _Sections:
    """Bodies on whose tip sections joints and closures sit; -1 is the ground."""

    def __init__(self, spec: ArmSpec, pieces: Sequence[Piece], base: int) -> None:
        self._spec, self._base = spec, base
        self.pieces: list[list[Piece]] = [[] for _ in spec.links]
        for piece in pieces:
            self.pieces[piece.link].append(piece)

    def at(self, number: int | None, station: float | None) -> int:
        """Return the body of a station (m) of a link by its number; 0: the base, None: the ground.

        Without a station, it is the tip.
        """
        if number is None:
            return -1
        if number == 0:
            return self._base
        pieces = self.pieces[number - 1]
        if station is None or station >= self._spec.links[number - 1].length:
            return pieces[-1].body
        before = [piece for piece in pieces if piece.start < station * (1.0 - 1e-9)]
        return before[-1].body if before else pieces[0].body - 1


def _place_tree(
    constants: ArmConstants, spec: ArmSpec, pieces: Sequence[Piece], seats: Sequence[Seat]
) -> list[int]:
    """Set the base, joints and closures of a tree; return the bodies that carry the links."""
    sections = _Sections(spec, pieces, _place_base(constants, spec.base))
    stations = _stations_of_children(spec)
    motors = {seat.link: seat for seat in seats}
    carriers = []
    for index, (link, joint) in enumerate(zip(spec.links, spec.joints, strict=True)):
        carrier = sections.at(spec.parents[index] + 1, link.parent_station)
        carriers.append(carrier)
        first = last = sections.pieces[index][0].body
        if 0.0 in stations[index]:
            first = last = first - 1
            # Its tip is the root of the link; the body of the link goes back to the joint.
            constants.residual_tip[first] = 1.0, link.hub_radius, 0.0, 1.0
            constants.length[first] = link.hub_radius
            constants.place[first + 1] = -link.hub_radius, 0.0
        if index in motors:
            first = motors[index].body
            last = first + (motors[index].twist is not None)
        constants.parent[first] = carrier
        constants.joint_angle[first] = joint.mounting_angle
        _place_joint(constants, slice(first, last + 1), first, joint, np.array(joint.offset))
    row, shapes = 0, iter(surface_rows(_curves(spec))[0])
    for closure in spec.closures:
        first = sections.at(closure.link, closure.station)
        second = sections.at(closure.to_link, closure.to_station)
        for kind in ROWS[closure.kind]:
            constants.ends[row] = kind, first, second
            constants.closure[row, :CURVE_CURVATURE] = (
                *closure.offset,
                *closure.to_offset,
                closure.angle,
            )
            if closure.shape:
                constants.closure[row, CURVE_CURVATURE:] = next(shapes)
            row += 1
    # A free arm is one whose momentum only loads and contacts change.
    external = (*spec.base.stiffness, *spec.base.damping, *spec.gravity)
    grounded = any(closure.to_link is None for closure in spec.closures)
    alone = len(spec.base.free) == 3 and not grounded and all(map(_is_zero, external))
    constants.arm[IS_FREE] = float(alone)
    serial = np.arange(constants.mass.size) - 1.0
    tree = bool(spec.closures) or bool(np.any(constants.slides))
    tree = tree or bool(np.any(constants.parent != serial))
    # A symbol may be any number.
    tree = tree or not all(map(_is_zero, constants.place.flat))
    constants.arm[IS_TREE] = float(tree)
    return carriers


def _is_zero(number: Any) -> bool:
    """Return whether a number is zero; a symbol is not."""
    return isinstance(number, int | float | complex) and number == 0


def _place_joint(
    constants: ArmConstants, bodies: slice, first: int, joint: Joint, place: Any
) -> None:
    """Set place and slide of a joint; ``bodies``: those that slide along it."""
    constants.place[first] = place
    if joint.kind == "revolute":
        if joint.fixed:
            constants.joint_angle[first] = joint.mounting_angle + joint.rest_angle
        return
    axis = np.array(joint.axis or (1.0, 0.0))
    x, y = axis / np.hypot(*axis)
    if joint.fixed:
        constants.place[first] = place + joint.rest_angle * np.array([x, y])
        return
    cosine, sine = np.cos(joint.mounting_angle), np.sin(joint.mounting_angle)
    constants.slides[bodies] = 1.0
    constants.slide[bodies] = cosine * x + sine * y, cosine * y - sine * x


def _place_base(constants: ArmConstants, base: Base) -> int:
    """Set the bodies of a base, and return the last of them, or -1."""
    names = _moving(base)
    for i, name in enumerate(names):
        constants.residual_tip[i] = 1.0, 0.0, 0.0, 1.0
        constants.free[i] = 1.0
        column = ("x", "y", "angle").index(name)
        constants.joint_stiffness[i] = base.stiffness[column]
        constants.joint_damping[i] = base.damping[column]
        if name != "angle":
            constants.slides[i] = 1.0
            constants.slide[i] = float(name == "x"), float(name == "y")
    if names:
        _place_rigid_body(constants, len(names) - 1, base.mass, base.inertia, base.centre)
    return len(names) - 1


def _place_motor(constants: ArmConstants, seat: Seat, joint: Joint) -> None:
    """Set the passive properties of a joint, at its motor and at its spring."""
    i = seat.body
    constants.free[i] = 1.0
    spring = i
    if seat.twist is not None:
        spring = i + 1
        constants.free[spring] = 1.0
        # The motor's end of the spring: a body of zero length and mass transmits all forces.
        constants.residual_tip[i] = 1.0, 0.0, 0.0, 1.0
    constants.joint_damping[i] = joint.braking
    constants.joint_damping[spring] += joint.damping
    if seat.backlash:
        # Beyond the backlash the spring acts as a pair of stops of the twist.
        half = 0.5 * joint.backlash
        constants.limits[spring] = -half, half, joint.stiffness, 0.0
    else:
        constants.joint_stiffness[spring] = joint.stiffness
    constants.joint_rest[spring] = joint.rest_angle
    constants.rotor[i] = joint.rotor_inertia, joint.gear_ratio
    if joint.friction is not None:
        rubs = joint.friction
        rates = rubs.stribeck_rate, rubs.model_rate
        rise = 0.0 if rubs.static is None else rubs.static - rubs.coulomb
        excess = [
            0.0 if backward is None else backward - forward
            for forward, backward in (
                (rubs.coulomb, rubs.coulomb_negative),
                (rubs.viscous, rubs.viscous_negative),
            )
        ]
        constants.friction[i] = rubs.coulomb, rise, *rates, rubs.viscous, *excess
        constants.holds[i] = float(rubs.holds)
        if rubs.bristle_stiffness is not None:
            constants.bristles[i] = 1.0, rubs.bristle_stiffness**0.5, rubs.bristle_damping
    if joint.limits is not None:
        stops = joint.limits
        constants.limits[i] = stops.lower, stops.upper, stops.stiffness, stops.damping


def place_inertia(constants: ArmConstants, i: int, body: LinkConstants | PartConstants) -> None:
    """Set the integrals of the mass of body i over its shapes."""
    k = body.S.size
    constants.mass[i] = body.mass
    constants.inverse_mass[i] = 1.0 / body.mass if body.mass else 0.0
    constants.first_moment_x[i] = body.first_moment
    constants.inertia[i] = body.inertia
    moments = float(body.mass), float(body.first_moment), float(body.inertia)
    constants.inverse_inertia[i] = inverse_inertia(*moments)
    constants.S[i, :k], constants.a[i, :k] = body.S, body.a
    if constants.D0.shape[1]:
        constants.D0[i, :k, :k], constants.D1[i, :k, :k] = body.D0, body.D1


def _place_link(constants: ArmConstants, i: int, link: LinkConstants) -> None:
    place_inertia(constants, i, link)
    k = link.w2.size
    constants.length[i] = link.length
    for name in ("P", "dP", "w2"):
        getattr(constants, name)[i, :k] = getattr(link, name)
    constants.residual_inertia[i] = link.residual_inertia
    constants.residual_tip[i] = link.residual_tip.ravel()
    constants.N[i] = link.P @ link.P, link.P @ link.dP, link.dP @ link.dP
    if constants.centrifugal.shape[1]:
        constants.centrifugal[i, :k, :k] = -link.rotary
    if constants.G.shape[1]:
        constants.G[i, :k, :k] = link.G


def _place_rigid_body(
    constants: ArmConstants, i: int, mass: Any, inertia: Any, centre: Sequence[Any]
) -> None:
    """Set body i to a rigid body; ``centre``: of mass, from its root."""
    x, y = centre
    constants.mass[i] = mass
    constants.first_moment_x[i] = mass * x
    constants.first_moment_y[i] = mass * y
    constants.inertia[i] = inertia + mass * (x * x + y * y)
    constants.residual_inertia[i] = mass, mass * x, constants.inertia[i]


def _modal_damping(link: Link, w2: FloatArray) -> FloatArray:
    """Return the diagonal of the damping matrix over a link's modes (1/s): Rayleigh or ratios."""
    if link.damping is None:
        return np.zeros(w2.shape)
    if isinstance(link.damping, RayleighDamping):
        return link.damping.mass_coefficient + link.damping.stiffness_coefficient * w2
    ratio = np.array(link.damping.ratios(w2.size))
    return np.asarray(2.0 * ratio * w2**0.5)


def move_masses(constants: ArmConstants, i: int, radius: Any) -> None:
    """Move the masses of body i outwards by a radius (m), without the hub's own inertia."""
    c = constants
    c.inertia[i] += radius * (2.0 * c.first_moment_x[i] + radius * c.mass[i])
    c.first_moment_x[i] += radius * c.mass[i]
    c.a[i] += radius * c.S[i]
    c.D1[i] += radius * c.D0[i]
