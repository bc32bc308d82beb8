"""Implausible numbers of an arm, accepted with a warning, and the units that explain them.

A number is compared with other numbers of the same arm wherever possible. Only physical facts have
absolute ranges; they are in `FACTS`. First materials, sections and angles are judged. Only if these
are plausible, stiffness is compared with mass, and only then payload, inertias, springs and motors
with the links, because a wrong length or density makes them implausible, too.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

from flexarm.base.arguments import about_degrees
from flexarm.base.errors import ImplausibleValueWarning, warn_caller
from flexarm.model.arm.joints import Joint
from flexarm.model.arm.links import Link, Material, Section
from flexarm.model.arm.spec import ArmSpec

#: Earth's standard gravity, m/s^2.
STANDARD_GRAVITY = 9.80665

#: Factors to SI units of the units in which users give numbers by mistake, the likeliest first.
MISTAKES: dict[str, tuple[tuple[str, float], ...]] = {
    "m": (("mm", 1e-3), ("um", 1e-6), ("cm", 1e-2), ("km", 1e3)),
    "Pa": (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3), ("mPa", 1e-3)),
    "kg/m^3": (("g/cm^3", 1e3), ("t/mm^3", 1e12), ("g/m^3", 1e-3)),
    "kg": (("g", 1e-3), ("t", 1e3), ("mg", 1e-6)),
    "kg/m": (("g/m", 1e-3), ("kg/mm", 1e3), ("t/mm", 1e6)),
    "N m^2": (("N mm^2", 1e-6), ("kN m^2", 1e3), ("N cm^2", 1e-4), ("mN m^2", 1e-3)),
    "kg m^2": (("g cm^2", 1e-7), ("kg mm^2", 1e-6), ("kg cm^2", 1e-4), ("g m^2", 1e-3)),
    "m/s^2": (("mm/s^2", 1e-3), ("cm/s^2", 1e-2)),
    "rad": (("deg", math.pi / 180.0),),
    "N m/rad": (("kN m/rad", 1e3), ("N mm/rad", 1e-3), ("MN m/rad", 1e6)),
    "N m/A": (("mN m/A", 1e-3), ("N mm/A", 1e-3)),
    "N m s/rad": (("mN m s/rad", 1e-3),),
    "N m": (("N mm", 1e-3), ("kN m", 1e3)),
    "N": (("kN", 1e3), ("mN", 1e-3)),
    "ohm": (("mohm", 1e-3), ("kohm", 1e3)),
    "s": (("ms", 1e-3), ("us", 1e-6)),
}
_MOST_FINDINGS = 5


class Number(NamedTuple):
    """A number that may be wrong."""

    path: str
    value: float  # in SI units
    unit: str  # its SI unit
    power: float = 1.0  # exponent with which a ratio depends on it


class Range(NamedTuple):
    """Range of plausible ratios, and a usual one."""

    low: float
    usual: float
    high: float


#: Physical facts: ranges by unit, and the sentence about a number outside.
FACTS = {
    # From aerogels (Pekala 1989) to osmium, 22,590 kg/m^3 (CRC Handbook of Chemistry and Physics).
    "kg/m^3": (Range(1.0, 2e3, 23e3), "but solids have 1 (aerogel) to 23,000 (osmium)"),
    # From hydrogels and the softest silicones to diamond, 1.2e12 Pa (Ashby, Materials Selection in
    # Mechanical Design, chart of modulus and density; also for the others).
    "Pa": (Range(1e4, 1e10, 1.25e12), "but solids have 1e4 (gels) to 1.2e12 (diamond)"),
    # Speed of sound in a bar: 18 km/s in diamond, 3 m/s in gels.
    "m/s": (
        Range(2.0, 4e3, 2e4),
        "so that sound in it has {ratio} m/s, but solids have 2 (gels) to 2e4 (diamond)",
    ),
    # Jupiter has 24.8 m/s^2 (NASA Planetary Fact Sheet), the most of the planets.
    "m/s^2": (Range(0.0, 9.8, 30.0), "but the planets have at most 25"),
}
#: No solid that is denser than this (kg/m^3) has a modulus in this range (Pa): metals and ceramics
#: are stiffer, elastomers filled with iron softer.
DENSE, BETWEEN = 2300.0, (2e7, 3e8)
#: The same for solids that are denser than every filled elastomer.
DENSEST, SOFTEST = 4000.0, 1e9


def judge(
    findings: list[str], ratio: float, within: Range, statement: str, *numbers: Number
) -> None:
    """Add a finding if a ratio is outside its range.

    It names the number and the unit that bring the ratio nearest to the usual one, with preference
    for the first, which is the likeliest to be wrong; if none brings it into the range, it names
    the first number. The statement continues *NAME is VALUE,* and has ``{ratio}`` in it.
    """
    if within.low <= ratio <= within.high or math.isnan(ratio):
        return
    meant, end, nearest = numbers[0], ".", math.inf
    for k, number in enumerate(numbers):
        for rank, (unit, factor) in enumerate(MISTAKES.get(number.unit, ())):
            corrected = ratio * factor**number.power
            possible = FACTS[number.unit][0] if number.unit in FACTS else None
            if possible and not possible.low <= abs(number.value) * factor <= possible.high:
                continue
            if not (within.low <= corrected <= within.high and corrected > 0.0):
                continue
            unlikely = abs(math.log(corrected / within.usual)) + k + 1.5 * rank
            if unlikely < nearest:
                meant, nearest = number, unlikely
                end = f": did you mean {number.value * factor:.4g} {number.unit} ({unit})?"
    value = f"{meant.path} is {meant.value:.4g} {meant.unit}"
    findings.append(f"{value}, {statement.format(ratio=_short(ratio))}{end}")


def judge_fact(findings: list[str], path: str, value: float, unit: str) -> None:
    """Add a finding if a number is outside the range of `FACTS` for its unit."""
    within, statement = FACTS[unit]
    judge(findings, value, within, statement, Number(path, value, unit))


def _short(ratio: float) -> str:
    return f"{ratio:.0f}" if 100.0 <= ratio < 1e6 else f"{ratio:.2g}"


def warn_of(findings: Sequence[str]) -> None:
    """Warn once, with an `ImplausibleValueWarning`, of all implausible numbers of a call."""
    if not findings:
        return
    shown = " ".join(findings[:_MOST_FINDINGS])
    more = len(findings) - _MOST_FINDINGS
    end = f" ({more} more implausible numbers.)" if more > 0 else ""
    warn_caller(f"{shown}{end}", ImplausibleValueWarning)


#: Depth of a section over the length of its link: for flexible links up to the limit of beam
#: theory, for rigid ones up to blocks; a steel tape of 0.05 mm and 1 m has 5e-5.
_DEPTH, _RIGID_DEPTH = Range(4e-5, 0.03, 0.6), Range(4e-5, 0.03, 5.0)
#: The same for the width, which may exceed the length in leaf springs.
_WIDTH = Range(1e-5, 0.05, 20.0)
#: Wall thickness over depth: deployable booms have 1e-3.
_WALL = Range(2e-4, 0.05, 1.0)
#: Width over depth of a rectangle: films have 1e3, blades on edge 1e-2.
_ASPECT = Range(2e-3, 3.0, 5e3)
#: Hub radius over length of a link, and lengths of links over each other: fingers on a boom.
_HUB, _LENGTHS = Range(0.0, 0.1, 20.0), Range(5e-3, 1.0, 200.0)
#: Distance of gauges from the neutral axis over length and depth.
_GAUGE_BY_LENGTH, _GAUGE = Range(0.0, 0.01, 0.2), Range(2e-3, 0.5, 3.0)
#: Offset of the payload over the reach of the arm.
_OFFSET = Range(0.0, 0.1, 3.0)
#: Backlash and the angle of a fixed joint, rad; stops farther than five turns are not reached.
_BACKLASH, _REST, _STOP = Range(0.0, 1e-3, 0.5), Range(0.0, 1.0, 6.3), Range(0.0, 2.0, 31.5)
#: Lengths of a sliding joint over the reach of the arm: its stroke, and its backlash.
_STROKE, _PLAY = Range(0.0, 0.5, 300.0), Range(0.0, 1e-3, 0.3)
#: Offset of a joint, and distance of a point of a closure, over the reach of the arm.
_AWAY, _REACHES = Range(0.0, 0.3, 100.0), "{ratio} times the reach of the arm"
#: Least turns of a motor per turn of the joint; for a sliding joint least rad/m, because drums and
#: wheels have radii up to 3 m.
_GEAR = 0.3


def implausible(spec: ArmSpec) -> list[str]:
    """Return a sentence for each implausible number of an arm, with the unit that explains it."""
    findings: list[str] = []
    # Products of numbers near the limits of floats; such arms cannot be assembled either.
    with suppress(OverflowError, ZeroDivisionError):
        x, y = spec.gravity
        judge_fact(findings, "gravity", math.hypot(x, y), "m/s^2")
        if 9.7 < y <= 10.0 and abs(x) < 0.01 * y:  # upward, and that of the Earth
            text = f"gravity is [{x:g}, {y:g}] m/s^2, upward: did you mean [{x:g}, {-y:g}]?"
            findings.append(f"{text} It is right if your y axis points down.")
        for i, link in enumerate(spec.links):
            _judge_link(findings, f"links[{i}]", link)
        if len(spec.links) > 1:
            _judge_lengths(findings, spec)
        reach = sum(link.reach for link in spec.links)
        for i, joint in enumerate(spec.joints):
            _judge_angles(findings, f"joints[{i}]", joint, reach)
            _judge_distance(findings, f"joints[{i}].offset", joint.offset, reach)
        for k, closure in enumerate(spec.closures):
            _judge_distance(findings, f"closures[{k}].offset", closure.offset, reach)
            _judge_distance(findings, f"closures[{k}].to_offset", closure.to_offset, reach)
            _judge_angle(findings, f"closures[{k}].angle", closure.angle, _REST)
        _judge_distance(findings, "payload.offset", spec.payload.offset, reach, _OFFSET)
        if not findings:
            judge_masses(findings, spec)
    return findings


def _judge_link(findings: list[str], at: str, link: Link) -> None:
    """Judge the material, the section and the distances of a link."""
    if link.material is not None:
        _judge_material(findings, f"{at}.material", link.material)
    if link.section is not None:
        _judge_section(findings, at, link, link.section)
    if link.hub_radius:
        number = Number(f"{at}.hub_radius", link.hub_radius, "m")
        judge(findings, link.hub_radius / link.length, _HUB, "{ratio} times the length", number)
    for k, gauge in enumerate(link.gauges):
        number = Number(f"{at}.gauges[{k}].distance", gauge.distance, "m")
        ratio = abs(gauge.distance) / link.length
        statement = (
            "{ratio} of the length of its link. It is the distance from the neutral axis, about "
            "half the thickness of the link"
        )
        judge(findings, ratio, _GAUGE_BY_LENGTH, statement, number)
        if link.section is not None and gauge.distance and ratio <= _GAUGE_BY_LENGTH.high:
            ratio = abs(gauge.distance) / link.section.depth
            judge(findings, ratio, _GAUGE, "{ratio} of the depth of the section", number)


def _judge_material(findings: list[str], at: str, material: Material) -> None:
    density = Number(f"{at}.density", material.density, "kg/m^3", -0.5)
    modulus = Number(f"{at}.youngs_modulus", material.youngs_modulus, "Pa", 0.5)
    before = len(findings)
    judge_fact(findings, density.path, density.value, "kg/m^3")
    judge_fact(findings, modulus.path, modulus.value, "Pa")
    if len(findings) > before:
        return
    within, statement = FACTS["m/s"]
    judge(findings, math.sqrt(modulus.value / density.value), within, statement, density, modulus)
    least = SOFTEST if density.value > DENSEST else BETWEEN[1]
    low = 0.0 if density.value > DENSEST else BETWEEN[0]
    if density.value > DENSE and low < modulus.value < least:
        statement = f"but no solid with {density.value:.4g} kg/m^3 is so soft"
        metals = Range(least, 1e11, 1e12)
        judge(findings, modulus.value, metals, statement, modulus._replace(power=1.0))


def _judge_section(findings: list[str], at: str, link: Link, section: Section) -> None:
    """Judge the dimensions of a section by the length, and if they are plausible by each other."""
    before, length = len(findings), Number(f"{at}.length", link.length, "m")
    depth, path = section.depth, f"{at}.section"
    for name, value in section:
        if isinstance(value, float) and name != "thickness":
            within = _DEPTH if link.flexible else _RIGID_DEPTH
            within = _WIDTH if name == "width" else within
            _judge_dimension(findings, Number(f"{path}.{name}", value, "m"), length, within)
    if len(findings) > before:
        return
    width, wall = getattr(section, "width", None), getattr(section, "thickness", None)
    if wall is not None:
        number = Number(f"{path}.thickness", wall, "m")
        judge(findings, wall / depth, _WALL, "{ratio} of the depth of the section", number)
    elif width is not None:
        numbers = Number(f"{path}.width", width, "m"), Number(f"{path}.height", depth, "m", -1.0)
        judge(findings, width / depth, _ASPECT, "so that width over height is {ratio}", *numbers)


def _judge_dimension(findings: list[str], size: Number, length: Number, within: Range) -> None:
    """Judge a dimension of a section by the length of the link."""
    ratio = size.value / length.value
    if ratio > within.low:
        end = "" if ratio > 1.0 else ", which is too deep for a beam"
        times = "times" if ratio > 1.0 else "of"
        judge(findings, ratio, within, f"{{ratio}} {times} the length of the link{end}", size)
        return
    slender = Range(1.0 / within.high, 1.0 / within.usual, 1.0 / within.low)
    what = size.path.rpartition(".")[2].replace("_", " ")
    numbers = length, size._replace(power=-1.0)
    judge(findings, 1.0 / ratio, slender, f"length over {what} is {{ratio}}", *numbers)


def _judge_distance(
    findings: list[str], path: str, place: Sequence[float], reach: float, within: Range = _AWAY
) -> None:
    """Judge the distance of a place by the reach of the arm."""
    distance = Number(path, math.hypot(*place), "m")
    judge(findings, distance.value / reach, within, _REACHES, distance)


def _judge_angle(findings: list[str], path: str, angle: float, within: Range) -> None:
    number = Number(path, angle, "rad")
    judge(findings, abs(angle), within, f"{math.degrees(angle):.4g} deg", number)


def _judge_lengths(findings: list[str], spec: ArmSpec) -> None:
    # A carriage that slides has a length only to carry the next joint.
    items = enumerate(zip(spec.links, spec.joints, strict=True))
    lengths = sorted((link.length, i) for i, (link, joint) in items if joint.kind == "revolute")
    if not lengths:
        return
    (shortest, i), (longest, k) = lengths[0], lengths[-1]
    if longest / shortest <= _LENGTHS.high:
        return
    # The length that differs from that of the median link is wrong.
    middle = lengths[len(lengths) // 2 if len(lengths) % 2 else 0][0]
    wrong, value = (k, longest) if longest / middle > middle / shortest else (i, shortest)
    number = Number(f"links[{wrong}].length", value, "m")
    ratio = value / (shortest if wrong == k else longest)
    judge(findings, ratio, _LENGTHS, "{ratio} times that of another link", number)


def _judge_angles(findings: list[str], at: str, joint: Joint, reach: float) -> None:
    """Judge the angles and the gear of a joint; lengths of a sliding joint by the arm's reach."""
    _judge_angle(findings, f"{at}.mounting_angle", joint.mounting_angle, _REST)
    names = () if joint.limits is None else ("lower", "upper")
    ends = {f"limits.{name}": getattr(joint.limits, name) for name in names}
    # A power of ten is a stop that is never reached, such as 1000 rad.
    reached = {name: end for name, end in ends.items() if not _distant(end)}
    inverse = 1.0 / joint.gear_ratio
    if joint.kind == "prismatic":
        lengths = [("rest_angle", joint.rest_angle, _STROKE), ("backlash", joint.backlash, _PLAY)]
        lengths += [(name, end, _STROKE) for name, end in reached.items()]
        for name, length, within in lengths:
            number = Number(f"{at}.{name}", length, "m")
            judge(findings, abs(length) / reach, within, _REACHES, number)
        text = f" rad/m, as of a wheel with a radius of {inverse:.4g} m"
        meant = f"{inverse:.4g} rad/m"
    else:
        _judge_angle(findings, f"{at}.rest_angle", joint.rest_angle, _REST)
        _judge_angle(findings, f"{at}.backlash", joint.backlash, _BACKLASH)
        degrees = about_degrees(f"{at}.limits", ends.values()) if reached == ends != {} else ""
        findings += [degrees] if degrees else []
        for name, end in () if degrees else reached.items():
            turns = f"{abs(end) / (2.0 * math.pi):.3g} turns"
            judge(findings, abs(end), _STOP, turns, Number(f"{at}.{name}", end, "rad"))
        text = ", less than one turn of the motor per turn of the joint"
        meant = f"{inverse:.4g}"
    if joint.gear_ratio < _GEAR:
        value = f"{at}.gear_ratio is {joint.gear_ratio:.4g}"
        findings.append(f"{value}{text}: did you mean {meant}?")


