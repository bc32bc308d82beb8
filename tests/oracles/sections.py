"""Forces inside a link by two methods: Newton's law for material points, and energies.

Both take the part beyond a section and compute the wrench that its motion requires. ``by_newton``
differentiates positions twice and adds up mass times acceleration, without moving frames or beam
theory. ``by_lagrange`` takes the kinetic energy of the package's theory (the second-order one omits
terms) for the masses beyond the section alone, and computes the force on the slides of the link's
joint. A motion is (q, qd, qdd) in the coordinates of ``LagrangianOracle``, nodal values.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

import flexarm as fa

from .chain import Piece, cut
from .jets import Jet, cos, sin
from .lagrangian import Energies, LagrangianOracle, place
from .load_points import load_points
from .material_points import MaterialPoints, material_points


@dataclass(frozen=True)
class Section:
    """A section: number of the link from 1, distance from its root (m), not between segments."""

    link: int
    station: float

    def piece(self, pieces: Sequence[Piece]) -> int:
        """Return the index of the piece that contains it."""
        own = [k for k, piece in enumerate(pieces) if piece.owner == self.link - 1]
        return max(k for k in own if pieces[k].start < self.station or k == own[0])

    def loads_beyond(self, loads: Sequence[fa.Load]) -> list[fa.Load]:
        """Return loads, or parts of them, that act beyond the section."""
        kept = []
        for load in loads:
            if load.link != self.link:
                whole = load.link > self.link
            elif load.spread is None:
                whole = load.station is None or load.station >= self.station
            else:
                whole = load.spread[0] >= self.station
                if not whole and load.spread[1] > self.station:
                    kept.append(load.replace(spread=(self.station, load.spread[1])))
            if whole:
                kept.append(load)
        return kept


class Frame(NamedTuple):
    """Root of a piece: place in the world, angle of the tangent, the piece's own coordinates; angle
    of the section that carries it, and of the rotor of its joint's motor; place of the joint."""

    origin: tuple[Any, Any]
    angle: Any
    shape: Any
    carrier: Any = None
    rotor: Any = None
    joint: tuple[Any, Any] = (0.0, 0.0)

    def place(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return the world position of a point at (x, y) in the axes of the root."""
        c, s = cos(self.angle), sin(self.angle)
        return self.origin[0] + c * x - s * y, self.origin[1] + s * x + c * y


@lru_cache(maxsize=4)
def oracle_of(spec: Any) -> LagrangianOracle:
    """Return the oracle of the whole arm."""
    return LagrangianOracle(spec)


def section_forces(
    spec: Any,
    section: Section,
    motion: Sequence[np.ndarray],
    wrench: tuple[Any, Any, Any],
) -> np.ndarray:
    """Return axial force, shear force and bending moment (3,) from the wrench on the part beyond.

    wrench: force and moment about the world's origin that the section transmits to this part.
    """
    oracle = oracle_of(spec)
    k = section.piece(oracle.pieces)
    frame = frames(oracle, oracle.points, constant(motion[0]))[k]
    # As in the package, the axis gives the point, and the rotation of the section the angle.
    here = load_points(
        [fa.Load(section.link, (0.0, 0.0), station=section.station)],
        oracle.pieces,
        oracle.bases,
        oracle.precision,
    )[0]
    x, y = axis(spec, here, here.running, here.x, frame)
    angle = frame.angle.value + float((here.slope @ frame.shape.value)[0])
    fx, fy, moment = wrench
    moment = moment - (float(x.value[0]) * fy - float(y.value[0]) * fx)
    c, s = np.cos(angle), np.sin(angle)
    # The part beyond acts on the section with the opposite wrench.
    return -np.array([c * fx + s * fy, c * fy - s * fx, moment], dtype=float)


def constant(q: np.ndarray) -> Jet:
    """Return coordinates as constants, without derivatives."""
    return Jet(np.asarray(q, dtype=np.longdouble), np.zeros((len(q), 1)), np.zeros((len(q), 1, 1)))


def frames(oracle: LagrangianOracle, points: Sequence[MaterialPoints], q: Jet) -> list[Frame]:
    """Return the roots of all pieces, then the last tip."""
    found, at, angle = [], (q[0] * 0.0, q[0] * 0.0), q[0] * 0.0
    for i, (piece, here) in enumerate(zip(oracle.pieces, points, strict=True)):
        carrier, rotor = angle, angle
        if piece.joint is not None and piece.joint.fixed:
            angle = angle + piece.joint.rest_angle
        elif piece.joint is not None:
            turned = q[oracle.angle_of[piece.owner]]
            rotor = carrier + turned * piece.joint.gear_ratio
            angle = angle + turned
            if piece.joint.elastic:
                angle = angle + q[oracle.spring_of[piece.owner]]
        joint_at, at = at, Frame(at, angle, None).place(piece.hub_radius, 0.0)
        frame = Frame(at, angle, q[oracle.shape_slice[i]], carrier, rotor, joint_at)
        found.append(frame)
        x: Any = piece.link.length
        if oracle.spec.theory == "second_order":
            slope = here.inner_slope @ frame.shape
            x = here.whole @ (slope * slope) * -0.5 + x
        at = frame.place(x, here.tip_deflection @ frame.shape)
        angle = angle + here.tip_slope @ frame.shape
    return [*found, Frame(at, angle, None)]


def axis(spec: Any, shapes: Any, running: Any, x: Any, frame: Frame) -> tuple[Any, Any]:
    """Return world positions (k,) of points of the axis at stations x (k,) with given shapes."""
    if spec.theory == "second_order":
        slope = shapes.inner_slope @ frame.shape
        x = running @ (slope * slope) * -0.5 + x
    return frame.place(x, shapes.deflection @ frame.shape)


def beyond(oracle: LagrangianOracle, section: Section) -> list[MaterialPoints]:
    """Return the material points of all pieces, massless where they are inboard of the section."""
    k, points = section.piece(oracle.pieces), list(oracle.points)
    here, inboard = cut_piece(oracle, section, k)
    points[:k] = [weighing(p, np.zeros(len(p.x))) for p in points[:k]]
    points[k] = weighing(here, ~inboard)
    return points


def cut_piece(
    oracle: LagrangianOracle, section: Section, k: int
) -> tuple[MaterialPoints, np.ndarray]:
    """Return the material points of the piece that contains the section, and a mask of inboard
    ones."""
    x = section.station - oracle.pieces[k].start
    here = material_points(oracle.pieces[k].link, oracle.bases[k], oracle.precision, (x,))
    return here, here.x <= x


def weighing(points: MaterialPoints, kept: np.ndarray) -> MaterialPoints:
    """Return the points with the masses where the mask is true, and zero elsewhere."""
    return replace(points, mass=points.mass * kept, rotary=points.rotary * kept)


class Lump(NamedTuple):
    """Masses (kg) at positions, and inertias (kg m^2) that turn with angles."""

    mass: Any
    at: tuple[Any, Any]
    inertia: Any
    angle: Any


def lumps(
    oracle: LagrangianOracle, section: Section, points: list[MaterialPoints], q: Jet
) -> Iterator[Lump]:
    """Return everything with mass beyond a section."""
    spec, roots = oracle.spec, frames(oracle, points, q)
    for piece, here, frame in zip(oracle.pieces, points, roots, strict=False):
        if piece.joint is not None and piece.owner > section.link - 1:
            yield Lump(piece.joint.mass, frame.joint, piece.joint.hub_inertia, frame.angle)
            yield Lump(0.0, frame.joint, piece.joint.housing_inertia, frame.carrier)
            yield Lump(0.0, frame.joint, piece.joint.rotor_inertia, frame.rotor)
        at = axis(spec, here, here.running, here.x, frame)
        yield Lump(here.mass, at, here.rotary, frame.angle + here.slope @ frame.shape)
    tip, payload = roots[-1], spec.payload
    yield Lump(payload.mass, tip.place(*payload.offset), payload.inertia, tip.angle)


def by_newton(
    spec: Any,
    section: Section,
    motion: Sequence[np.ndarray],
    loads: Sequence[fa.Load] = (),
    base_acceleration: Any = (0.0, 0.0),
) -> np.ndarray:
    """Return axial force, shear force, bending moment (3,): mass times acceleration less the
    loads."""
    oracle, (q, qd, qdd) = oracle_of(spec), motion
    points = beyond(oracle, section)
    variables = Jet.variables(np.asarray(q, dtype=oracle.precision), rows=len(q))
    falling = np.subtract(base_acceleration, spec.gravity)
    total = np.zeros(3, dtype=oracle.precision)

    def second_rate(position: Jet) -> Any:
        return position.first @ qdd + (position.second @ qd) @ qd

    for lump in lumps(oracle, section, points, variables):
        x, y = lump.at
        fx = lump.mass * (second_rate(x) + falling[0])
        fy = lump.mass * (second_rate(y) + falling[1])
        turning = lump.inertia * second_rate(lump.angle)
        total += [np.sum(fx), np.sum(fy), np.sum(x.value * fy - y.value * fx + turning)]
    roots = frames(oracle, points, constant(q))
    for load in load_points(
        section.loads_beyond(loads), oracle.pieces, oracle.bases, oracle.precision
    ):
        frame = roots[load.piece]
        x, y = axis(spec, load, load.running, load.x, frame)
        fx, fy = load.force
        if load.follower:
            c, s = np.cos(frame.angle.value), np.sin(frame.angle.value)
            fx, fy = c * fx - s * fy, s * fx + c * fy
        fx, fy = load.weight * fx, load.weight * fy
        total -= [np.sum(fx), np.sum(fy), np.sum(x.value * fy - y.value * fx) + load.moment]
    return section_forces(spec, section, motion, tuple(total))


def bare_joint(joint: fa.Joint, beyond: bool) -> fa.Joint:
    """Return the joint with its coordinates, its masses if it is beyond the section, and no
    forces."""
    nothing = 1e-300  # keeps the coordinates of an elastic joint
    fields: dict[str, Any] = {"fixed": joint.fixed, "gear_ratio": joint.gear_ratio}
    if beyond:
        for name in ("mass", "hub_inertia", "housing_inertia", "rotor_inertia"):
            fields[name] = getattr(joint, name)
    if joint.fixed:
        fields["rest_angle"] = joint.rest_angle
    if joint.elastic:
        fields["stiffness"] = nothing
    if joint.rotor_inertia and not beyond:
        fields["rotor_inertia"] = nothing
    return fa.Joint(**fields)


def by_lagrange(
    spec: Any,
    section: Section,
    motion: Sequence[np.ndarray],
    loads: Sequence[fa.Load] = (),
    base_acceleration: Any = (0.0, 0.0),
) -> np.ndarray:
    """Return axial force, shear force, bending moment (3,) from the slides of the link's joint.

    The joint of the section's link must turn, because its coordinate gives the moment. The
    wrench on the part beyond the section is that on the link and all beyond it, less that on its
    inboard part: each has the energy that the theory gives a body of its mass.
    """
    link, oracle = section.link - 1, oracle_of(spec)
    k = section.piece(oracle.pieces)
    here, inboard = cut_piece(oracle, section, k)
    none = [weighing(p, np.zeros(len(p.x))) for p in oracle.points]
    bare = [bare_joint(joint, owner > link) for owner, joint in enumerate(spec.joints)]
    outer = [*none[:k], here, *oracle.points[k + 1 :]]
    from_here = spec.replace(joints=bare)
    missing, total = _taken(oracle, from_here, outer, motion, base_acceleration)
    acting = oracle._load_force(total, section.loads_beyond(loads), len(missing))
    bare = [bare_joint(joint, False) for joint in spec.joints]
    inner = [*none[:k], weighing(here, inboard), *none[k + 1 :]]
    alone = spec.replace(joints=bare, payload=fa.Payload())
    missing = missing - acting - _taken(oracle, alone, inner, motion, base_acceleration)[0]
    n = oracle.dof
    fx, fy = missing[n + 2 * link : n + 2 * link + 2]
    first = next(k for k, piece in enumerate(oracle.pieces) if piece.owner == link)
    root, angle = total.roots[first]
    joint = place(root, angle, -oracle.pieces[first].hub_radius, 0.0)
    x, y = (float(c.value.value) for c in joint)
    moment = missing[oracle.spring_of[link]] + x * fy - y * fx
    return section_forces(spec, section, motion, (fx, fy, moment))


def _taken(
    whole: LagrangianOracle,
    spec: Any,
    points: list[MaterialPoints],
    motion: Sequence[np.ndarray],
    base_acceleration: Any,
) -> tuple[np.ndarray, Energies]:
    """Return the generalised force that the motion of these points requires, slides included."""
    oracle = copy.copy(whole)
    oracle.points, oracle.spec = points, spec
    oracle.pieces, oracle.damping = cut(spec), 0.0 * whole.damping
    (q, qd, qdd), slides = motion, np.zeros(2 * len(spec.links))
    mass, bias, total = oracle._lagrange(np.append(q, slides), np.append(qd, slides))
    slides[:2] = base_acceleration
    return mass @ np.append(qdd, slides) + bias, total
