"""Random arms with the sizes, materials and drives of real ones, from 0.1 mm to 30 m."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flexarm.model import (
    ArmSpec,
    Box,
    Circle,
    Friction,
    Gauge,
    Joint,
    JointLimits,
    Link,
    Material,
    ModalDamping,
    Payload,
    Rectangle,
    SectionTable,
    Tube,
    Winding,
)

#: Density (kg/m^3), Young's modulus (Pa), shortest and longest link (m), depth over length.
MATERIALS: dict[str, tuple[tuple[float, float], ...]] = {
    "steel": ((7700, 8000), (190e9, 210e9), (0.01, 10), (0.004, 0.12)),
    "aluminium": ((2650, 2850), (68e9, 73e9), (0.01, 30), (0.004, 0.12)),
    "cfrp": ((1450, 1650), (50e9, 250e9), (0.05, 30), (0.004, 0.1)),
    "polymer": ((900, 1400), (0.5e9, 5e9), (0.001, 2), (0.02, 0.15)),
    "silicone": ((950, 1250), (5e4, 3e6), (0.001, 0.5), (0.06, 0.25)),
    "silicon": ((2329, 2331), (130e9, 190e9), (1e-4, 0.01), (0.01, 0.1)),
}
_GRAVITY = 9.81


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def plausible_spec(rng: np.random.Generator) -> ArmSpec:
    """Draw an arm of 1 to 4 links."""
    kind = str(rng.choice(list(MATERIALS)))
    _, _, sizes, _ = MATERIALS[kind]
    length = log_uniform(rng, *sizes)
    count = int(rng.integers(1, 5))
    gravity = _gravity(rng, soft=kind == "silicone", small=length < 2e-3)
    while True:
        links = [_link(rng, kind, length * log_uniform(rng, 0.4, 1.0)) for _ in range(count)]
        sags = [_sag(link) for link in links]
        if max(sags) < (2.0 if kind == "silicone" else 0.3):
            break
    masses = [link.beam().mass_per_length[0] * link.length for link in links]
    payload = _payload(rng, links, sum(masses))
    joints, outer, first, inertia = [], payload.mass, 0.0, payload.inertia
    for link, mass in reversed(list(zip(links, masses, strict=True))):
        inertia += outer * link.reach**2 + 2.0 * link.reach * first + mass * link.reach**2 / 3.0
        first += outer * link.reach + mass * link.reach / 2.0
        outer += mass
        joints.append(_joint(rng, link, inertia, first * _GRAVITY, outer))
        outer += joints[-1].mass
    return ArmSpec(links=links, joints=joints[::-1], payload=payload, gravity=gravity)


def _gravity(rng: np.random.Generator, soft: bool, small: bool) -> tuple[float, float]:
    angle = rng.uniform(0.0, 0.5 * math.pi)
    inclined = (-_GRAVITY * math.sin(angle), -_GRAVITY * math.cos(angle))
    choices = [(0.0, 0.0), (0.0, -_GRAVITY), inclined, (_GRAVITY, 0.0), (0.0, -1.62)]
    del soft
    return (0.0, 0.0) if small else choices[int(rng.integers(len(choices)))]


def _link(rng: np.random.Generator, kind: str, length: float) -> Link:
    densities, moduli, _, depths = MATERIALS[kind]
    material = Material(
        density=float(rng.uniform(*densities)), youngs_modulus=log_uniform(rng, *moduli)
    )
    section = _section(rng, length, length * log_uniform(rng, *depths))
    options: dict[str, Any] = {"length": length}
    if rng.random() < 0.3:
        options["hub_radius"] = length * log_uniform(rng, 0.02, 0.5)
    if rng.random() < 0.3:
        options["damping"] = ModalDamping(ratio=float(rng.uniform(0.001, 0.05)))
    if rng.random() < 0.3:
        options["gauges"] = [Gauge(station=0.1 * length, distance=0.5 * section.depth)]
    link = Link(material=material, section=section, **options)
    form, beam = rng.random(), link.beam()
    rigidity, mass = (beam.flexural_rigidity or (0.0,))[0], beam.mass_per_length[0]
    if form < 0.4:
        return link
    if form < 0.7:  # cables and covers add mass
        mass *= float(rng.uniform(1.0, 2.0))
        return Link(flexural_rigidity=rigidity, mass_per_length=mass, **options)
    taper = rng.uniform(0.5, 1.0, 2)
    table = SectionTable(
        x=[0.0, 0.5 * length, length],
        flexural_rigidity=[rigidity, rigidity * taper[0], rigidity * taper.prod()],
        mass_per_length=[mass, mass * taper[0] ** 0.5, mass * taper.prod() ** 0.5],
    )
    return Link(table=table, **options)


def _section(rng: np.random.Generator, length: float, depth: float) -> Any:
    width = depth * log_uniform(rng, 0.3, 30.0)
    wall = depth * log_uniform(rng, 0.01, 0.2)
    return [
        Rectangle(width=min(width, 2.0 * length), height=depth),
        Circle(diameter=depth),
        Tube(outer_diameter=depth, thickness=wall),
        Box(width=depth * log_uniform(rng, 0.5, 3.0), height=depth, thickness=0.5 * wall),
    ][int(rng.integers(4))]


def _sag(link: Link) -> float:
    """Return the deflection of the horizontal link by its weight, over its length."""
    beam = link.beam()
    rigidity = min(beam.flexural_rigidity or (1.0,))
    return beam.mass_per_length[0] * _GRAVITY * link.length**3 / (8.0 * rigidity)


def _payload(rng: np.random.Generator, links: list[Link], mass: float) -> Payload:
    if rng.random() < 0.3:
        return Payload()
    last = links[-1]
    rigidity = min(last.beam().flexural_rigidity or (1.0,))
    most = 0.3 * 3.0 * rigidity / (_GRAVITY * last.length**2)
    carried = min(mass * log_uniform(rng, 0.02, 5.0), most)
    size = last.length * log_uniform(rng, 0.01, 0.3)
    return Payload(mass=carried, inertia=carried * size**2 / 6.0, offset=(0.5 * size, 0.0))


def _joint(
    rng: np.random.Generator, link: Link, inertia: float, torque: float, mass: float
) -> Joint:
    if rng.random() < 0.1:
        return Joint(fixed=True, rest_angle=float(rng.uniform(-1.5, 1.5)))
    options: dict[str, Any] = {}
    if rng.random() < 0.6:
        options["hub_inertia"] = inertia * log_uniform(rng, 1e-3, 3.0)
    if rng.random() < 0.5:
        options["mass"] = mass * log_uniform(rng, 0.02, 5.0)
    if rng.random() < 0.3:
        options["damping"] = math.sqrt(inertia * torque) * log_uniform(rng, 1e-3, 1.0)
    if rng.random() < 0.3:
        options["friction"] = Friction(coulomb=torque * log_uniform(rng, 0.01, 0.3))
    if rng.random() < 0.3:
        low, high = float(rng.uniform(-3.1, -0.5)), float(rng.uniform(0.5, 3.1))
        options["limits"] = JointLimits(lower=low, upper=high, stiffness=100.0 * torque)
    if rng.random() < 0.5:
        options |= _motor(rng, link, inertia, torque)
    return Joint(**options)


def _motor(rng: np.random.Generator, link: Link, inertia: float, torque: float) -> dict[str, Any]:
    ratio = 1.0 if rng.random() < 0.2 else float(round(log_uniform(rng, 5.0, 200.0)))
    rotor = inertia * log_uniform(rng, 0.02, 5.0) / ratio**2
    options: dict[str, Any] = {"gear_ratio": ratio, "rotor_inertia": rotor}
    if rng.random() < 0.6:
        rigidity = (link.beam().flexural_rigidity or (1.0,))[0]
        options["stiffness"] = max(
            rigidity / link.length * log_uniform(rng, 1.0, 300.0), 20.0 * torque
        )
        if rng.random() < 0.3:
            options["backlash"] = log_uniform(rng, 1e-4, 5e-3)
    resistance = log_uniform(rng, 0.2, 30.0)
    constant = math.sqrt(rotor * resistance / log_uniform(rng, 3e-3, 0.1))
    if torque * resistance / (ratio * constant) < 300.0:  # volts that hold the arm
        options["winding"] = Winding(torque_constant=constant, resistance=resistance)
    return options