def _distant(angle: float) -> bool:
    return abs(angle) > 50.0 and math.log10(abs(angle)) % 1.0 == 0.0


#: Young's modulus (Pa) of a solid square bar with the mass and the stiffness of a link and
#: 2000 kg/m^3: from flat strips of gels to thin tubes of fibre composites.
_MODULUS, _GEL = Range(0.0, 1e10, 1e15), Range(1e4, 1e10, 1e15)
#: Mass per length over length squared, kg/m^3, of links with less than this modulus (Pa): those of
#: elastomers have up to 600, of a bar that is half as deep and twice as wide as long.
_BULK, _ELASTOMER = Range(0.0, 10.0, 1e3), 1e6
#: Speed of sound times radius of gyration of the section over the length, m/s: 1e4 m/s times 0.1.
_SPEED = Range(0.0, 30.0, 1.2e3)
#: Deflection of a horizontal link by its weight over its length, with the linear theory: for arms
#: in a vertical plane, and for others, where it is that of a boom on the Earth.
_SAG, _FREE_SAG = Range(0.0, 1e-3, 40.0), Range(0.0, 1e-3, 400.0)
_SOFT_SAG, _FREE_SOFT_SAG = 3.0, 10.0
#: The same by the payload, if this has more than ``_HEAVY`` times the mass of the links.
_CARRIED, _FREE_CARRIED, _HEAVY = Range(0.0, 0.01, 1.0), Range(0.0, 0.01, 10.0), 10.0
#: Mass of the payload over that of the links, its radius of gyration over the reach.
_SHARE, _GYRATION = Range(0.0, 0.5, 3e3), Range(0.0, 0.05, 1.5)
#: Inertias of hubs and rotors (behind the gear), and masses of joints, over those of the arm
#: outboard of them.
_HUB_INERTIA, _ROTOR, _MASS = Range(0.0, 0.03, 1e3), Range(1e-9, 0.3, 1e4), Range(0.0, 0.3, 300.0)
#: Angle (rad) by which the weight turns the spring of a joint, and its stiffness over that of the
#: link.
_TWIST, _FREE_TWIST, _SPRING = Range(0.0, 1e-2, 2.0), Range(0.0, 1e-2, 30.0), Range(1e-4, 30.0, 1e7)
#: Angle (rad) by which the weight turns a joint beyond its stop, friction over the weight.
_BEYOND, _FRICTION = Range(0.0, 1e-2, 3.0), Range(0.0, 0.1, 300.0)
#: Mechanical time constant J R / K^2 of a rotor, s: 1 to 100 ms in data sheets of all sizes; the
#: voltage that holds the arm, V.
_ROTOR_TIME, _HUB_TIME = Range(1e-4, 1e-2, 10.0), Range(1e-4, 10.0, math.inf)
_VOLTAGE = Range(0.0, 10.0, 1e4)


