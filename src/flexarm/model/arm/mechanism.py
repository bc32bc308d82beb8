"""Bodies and connections of a mechanism, the tree of its links, and the rules for them."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator

from flexarm.base.errors import shown
from flexarm.model.arm.joints import Joint
from flexarm.model.arm.links import Link
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import (
    Count,
    CountOrZero,
    Listed,
    NonNegative,
    NonNegatives,
    Number,
    Pair,
    plain,
)
from flexarm.model.surfaces import Surface
from flexarm.model.wording import Fault


def _along_x(value: Any) -> Any:
    """Convert a single number to an offset along the tip tangent."""
    offset = plain(value)
    return (offset, 0.0) if isinstance(offset, int | float) else offset


class Payload(Record):
    """A rigid body attached to the tip of the last link."""

    mass: NonNegative = 0.0
    """Mass (kg)."""
    inertia: NonNegative = 0.0
    """Rotary inertia about the payload's own centre of mass (kg m^2)."""
    offset: Annotated[Pair, BeforeValidator(_along_x, json_schema_input_type=Number | Pair)] = (
        0.0,
        0.0,
    )
    """Centre of mass from the tip, in tip axes: x along the tip tangent (m). A single number is a
    distance along x."""


_COORDINATES = ("x", "y", "angle")


