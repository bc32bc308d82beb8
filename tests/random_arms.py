"""Random arms and states, with every option of the specification.

Numbers are in the range of laboratory arms: lengths of 0.5 to 1.5 m, masses of 0.1 to 5 kg, first
clamped frequencies of 10 to 300 rad/s, deflections of a few percent of the length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexarm.model import (
    ArmSpec,
    Box,
    Circle,
    Joint,
    Link,
    Material,
    ModalDamping,
    Payload,
    RayleighDamping,
    Rectangle,
    SectionTable,
    Tube,
)

CLAMPED_FREE = 3.516  # (beta L)^2 of the first mode of a uniform cantilever

# Typical deflection of a link over its length.
MODERATE = 0.02


@dataclass(frozen=True)
class NodalState:
    """A state in physical coordinates.

    angles, angle_rates (n,): relative joint angles, rad and rad/s. nodal, nodal_rates: per link
    (elements, 2), deflection in m and slope in rad at the free nodes; (0, 2) for a rigid link.
    """

    angles: np.ndarray
    nodal: list[np.ndarray]
    angle_rates: np.ndarray
    nodal_rates: list[np.ndarray]


def random_spec(
    rng: np.random.Generator,
    *,
    links: int | None = None,
    theory: str | None = None,
    elements: int | None = None,
    rigid: bool | None = None,
    gravity: bool | None = None,
    damping: bool | None = None,
    reduced: bool = False,
) -> ArmSpec:
    """Draw an arm of 1 to 4 links; arguments that are None are random.

    rigid: all links rigid, or none. damping: in links and joints, or nowhere. reduced: links keep
    some of their modes only.
    """
    count = int(rng.integers(1, 5)) if links is None else links
    weight = rng.normal(size=2) * 7 if decide(rng, gravity) else (0.0, 0.0)
    return ArmSpec(
        links=[random_link(rng, elements, rigid, damping, reduced) for _ in range(count)],
        joints=[random_joint(rng, damping) for _ in range(count)],
        payload=random_payload(rng),
        gravity=tuple(float(g) for g in weight),
        theory=theory or str(rng.choice(["linear", "second_order"])),
    )


def random_state(rng: np.random.Generator, spec: ArmSpec) -> NodalState:
    """Draw joint angles, smooth bending of a few percent and a small amount of every higher
    mode."""
    n, size = len(spec.links), MODERATE
    return NodalState(
        angles=rng.uniform(-np.pi, np.pi, n),
        nodal=[random_bending(rng, link, size) for link in spec.links],
        angle_rates=rng.uniform(-2, 2, n),
        nodal_rates=[random_bending(rng, link, 0.1) for link in spec.links],
    )


def decide(rng: np.random.Generator, wish: bool | None, chance: float = 0.5) -> bool:
    """Return the requested value or, if there is none, true with this probability."""
    drawn = bool(rng.random() < chance)
    return drawn if wish is None else wish


def maybe(rng: np.random.Generator, low: float, high: float, wish: bool | None = None) -> float:
    """Draw a number between the limits, or zero with probability one half."""
    value = float(rng.uniform(low, high))
    return value if decide(rng, wish) else 0.0


def random_joint(rng: np.random.Generator, damping: bool | None) -> Joint:
    return Joint(
        hub_inertia=maybe(rng, 0.001, 0.1),
        mass=maybe(rng, 0.1, 2.0),
        housing_inertia=maybe(rng, 0.001, 0.05),
        damping=maybe(rng, 0.01, 0.5, damping),
    )


def random_payload(rng: np.random.Generator) -> Payload:
    offset: Any = tuple(float(c) for c in rng.uniform(-0.2, 0.2, 2))
    return Payload(
        mass=maybe(rng, 0.05, 1.0),
        inertia=maybe(rng, 0.001, 0.05),
        offset=offset if decide(rng, None) else (0.0, 0.0),
    )


def random_link(
    rng: np.random.Generator,
    elements: int | None,
    rigid: bool | None,
    damping: bool | None,
    reduced: bool,
) -> Link:
    length = float(rng.uniform(0.5, 1.5))
    mesh = int(rng.integers(1, 5)) if elements is None else elements
    flexible = not decide(rng, rigid, chance=0.2)
    options: dict[str, Any] = {"elements": mesh, "flexible": flexible}
    if reduced and flexible:
        options["modes"] = int(rng.integers(1, 2 * mesh + 1))
    if decide(rng, damping):
        options["damping"] = random_damping(rng, options.get("modes", 2 * mesh))
    kind = rng.choice(["constants", "section", "table"])
    section = {"constants": constants, "section": material_section, "table": table}[str(kind)]
    return Link(length=length, **section(rng, length), **options)


def random_damping(rng: np.random.Generator, modes: int) -> ModalDamping | RayleighDamping:
    if decide(rng, None):
        ratios = rng.uniform(0.001, 0.05, int(rng.integers(1, modes + 1))).tolist()
        return ModalDamping(ratio=ratios if decide(rng, None) else ratios[0])
    return RayleighDamping(
        mass_coefficient=float(rng.uniform(0, 0.5)),
        stiffness_coefficient=float(rng.uniform(0, 1e-3)),
    )


def constants(rng: np.random.Generator, length: float) -> dict[str, Any]:
    mass = float(rng.uniform(0.2, 3.0))
    frequency = float(rng.uniform(10.0, 100.0))
    return {
        "flexural_rigidity": mass * length**4 * (frequency / CLAMPED_FREE) ** 2,
        "mass_per_length": mass,
        "rotary_inertia_per_length": maybe(rng, 1e-5, 1e-2) or None,
    }


def material_section(rng: np.random.Generator, length: float) -> dict[str, Any]:
    depth = length * float(rng.uniform(0.015, 0.03))
    section = [
        Rectangle(width=2 * depth, height=depth),
        Circle(diameter=depth),
        Tube(outer_diameter=depth, thickness=depth / 6),
        Box(width=2 * depth, height=depth, thickness=depth / 8),
    ][int(rng.integers(4))]
    material: Any = [
        "steel",
        "aluminium",
        Material(density=1600.0, youngs_modulus=6e10),
    ][int(rng.integers(3))]
    rotary = [None, True, False][int(rng.integers(3))]
    return {"material": material, "section": section, "rotary_inertia": rotary}


def table(rng: np.random.Generator, length: float) -> dict[str, Any]:
    """Draw a tapered link whose breakpoints are anywhere between the nodes."""
    count = int(rng.integers(2, 6))
    x = np.concatenate([[0.0], np.sort(rng.uniform(0.05, 0.95, count - 2)), [1.0]]) * length
    x[-1] = length
    uniform = constants(rng, length)
    columns = {
        "flexural_rigidity": uniform["flexural_rigidity"] * rng.uniform(0.6, 1.4, count),
        "mass_per_length": uniform["mass_per_length"] * rng.uniform(0.6, 1.4, count),
    }
    if decide(rng, None):
        columns["rotary_inertia_per_length"] = rng.uniform(0.0, 1e-2, count)
    return {"table": SectionTable(x=x.tolist(), **{k: c.tolist() for k, c in columns.items()})}


def random_bending(rng: np.random.Generator, link: Link, size: float) -> np.ndarray:
    """Draw nodal values of ``v = size * L * (a s^2 + b s^3 + c s^4)``, s = x/L, with noise.

    The noise of one percent excites the highest modes of the mesh, which a smooth shape would not.
    """
    if not link.flexible:
        return np.zeros((0, 2))
    powers = np.array([2, 3, 4])
    factors = size * rng.normal(size=3)
    s = np.arange(1, link.elements + 1)[:, None] / link.elements
    deflection = link.length * (s**powers @ factors)
    slope = (powers * s ** (powers - 1)) @ factors
    noise = 0.01 * size * rng.normal(size=(link.elements, 2)) * [link.length, 1.0]
    return np.stack([deflection, slope], axis=1) + noise