class _Beam(NamedTuple):
    """Mean flexural rigidity (N m^2), mean mass per length (kg/m) and length (m) of a link."""

    rigidity: float
    per_length: float
    length: float

    @property
    def mass(self) -> float:
        return self.per_length * self.length


class _Part(NamedTuple):
    """Mass (kg), first moment (kg m) and inertia (kg m^2) of the arm outboard of a joint."""

    mass: float
    first: complex  # along the axis of the link, and across
    inertia: float


def judge_masses(findings: list[str], spec: ArmSpec) -> None:
    """Judge stiffness and masses of the links, and if these are plausible, the other numbers."""
    gravity = math.hypot(*spec.gravity)
    falls = gravity > 0.05 * STANDARD_GRAVITY
    weight = gravity if falls else STANDARD_GRAVITY
    beams = [_beam(link) for link in spec.links]
    for i, (link, beam) in enumerate(zip(spec.links, beams, strict=True)):
        if link.flexible:
            _judge_inertia(findings, f"links[{i}]", link, beam, weight, falls)
    if findings:
        return
    _judge_payload(findings, spec, beams, weight, falls)
    parts = _outboard(spec, beams)
    for i, (joint, part) in enumerate(zip(spec.joints, parts, strict=True)):
        if not joint.fixed and part.mass and part.inertia:
            _judge_joint(findings, f"joints[{i}]", joint, part, weight, falls)
            if joint.elastic and joint.kind == "revolute":
                torque, before = weight * abs(part.first), len(findings)
                bends = beams[i] if spec.links[i].flexible else None
                number = Number(f"joints[{i}].stiffness", joint.stiffness, "N m/rad")
                statement = "so soft that the weight of the horizontal arm turns it by {ratio} rad"
                twist, within = torque / joint.stiffness, _TWIST if falls else _FREE_TWIST
                judge(findings, twist, within, statement, number._replace(power=-1.0))
                if bends is not None and len(findings) == before:
                    ratio = joint.stiffness * bends.length / bends.rigidity
                    judge(findings, ratio, _SPRING, "{ratio} times that of its link", number)


