"""From the specification of an arm to the arrays that the kernels work on.

The only place where the two meet: the model layer knows no arrays, the kernels know no links.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.beams import LinkConstants, link_constants, rigid_constants
from flexarm.kernels.layout import ArmConstants
from flexarm.model import ArmSpec, Joint, Link, RayleighDamping

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


class Piece(NamedTuple):
    """A body that is a link, or one of its segments.

    Attributes:
        link: index of the link. body: index of the body. start: distance of the piece's root from
            the link's (m). shapes: its constants. first: position of its first modal coordinate
            in q. rows: rows of the link's nodal values that are this piece's.
    """

    link: int
    body: int
    start: float
    shapes: LinkConstants
    first: int
    rows: slice

    @property
    def modal(self) -> slice:
        """Positions of the modal coordinates in q."""
        return slice(self.first, self.first + self.shapes.w2.size)


@dataclass(frozen=True, eq=False)
class Assembly:
    """Kernel constants of an arm, and where its coordinates stand in them.

    Attributes:
        constants: what the kernels read; n bodies of m modes each, padded.
        pieces: the bodies that make up the links, from the base outwards.
        link_body: (links,) first body of each link, the one on its joint.
        coordinates: (dof,) position of each entry of q in the flattened (n, 1 + m) array.
        joint_index: (joints,) position of each joint angle in q.
    """

    constants: ArmConstants
    pieces: tuple[Piece, ...]
    link_body: IntArray
    coordinates: IntArray
    joint_index: IntArray

    @property
    def bodies(self) -> int:
        """Number of bodies n, a payload beside the tip included."""
        return int(self.constants.mass.size)

    @property
    def modes(self) -> int:
        """Modes m that each body is padded to."""
        return int(self.constants.S.shape[1])

    @property
    def links(self) -> tuple[LinkConstants, ...]:
        """Constants of each piece: of each link, where links have one segment."""
        return tuple(piece.shapes for piece in self.pieces)

    def pieces_of(self, link: int) -> tuple[Piece, ...]:
        """Pieces of one link, from its root outwards."""
        return tuple(piece for piece in self.pieces if piece.link == link)

    def piece_at(self, link: int, station: float) -> Piece:
        """Piece of a link that holds a station (m from the link's root)."""
        own = self.pieces_of(link)
        return next((p for p in reversed(own) if p.start <= station), own[0])


def assemble(spec: ArmSpec) -> Assembly:
    """Compute the constants of an arm.

    Raises:
        InputError: a link's mass matrix is not positive definite (theory page "beams").
    """
    pieces: list[Piece] = []
    link_body, joint_index = [], []
    first = 0
    for index, link in enumerate(spec.links):
        link_body.append(len(pieces))
        joint_index.append(first)
        first += 1
        start, rows = 0.0, 0
        for shapes in _segments(link, f"arm.links[{index}]"):
            count = shapes.elements
            piece = Piece(index, len(pieces), start, shapes, first, slice(rows, rows + count))
            pieces.append(piece)
            first += shapes.w2.size
            start, rows = start + shapes.length, rows + count
    stride = 1 + max(piece.shapes.w2.size for piece in pieces)
    coordinates = np.zeros(first, dtype=np.intp)
    coordinates[joint_index] = np.array(link_body) * stride
    for piece in pieces:
        coordinates[piece.modal] = piece.body * stride + 1 + np.arange(piece.shapes.w2.size)
    return Assembly(
        constants=_arm_constants(spec, pieces),
        pieces=tuple(pieces),
        link_body=np.array(link_body, dtype=np.intp),
        coordinates=coordinates,
        joint_index=np.array(joint_index, dtype=np.intp),
    )


def _segments(link: Link, where: str) -> list[LinkConstants]:
    """Constants of the segments of a link, from its root outwards."""
    beam = link.beam()
    columns = (beam.mass_per_length, beam.rotary_inertia_per_length or ())
    if not link.flexible:
        return [rigid_constants(beam.x, *columns, elements=link.elements, where=where)]
    rigidity, shear = np.array(beam.flexural_rigidity), beam.shear_rigidity
    count = link.segments
    segments = []
    for k in range(count):
        x = np.array(beam.x)
        a, b = link.length * k / count, link.length * (k + 1) / count
        stations = np.concatenate([[a], x[(x > a) & (x < b)], [b]])
        segments.append(
            link_constants(
                stations - a,
                np.interp(stations, x, rigidity),
                *(np.interp(stations, x, np.array(column)) for column in columns),
                elements=link.elements // count,
                modes=link.modes,
                shear_rigidity=None if shear is None else np.interp(stations, x, np.array(shear)),
                where=where,
            )
        )
    return segments


def _arm_constants(spec: ArmSpec, pieces: list[Piece]) -> ArmConstants:
    payload_body = spec.payload.mass > 0 and any(spec.payload.offset)
    n = len(pieces) + payload_body
    m = max(piece.shapes.w2.size for piece in pieces)
    second_order = spec.theory == "second_order"
    g = m if second_order else 0
    c = m if second_order or any(np.any(piece.shapes.rotary) for piece in pieces) else 0
    constants = ArmConstants(
        mass=np.zeros(n),
        first_moment_x=np.zeros(n),
        first_moment_y=np.zeros(n),
        inertia=np.zeros(n),
        length=np.zeros(n),
        S=np.zeros((n, m)),
        a=np.zeros((n, m)),
        P=np.zeros((n, m)),
        dP=np.zeros((n, m)),
        w2=np.zeros((n, m)),
        damping=np.zeros((n, m)),
        centrifugal=np.zeros((n, c, c)),
        D0=np.zeros((n, g, g)),
        G=np.zeros((n, g, g)),
        residual_inertia=np.zeros((n, 3)),
        residual_tip=np.zeros((n, 4)),
        N=np.zeros((n, 3)),
        mobility=np.ones((n, m)),
        joint_added=np.zeros(n),
        tip_mass=np.zeros(n),
        tip_inertia=np.zeros(n),
        free=np.ones(n),
        joint_damping=np.zeros(n),
        joint_stiffness=np.zeros(n),
        joint_rest=np.zeros(n),
        friction=np.tile([0.0, 0.0, 1.0, 1.0], (n, 1)),
        limits=np.tile([-1.0, 1.0, 0.0, 0.0], (n, 1)),
        joint_laws=np.zeros(int(any(joint.friction or joint.limits for joint in spec.joints))),
        gravity=np.array(spec.gravity, dtype=np.float64),
    )
    constants.free[:] = 0.0
    for piece in pieces:
        damping = _modal_damping(spec.links[piece.link], piece.shapes)
        _place_link(constants, piece.body, piece.shapes, damping, second_order)
        if piece.start == 0.0:
            _place_joint(constants, piece.body, spec.joints[piece.link])
    if payload_body:
        _place_payload_body(constants, spec)
    else:
        constants.tip_mass[-1] += spec.payload.mass
        constants.tip_inertia[-1] += spec.payload.inertia
    for array in constants:
        array.setflags(write=False)
    return constants


def _place_joint(constants: ArmConstants, i: int, joint: Joint) -> None:
    constants.free[i] = 1.0
    constants.inertia[i] += joint.hub_inertia
    constants.residual_inertia[i, 2] += joint.hub_inertia
    constants.joint_damping[i] = joint.damping
    constants.joint_stiffness[i] = joint.stiffness
    constants.joint_rest[i] = joint.rest_angle
    if joint.friction is not None:
        coulomb = joint.friction.coulomb
        static = coulomb if joint.friction.static is None else joint.friction.static
        rates = joint.friction.stribeck_rate, joint.friction.smoothing_rate
        constants.friction[i] = coulomb, static - coulomb, *rates
    if joint.limits is not None:
        stops = joint.limits
        constants.limits[i] = stops.lower, stops.upper, stops.stiffness, stops.damping
    if i > 0:  # the motor of this joint rides on the tip of the body before
        constants.tip_mass[i - 1] += joint.mass
        constants.tip_inertia[i - 1] += joint.housing_inertia


def _place_link(
    constants: ArmConstants, i: int, link: LinkConstants, damping: FloatArray, second_order: bool
) -> None:
    k = link.w2.size
    constants.mass[i] = link.mass
    constants.first_moment_x[i] = link.first_moment
    constants.inertia[i] = link.inertia
    constants.length[i] = link.length
    for name in ("S", "a", "P", "dP", "w2"):
        getattr(constants, name)[i, :k] = getattr(link, name)
    constants.damping[i, :k] = damping
    constants.residual_inertia[i] = link.residual_inertia
    constants.residual_tip[i] = link.residual_tip.ravel()
    constants.N[i] = link.P @ link.P, link.P @ link.dP, link.dP @ link.dP
    if constants.centrifugal.shape[1]:
        constants.centrifugal[i, :k, :k] = -link.rotary
    if second_order:
        constants.centrifugal[i, :k, :k] -= link.D1
        constants.D0[i, :k, :k] = link.D0
        constants.G[i, :k, :k] = link.G


def _place_payload_body(constants: ArmConstants, spec: ArmSpec) -> None:
    """A payload beside the tip is one more rigid body, of no length, on a fixed joint."""
    payload = spec.payload
    x, y = payload.offset
    constants.mass[-1] = payload.mass
    constants.first_moment_x[-1] = payload.mass * x
    constants.first_moment_y[-1] = payload.mass * y
    constants.inertia[-1] = payload.inertia + payload.mass * (x * x + y * y)
    constants.residual_inertia[-1] = payload.mass, payload.mass * x, constants.inertia[-1]
    constants.residual_tip[-1] = 1.0, 0.0, 0.0, 1.0
    constants.free[-1] = 0.0


def _modal_damping(link: Link, shapes: LinkConstants) -> FloatArray:
    """Diagonal of the damping matrix over the link's modes (1/s): Rayleigh or by ratio."""
    if link.damping is None:
        return np.zeros_like(shapes.w2)
    if isinstance(link.damping, RayleighDamping):
        return link.damping.mass_coefficient + link.damping.stiffness_coefficient * shapes.w2
    ratio = np.array(link.damping.ratios(shapes.w2.size))
    return 2.0 * ratio * np.sqrt(shapes.w2)
