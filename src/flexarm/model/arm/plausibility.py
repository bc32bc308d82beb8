"""Implausible numbers of an arm, which are accepted with a warning.

First materials, sections and angles are judged. Only if these are plausible, stiffness is compared
with mass, and only then payload, inertias, springs and motors with the links, because a wrong
length or density makes them implausible, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress

from flexarm.base.arguments import about_degrees
from flexarm.model.arm.joints import Joint
from flexarm.model.arm.links import Link
from flexarm.model.arm.plausible_masses import judge_masses
from flexarm.model.arm.sections import Material, Section
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.plausible import (
    BETWEEN,
    DENSE,
    DENSEST,
    FACTS,
    SOFTEST,
    Number,
    Range,
    judge,
    judge_fact,
)

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
#: Least turns of a motor per turn of the joint.
_GEAR = 0.3


def implausible(spec: ArmSpec) -> list[str]:
    """Return a sentence for each implausible number of an arm, with the unit that explains it."""
    findings: list[str] = []
    # Products of numbers near the limits of floats; such arms cannot be assembled either.
    with suppress(OverflowError, ZeroDivisionError):
        _judge(findings, spec)
    return findings


def _judge(findings: list[str], spec: ArmSpec) -> None:
    _judge_gravity(findings, *spec.gravity)
    for i, link in enumerate(spec.links):
        _judge_link(findings, f"links[{i}]", link)
    if len(spec.links) > 1:
        _judge_lengths(findings, spec.links)
    for i, joint in enumerate(spec.joints):
        _judge_angles(findings, f"joints[{i}]", joint)
    x, y = spec.payload.offset
    if x or y:
        offset = Number("payload.offset", math.hypot(x, y), "m")
        ratio = offset.value / sum(link.reach for link in spec.links)
        judge(findings, ratio, _OFFSET, "{ratio} times the reach of the arm", offset)
    if not findings:
        judge_masses(findings, spec)


def _judge_gravity(findings: list[str], x: float, y: float) -> None:
    judge_fact(findings, "gravity", math.hypot(x, y), "m/s^2")
    if 9.7 < y <= 10.0 and abs(x) < 0.01 * y:  # upward, and that of the Earth
        text = f"gravity is [{x:g}, {y:g}] m/s^2, upward: did you mean [{x:g}, {-y:g}]?"
        findings.append(f"{text} It is right if your y axis points down.")


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


def _judge_lengths(findings: list[str], links: Sequence[Link]) -> None:
    lengths = sorted((link.length, i) for i, link in enumerate(links))
    (shortest, i), (longest, k) = lengths[0], lengths[-1]
    if longest / shortest <= _LENGTHS.high:
        return
    # The length that differs from that of the median link is wrong.
    middle = lengths[len(lengths) // 2 if len(lengths) % 2 else 0][0]
    wrong, value = (k, longest) if longest / middle > middle / shortest else (i, shortest)
    number = Number(f"links[{wrong}].length", value, "m")
    ratio = value / (shortest if wrong == k else longest)
    judge(findings, ratio, _LENGTHS, "{ratio} times that of another link", number)


def _judge_angles(findings: list[str], at: str, joint: Joint) -> None:
    """Judge the angles and the gear of a joint."""
    for name, within in (("rest_angle", _REST), ("backlash", _BACKLASH)):
        value = getattr(joint, name)
        if abs(value) > within.high:
            number = Number(f"{at}.{name}", value, "rad")
            degrees = f"{math.degrees(value):.4g} deg"
            judge(findings, abs(value), within, degrees, number)
    if joint.limits is not None:
        ends = {name: getattr(joint.limits, name) for name in ("lower", "upper")}
        # A power of ten is a stop that is never reached, such as 1000 rad.
        reached = {k: end for k, end in ends.items() if not _distant(end)}
        text = about_degrees(f"{at}.limits", ends.values()) if reached == ends else ""
        if text:
            findings.append(text)
        for name, end in () if text else reached.items():
            number = Number(f"{at}.limits.{name}", end, "rad")
            turns = f"{abs(end) / (2.0 * math.pi):.3g} turns"
            judge(findings, abs(end), _STOP, turns, number)
    if joint.gear_ratio < _GEAR:
        findings.append(
            f"{at}.gear_ratio is {joint.gear_ratio:.4g}, less than one turn of the motor per turn "
            f"of the joint: did you mean {1.0 / joint.gear_ratio:.4g}?"
        )


def _distant(angle: float) -> bool:
    return abs(angle) > 50.0 and math.log10(abs(angle)) % 1.0 == 0.0