def weights(spec: ArmSpec) -> list[float]:
    """Return the torque (N m) of gravity at each joint of the horizontal arm, 0 if it slides."""
    parts, weight = _outboard(spec, [_beam(link) for link in spec.links]), math.hypot(*spec.gravity)
    return [
        weight * math.hypot(part.first.real, part.first.imag) if joint.kind == "revolute" else 0.0
        for part, joint in zip(parts, spec.joints, strict=True)
    ]


def _beam(link: Link) -> _Beam:
    material, section, table = link.material, link.section, link.table
    if table is not None:
        columns = table.flexural_rigidity or (0.0,), table.mass_per_length
        rigidity, per_length = (sum(column) / len(column) for column in columns)
        return _Beam(rigidity, per_length, link.length)
    if material is not None and section is not None:
        rigidity = material.youngs_modulus * section.second_moment
        return _Beam(rigidity, material.density * section.area, link.length)
    return _Beam(link.flexural_rigidity or 0.0, link.mass_per_length or 0.0, link.length)


def _outboard(spec: ArmSpec, beams: Sequence[_Beam]) -> list[_Part]:
    """Return the part outboard of each joint, of the arm with all joints at zero."""
    payload, last = spec.payload, spec.links[-1]
    x, y = payload.offset
    inertia = payload.inertia + payload.mass * (x * x + y * y)
    held = _Part(payload.mass, payload.mass * x, inertia)
    carried: list[list[tuple[complex, _Part]]] = [[] for _ in spec.links]
    carried[-1].append((last.reach, held))
    parts: list[_Part] = []
    for i in reversed(range(len(spec.links))):
        link, joint, beam, k = spec.links[i], spec.joints[i], beams[i], spec.parents[i]
        centre = link.hub_radius + 0.5 * link.length
        mass, first = beam.mass, complex(beam.mass * centre)
        inertia = beam.mass * (centre**2 + link.length**2 / 12.0)
        for place, part in carried[i]:
            moment = part.mass * place
            mass, first = mass + part.mass, first + part.first + moment
            inertia += part.inertia + (place.conjugate() * (2.0 * part.first + moment)).real
        parts.append(_Part(mass, first, inertia))
        if k >= 0:
            parent = spec.links[k]
            station = parent.length if link.parent_station is None else link.parent_station
            place = complex(*joint.offset) + parent.hub_radius + station
            turned = first * cmath.rect(1.0, joint.mounting_angle)
            carried[k].append((place, _Part(mass + joint.mass, turned, inertia)))
    return parts[::-1]


