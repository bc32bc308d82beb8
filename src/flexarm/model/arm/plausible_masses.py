"""Plausible masses, stiffness, springs and motors of an arm whose dimensions are plausible."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from flexarm.model.arm.joints import Joint, Payload
from flexarm.model.arm.links import Link
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.plausible import STANDARD_GRAVITY, Number, Range, judge

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
_HUB, _ROTOR, _MASS = Range(0.0, 0.03, 1e3), Range(1e-9, 0.3, 1e4), Range(0.0, 0.3, 300.0)
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
    first: float
    inertia: float


def judge_masses(findings: list[str], spec: ArmSpec) -> None:
    """Judge stiffness and masses of the links, and if these are plausible, the other numbers."""
    gravity = math.hypot(*spec.gravity)
    falls = gravity > 0.05 * STANDARD_GRAVITY
    weight = gravity if falls else STANDARD_GRAVITY
    beams = [_beam(link) for link in spec.links]
    for i, (link, beam) in enumerate(zip(spec.links, beams, strict=True)):
        if link.flexible:
            _judge_link(findings, f"links[{i}]", link, beam, weight, falls)
    if findings:
        return
    _judge_payload(findings, spec, beams, weight, falls)
    parts = _outboard(spec, beams)
    for i, (joint, part) in enumerate(zip(spec.joints, parts, strict=True)):
        if not joint.fixed and part.mass and part.inertia:
            at, torque = f"joints[{i}]", weight * abs(part.first)
            _judge_joint(findings, at, joint, part, torque, falls)
            if joint.elastic:
                bends = beams[i] if spec.links[i].flexible else None
                _judge_spring(findings, at, joint, bends, torque, falls)


def weights(spec: ArmSpec) -> list[float]:
    """Return the torque (N m) by which gravity turns each joint of the horizontal, straight arm."""
    parts = _outboard(spec, [_beam(link) for link in spec.links])
    return [math.hypot(*spec.gravity) * abs(part.first) for part in parts]


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
    """Return the part outboard of each joint, of the straight arm."""
    payload = spec.payload
    x, y = payload.offset
    mass, first = payload.mass, payload.mass * x
    inertia = payload.inertia + payload.mass * (x * x + y * y)
    parts: list[_Part] = []
    for link, joint, beam in zip(spec.links[::-1], spec.joints[::-1], beams[::-1], strict=True):
        reach, centre = link.reach, link.hub_radius + 0.5 * link.length
        inertia += reach * (2.0 * first + mass * reach)
        inertia += beam.mass * (centre**2 + link.length**2 / 12.0)
        first += mass * reach + beam.mass * centre
        mass += beam.mass
        parts.append(_Part(mass, first, inertia))
        mass += joint.mass
    return parts[::-1]


def _judge_link(
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
    payload: Payload = spec.payload
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
    findings: list[str], at: str, joint: Joint, part: _Part, torque: float, falls: bool
) -> None:
    """Judge the inertias, the friction and the motor of a joint by the arm outboard of it."""
    others = "times that of the arm outboard of the joint"
    if joint.hub_inertia:
        number = Number(f"{at}.hub_inertia", joint.hub_inertia, "kg m^2")
        judge(findings, joint.hub_inertia / part.inertia, _HUB, f"{{ratio}} {others}", number)
    if joint.rotor_inertia:
        number = Number(f"{at}.rotor_inertia", joint.rotor_inertia, "kg m^2")
        ratio = joint.rotor_inertia * joint.gear_ratio**2 / part.inertia
        judge(findings, ratio, _ROTOR, f"behind the gear {{ratio}} {others}", number)
    if joint.mass:
        number = Number(f"{at}.mass", joint.mass, "kg")
        judge(findings, joint.mass / part.mass, _MASS, f"{{ratio}} {others}", number)
    if joint.friction is not None and torque:
        number = Number(f"{at}.friction.coulomb", joint.friction.coulomb, "N m")
        statement = "{ratio} times the torque by which the weight turns the horizontal arm"
        judge(findings, joint.friction.coulomb / torque, _FRICTION, statement, number)
    if joint.limits is not None and falls:
        number = Number(f"{at}.limits.stiffness", joint.limits.stiffness, "N m/rad", -1.0)
        statement = "so soft that the weight of the arm turns it beyond the stop by {ratio} rad"
        judge(findings, torque / joint.limits.stiffness, _BEYOND, statement, number)
    if joint.winding is not None:
        _judge_motor(findings, f"{at}.winding", joint, torque if falls else 0.0)


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


def _judge_spring(
    findings: list[str], at: str, joint: Joint, beam: _Beam | None, torque: float, falls: bool
) -> None:
    """Judge the spring of an elastic joint by the weight and by the stiffness of its link."""
    number, before = Number(f"{at}.stiffness", joint.stiffness, "N m/rad"), len(findings)
    statement = "so soft that the weight of the horizontal arm turns it by {ratio} rad"
    twist, within = torque / joint.stiffness, _TWIST if falls else _FREE_TWIST
    judge(findings, twist, within, statement, number._replace(power=-1.0))
    if beam is not None and len(findings) == before:
        ratio = joint.stiffness * beam.length / beam.rigidity
        judge(findings, ratio, _SPRING, "{ratio} times that of its link", number)