class Base(Record):
    """The body that carries the first joint: fixed, free to move, or elastically supported.

    Its origin is at the world's origin at rest. Joints of links with ``parent=0`` sit on it.
    """

    mass: NonNegative = 0.0
    """Mass (kg); no effect on a base that does not move."""
    inertia: NonNegative = 0.0
    """Rotary inertia about its centre of mass (kg m^2); no effect on a base that does not turn."""
    centre: Pair = (0.0, 0.0)
    """Centre of mass from the origin of the base, in its axes (m)."""
    free: Listed[Literal["x", "y", "angle"]] = ()
    """Coordinates of the base that move: x and y along the world's axes, and its angle; none by
    default."""
    stiffness: NonNegatives = (0.0, 0.0, 0.0)
    """Springs to the ground of x, y and angle, unloaded at zero (N/m; N/m; N m/rad)."""
    damping: NonNegatives = (0.0, 0.0, 0.0)
    """Dampers to the ground of x, y and angle (N s/m; N s/m; N m s/rad)."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if not given.has("free"):
            return
        for k, name in enumerate(given.free):
            if name in given.free[:k]:
                yield Fault(("free", k), f"is a duplicate of free[{given.free.index(name)}]")
        for field in filter(given.has, ("stiffness", "damping")):
            for k, name in enumerate(_COORDINATES):
                if getattr(given, field)[k] and name not in given.free:
                    yield Fault((field, k), f"requires {name!r} in free")


class Closure(Record):
    """A connection that closes a loop: two points are pinned or welded, or one slides along a line
    or a curve."""

    kind: Literal["pin", "weld", "line", "curve"] = "pin"
    """Equal positions (pin), also equal angles (weld), or the first point on a line through the
    second one (line), or on a curve (curve)."""
    link: Count
    """Number of the link of the first point."""
    station: NonNegative | None = None
    """Distance of the first point from the root of its link (m); by default at the tip."""
    offset: Pair = (0.0, 0.0)
    """First point from the axis of its link, in the axes of the section (m)."""
    to_link: CountOrZero | None = None
    """Number of the link of the second point, 0 for the base; by default the ground."""
    to_station: NonNegative | None = None
    """Distance of the second point from the root of its link (m); by default at the tip."""
    to_offset: Pair = (0.0, 0.0)
    """Second point from the axis of its link, in the axes of the section; of the base in its axes,
    of the ground in world axes (m)."""
    angle: Number = 0.0
    """Weld: angle of the first section from the second. Line: direction of the line from the second
    section. Curve: rotation of its axes from the second section (rad)."""
    shape: Surface | None = None
    """Curve: its shape. The second point is the origin of its coordinates, which are those of the
    world by default. The force of the closure acts along the normal, out of the solid."""

    _hints: ClassVar[dict[str, str]] = {
        "shape": "A curve is a Wall, a RoundWall or a SurfaceTable.",
    }

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("kind", "angle") and given.kind == "pin" and given.angle:
            yield Fault(("angle",), "is not supported for a pin")
        curved = given.has("kind") and given.kind == "curve"
        if curved and given.absent("shape"):
            yield Fault(("shape",), "is required for the kind curve")
        elif given.has("kind", "shape") and not curved:
            yield Fault(("shape",), "requires the kind curve")
        if given.has("to_station") and not given.raw("to_link"):
            yield Fault(("to_station",), "requires the number of a link as to_link")
        if given.has("link", "to_link") and given.link == given.to_link:
            hint = "Two points of one link cannot close a loop."
            yield Fault(("to_link",), "differ from link", shown(given.to_link), hint)


def carriers(links: Sequence[Link]) -> tuple[int, ...]:
    """Return the index of the link that carries each link, -1 for the base."""
    return tuple(i - 1 if link.parent is None else link.parent - 1 for i, link in enumerate(links))


def at_tip(link: Link, station: float | None) -> bool:
    """Return whether a distance (m) from the root of a link is that of its tip, up to rounding."""
    return station is None or math.isclose(station, link.length, rel_tol=_ROUNDING)


#: Relative rounding error of sums of lengths.
_ROUNDING = 1e-9


def place_faults(
    links: Sequence[Link],
    link: int,
    furthest: float | None,
    names: tuple[str, str] = ("link", "station"),
) -> Iterator[Fault]:
    """Yield a fault if there is no such link, or a distance (m) on it is beyond its tip."""
    if not 1 <= link <= len(links):
        rule = f"be the number of a link, 1 to {len(links)}"
        yield Fault(names[:1], rule, shown(link))
        return
    length = links[link - 1].length
    if furthest is not None and furthest > length * (1.0 + _ROUNDING):
        rule = f"be at most {length:.9g} (the length of the link)"
        yield Fault(names[1:], rule, shown(furthest))


def tree_faults(links: Sequence[Link]) -> Iterator[Fault]:
    """Yield the faults of the parents of links, and of the stations at which they carry joints."""
    divided: dict[int, int] = {}
    for i, (link, k) in enumerate(zip(links, carriers(links), strict=True)):
        station = link.parent_station
        if k >= i:
            rule = f"be 0 (the base) to {i} (the link before)" if i else "be 0 (the base)"
            yield Fault(("links", i, "parent"), rule, shown(k + 1))
        elif station is not None and k < 0:
            hint = "Give the offset of the joint on the base."
            yield Fault(("links", i, "parent_station"), "requires a link as parent", hint=hint)
        elif station is not None:
            faults = list(place_faults(links, k + 1, station, ("parent", "parent_station")))
            yield from (fault.inside("links", i) for fault in faults)
            if links[k].flexible and station and not faults and not at_tip(links[k], station):
                divided.setdefault(k, i)
                yield from (fault.inside("links", i) for fault in _boundary_faults(links[k], link))
    for k, i in divided.items():
        damping = links[k].damping
        if damping is None or (damping.kind == "rayleigh" and damping.mass_coefficient == 0.0):
            continue
        hint = (
            f"Link {i + 1} divides the link. Ratios and mass_coefficient refer to modes of the "
            "whole link, which its pieces do not have. Use stiffness_coefficient alone."
        )
        rule = "be rayleigh without mass_coefficient on a link with a joint between its ends"
        yield Fault(("links", k, "damping"), rule, damping.kind, hint)


def _boundary_faults(parent: Link, link: Link) -> Iterator[Fault]:
    """Yield a fault if a joint sits inside one of several segments of its parent."""
    station = link.parent_station or 0.0
    segments = station / parent.length * parent.segments
    if parent.segments > 1 and abs(segments - round(segments)) > _ROUNDING * parent.segments:
        rule = f"be a multiple of {parent.length / parent.segments:.9g} (the length of a segment)"
        hint = (
            "A flexible link is divided where it carries a joint. Choose segments that end there, "
            "or omit segments."
        )
        yield Fault(("parent_station",), rule, shown(station), hint)


def closure_faults(
    links: Sequence[Link], base: Base, closures: Sequence[Closure]
) -> Iterator[Fault]:
    """Yield the faults of closures whose points do not exist, or which others repeat."""
    ends: list[tuple[_Point, _Point]] = []
    for k, closure in enumerate(closures):
        faults = list(place_faults(links, closure.link, closure.station))
        if closure.to_link:
            names = ("to_link", "to_station")
            faults += place_faults(links, closure.to_link, closure.to_station, names)
        yield from (fault.inside("closures", k) for fault in faults)
        if faults:
            ends.append((None, None))
            continue
        ends.append((
            _point(links, base, closure.link, closure.station, closure.offset),
            _point(links, base, closure.to_link, closure.to_station, closure.to_offset),
        ))  # fmt: skip
        for j, other in enumerate(closures[:k]):
            if set(ends[j]) == set(ends[k]) and not _crossing(closure, other):
                hint = "Keep one of them: a weld contains a pin, and both contain a line or curve."
                yield Fault(("closures", k), f"has the points of closures[{j}]", hint=hint)
                break


#: Number of a link, station (m) and offset (m); None if the point does not exist.
_Point = tuple[int, float, tuple[float, ...]] | None


def _point(
    links: Sequence[Link],
    base: Base,
    link: int | None,
    station: float | None,
    offset: Sequence[float],
) -> _Point:
    """Return a point of a closure in one form; -1 is the ground, also for a base that is fixed."""
    if link:
        length = links[link - 1].length
        at = length if station is None or at_tip(links[link - 1], station) else station
        return link, at, tuple(offset)
    return (0 if link == 0 and base.free else -1), 0.0, tuple(offset)


def _crossing(closure: Closure, other: Closure) -> bool:
    """Return whether two closures are different lines or curves, or have different carriers."""
    if not {closure.kind, other.kind} <= {"line", "curve"}:
        return False
    turned = math.remainder(closure.angle - other.angle, math.pi)
    return closure.link != other.link or closure.shape != other.shape or turned != 0.0


#: Smallest inertia of a coordinate at bodies of mass, inertia and length 1: a zero is rounded.
_ZERO = 1e-9
#: Distances of points of different kinds, so that none coincide unless their distance is zero.
_OFFSET, _CENTRE, _STATION, _HUB, _SLID = 0.37, 0.61, 0.6, 0.5, 0.71
#: Speed of a mass of 1 in one direction, or rate of an inertia of 1: its factors of the velocity of
#: the origin of the body (real and imaginary part), and of the rate of the body.
_Row = tuple[complex, float]


def inertia_faults(
    links: Sequence[Link], joints: Sequence[Joint], payload: Payload, base: Base
) -> Iterator[Fault]:
    """Yield a fault for each joint or base coordinate whose force acts on no inertia.

    Coordinates are eliminated from the tips to the base in a posture without symmetry. Only zeros
    matter, so all masses, inertias and lengths are 1 or 0: a coordinate without inertia makes the
    mass matrix singular in every posture. Bending adds no such coordinate, because links that bend
    have mass.
    """
    tables = [link.beam() for link in links]
    carries = [any(table.mass_per_length) for table in tables]
    if all(carries) and not base.free:
        return
    parents, count = carriers(links), len(links)
    bodies: list[list[_Row]] = [[] for _ in range(count + 1)]  # the last one, -1, is the base
    for i, table in enumerate(tables):
        turns = joints[i].hub_inertia or any(table.rotary_inertia_per_length or ()) or carries[i]
        bodies[i] += _rows(carries[i], turns, 0.5)
    tip = 1.0 + _OFFSET * _along(payload.offset)
    bodies[count - 1] += _rows(payload.mass, payload.inertia, tip)
    carries[-1] = carries[-1] or payload.mass > 0.0
    last = count - 1  # link that is rigidly connected to the payload and has a joint that moves
    while last >= 0 and joints[last].fixed:
        last = parents[last]
    faults = []
    for i in reversed(range(count)):
        joint, k = joints[i], parents[i]
        place = _place(links[i], links[k] if k >= 0 else None, joint)
        behind, resists = _behind(bodies[i], joint, place, 1.0 + 2.4 * i)
        if not resists:
            faults.append(_no_inertia(i, joint, carries[i], i == last))
        bodies[k] += [*behind, *_rows(joint.mass, joint.housing_inertia, place)]
        if k >= 0:
            carries[k] = carries[k] or carries[i] or joint.mass > 0.0
    yield from reversed(faults)
    ground = [*bodies[-1], *_rows(base.mass, base.inertia, _CENTRE * _along(base.centre))]
    ground = [(v * cmath.rect(1.0, "angle" in base.free), w) for v, w in ground]
    shares = {"angle": lambda v, w: w, "y": lambda v, w: v.imag, "x": lambda v, w: v.real}
    for name in filter(base.free.__contains__, shares):
        ground, resists = _follow(ground, [shares[name](*row) for row in ground])
        if not resists:
            hint = "Give the base mass and inertia."
            yield Fault(("base", "free"), f"has {name!r}, which moves no inertia", hint=hint)


def _along(pair: Sequence[float]) -> complex:
    """Return the unit vector of a pair of numbers, or 0."""
    x, y = pair
    return cmath.rect(1.0, math.atan2(y, x)) if x or y else 0j


def _place(link: Link, parent: Link | None, joint: Joint) -> complex:
    """Return the position of a joint on its parent, of length 1."""
    place = _OFFSET * _along(joint.offset)
    if parent is not None:
        station = link.parent_station
        at = 1.0 if at_tip(parent, station) else _STATION * (station != 0.0)
        place += at + _HUB * (parent.hub_radius > 0.0)
    return place


def _rows(mass: float, inertia: float, place: complex) -> list[_Row]:
    """Return the rows of a mass and an inertia of 1 at a place, unless they are 0."""
    rows = [(1.0 + 0j, -place.imag), (1j, place.real)] if mass else []
    return [*rows, *[(0j, 1.0)] * bool(inertia)]


def _behind(
    body: list[_Row], joint: Joint, place: complex, angle: float
) -> tuple[list[_Row], bool]:
    """Return the rows of a body behind its joint, and whether the joint has inertia.

    Joints that turn are at ``angle`` (rad). Fixed joints need no inertia.
    """
    slides, turn = joint.kind == "prismatic", joint.mounting_angle
    axis = _along(joint.axis or (1.0, 0.0))
    if slides:
        place += _SLID * axis * (not joint.fixed or joint.rest_angle != 0.0)
    else:
        turn += joint.rest_angle if joint.fixed else angle
    turned = [(v * cmath.rect(1.0, turn), w) for v, w in body]
    rows = [(v, w + (v.conjugate() * 1j * place).real) for v, w in turned]
    shares = [(v.conjugate() * axis).real if slides else w for v, w in turned]
    if joint.rotor_inertia and not joint.elastic:  # the parent carries the rotor
        rows.append((0j, 1.0))
        # A rotor that turns as its link, with a ratio of 1, does not resist where both do.
        shares.append(1.0 if joint.gear_ratio == 1.0 else 2.0)
    return (rows, True) if joint.fixed else _follow(rows, shares)


def _follow(rows: list[_Row], shares: Sequence[float]) -> tuple[list[_Row], bool]:
    """Let a coordinate with these factors follow its inertia; also return whether it has any."""
    inertia = sum(share * share for share in shares)
    if inertia <= _ZERO:
        return rows, False
    pairs = list(zip(rows, shares, strict=True))
    along = sum(share * v for (v, _), share in pairs) / inertia
    about = sum(share * w for (_, w), share in pairs) / inertia
    return [(v - share * along, w - share * about) for (v, w), share in pairs], True


def _no_inertia(i: int, joint: Joint, carries: bool, last: bool) -> Fault:
    """Return the fault of a joint that acts on no inertia; the payload is behind the last one."""
    if last and not carries and joint.kind == "revolute":
        hint = "Give mass to the last link, hub_inertia to its joint, or a payload to the arm."
        rule = "be greater than 0 at the tip of a massless link"
        return Fault(("payload", "mass"), rule, "0", hint)
    hint = "Give mass to the link or to bodies that it carries"
    inertia = "hub_inertia" if joint.kind == "revolute" else "rotor_inertia"
    hint = f"{hint}, or {inertia} to its joint."
    if carries:
        rule = "has no inertia of its own: the joints further out move all that it carries"
    elif joint.kind == "revolute":
        rule = "has no inertia and carries no mass"
    else:
        rule = "slides, but carries no mass"
    return Fault(("links", i), rule, hint=hint)