def _judge_inertia(
    findings: list[str], at: str, link: Link, beam: _Beam, weight: float, falls: bool
) -> None:
    """Judge the stiffness of a link by its mass and its length."""
    rigidity, per_length, length = beam
    if link.material is not None:
        stiff = Number(f"{at}.material.youngs_modulus", link.material.youngs_modulus, "Pa")
        heavy = Number(f"{at}.material.density", link.material.density, "kg/m^3")
    else:
        place = f"{at}.table" if link.table is not None else at
        stiff = Number(f"{place}.flexural_rigidity", rigidity, "N m^2")
        heavy = Number(f"{place}.mass_per_length", per_length, "kg/m")
    sag = per_length * weight * length**3 / (8.0 * rigidity)
    modulus = 12.0 * rigidity * (2000.0 / per_length) ** 2
    before = len(findings)
    if link.material is None:
        soft = sag > (_SOFT_SAG if falls else _FREE_SOFT_SAG)
        statement = "as of a solid bar of a material with a modulus of {ratio} Pa"
        numbers = stiff, heavy._replace(power=-2.0)
        judge(findings, modulus, _GEL if soft else _MODULUS, statement, *numbers)
        if modulus < _ELASTOMER and len(findings) == before:
            statement = (
                f"as of an elastomer ({modulus:.2g} Pa), {{ratio}} kg/m per square of the length"
            )
            judge(findings, per_length / length**2, _BULK, statement, heavy)
    if len(findings) == before:
        speed = math.sqrt(rigidity / per_length) / length
        statement = f"so stiff that the link alone vibrates with {0.56 * speed / length:.3g} Hz"
        numbers = stiff._replace(power=0.5), heavy._replace(power=-0.5)
        judge(findings, speed, _SPEED, statement, *numbers)
        statement = "so soft that its weight would bend the link by {ratio} times its length"
        long = Number(f"{at}.length", length, "m", 3.0)
        within = _SAG if falls else _FREE_SAG
        judge(findings, sag, within, statement, stiff._replace(power=-1.0), heavy, long)


def _judge_payload(
    findings: list[str], spec: ArmSpec, beams: Sequence[_Beam], weight: float, falls: bool
) -> None:
    """Judge the payload by the mass and the stiffness of the links."""
    payload = spec.payload
    mass, total, last = payload.mass, sum(beam.mass for beam in beams), beams[-1]
    if not mass or not total:
        return
    share, number = mass / total, Number("payload.mass", mass, "kg")
    before = len(findings)
    if share > _HEAVY and spec.links[-1].flexible:
        sag = mass * weight * last.length**2 / (3.0 * last.rigidity)
        statement = f"{share:.3g} times the mass of the links, and its weight would bend the last "
        statement += "link by {ratio} times its length"
        judge(findings, sag, _CARRIED if falls else _FREE_CARRIED, statement, number)
    if len(findings) == before:
        judge(findings, share, _SHARE, "{ratio} times the mass of the links", number)
    if payload.inertia:
        ratio = math.sqrt(payload.inertia / mass) / sum(link.reach for link in spec.links)
        number = Number("payload.inertia", payload.inertia, "kg m^2", 0.5)
        statement = "so that its radius of gyration is {ratio} times the reach of the arm"
        judge(findings, ratio, _GYRATION, statement, number)


def _judge_joint(
    findings: list[str], at: str, joint: Joint, part: _Part, weight: float, falls: bool
) -> None:
    """Judge the inertias, the friction and the motor of a joint by the arm outboard of it."""
    slides, own = joint.kind == "prismatic", "that"
    inertia, load, unit = part.inertia, weight * abs(part.first), "N m"
    statement = "{ratio} times the torque by which the weight turns the horizontal arm"
    if slides:
        inertia, load, unit, own = part.mass, weight * part.mass, "N", "the mass"
        statement = "{ratio} times the weight of the arm outboard of the joint"
    others = "of the arm outboard of the joint"
    geared = joint.rotor_inertia * joint.gear_ratio**2 / inertia
    hub = joint.hub_inertia / inertia
    behind = f"behind the gear {{ratio}} times {own} {others}"
    rows = (
        ("hub_inertia", "kg m^2", hub, _HUB_INERTIA, f"{{ratio}} times that {others}"),
        ("rotor_inertia", "kg m^2", geared, _ROTOR, behind),
        ("mass", "kg", joint.mass / part.mass, _MASS, f"{{ratio}} times that {others}"),
    )
    for name, si, ratio, within, text in rows[slides:]:
        if getattr(joint, name):
            judge(findings, ratio, within, text, Number(f"{at}.{name}", getattr(joint, name), si))
    if joint.friction is not None and load:
        number = Number(f"{at}.friction.coulomb", joint.friction.coulomb, unit)
        judge(findings, joint.friction.coulomb / load, _FRICTION, statement, number)
    if slides:
        return
    if joint.limits is not None and falls:
        number = Number(f"{at}.limits.stiffness", joint.limits.stiffness, "N m/rad", -1.0)
        statement = "so soft that the weight of the arm turns it beyond the stop by {ratio} rad"
        judge(findings, load / joint.limits.stiffness, _BEYOND, statement, number)
    if joint.winding is not None:
        _judge_motor(findings, f"{at}.winding", joint, load if falls else 0.0)


def _judge_motor(findings: list[str], at: str, joint: Joint, torque: float) -> None:
    """Judge a winding by the inertia that it must at least accelerate, and by the weight."""
    winding = joint.winding
    assert winding is not None
    inertia = joint.rotor_inertia or joint.hub_inertia / joint.gear_ratio**2
    constant = Number(f"{at}.torque_constant", winding.torque_constant, "N m/A", -2.0)
    resistance = Number(f"{at}.resistance", winding.resistance, "ohm")
    if inertia:
        seconds = inertia * winding.resistance / winding.torque_constant**2
        statement = "so that the motor alone takes {ratio} s to reach its speed"
        within = _ROTOR_TIME if joint.rotor_inertia else _HUB_TIME
        judge(findings, seconds, within, statement, constant, resistance)
    volts = torque / joint.torque_per_voltage
    statement = "so that the motor needs {ratio} V to hold the horizontal arm"
    judge(findings, volts, _VOLTAGE, statement, resistance, constant._replace(power=-1.0))
