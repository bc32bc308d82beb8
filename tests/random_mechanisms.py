"""Random trees and closed mechanisms, as keyword arguments of ``fa.Arm``, from 1 cm to 10 m.

All numbers are multiples of a length, a mass and a bending stiffness of the mechanism, so that the
sizes are in proportion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexarm.model import (
    ArmSpec,
    Base,
    Closure,
    Friction,
    Joint,
    JointLimits,
    Link,
    ModalDamping,
    Payload,
    RayleighDamping,
    Rectangle,
    RoundWall,
    SurfaceTable,
    Wall,
)
from oracles.mechanisms import MechanismOracle
from random_arms import decide

GRAVITY = 9.81
CLAMPED_FREE = 3.516  # (beta L)^2 of the first mode of a uniform cantilever

# Smallest to largest eigenvalue of J M^-1 J^T, in units of the reach, of closures that are
# independent. Near 1e-10 the posture is singular.
INDEPENDENT = 1e-5


@dataclass(frozen=True)
class Scale:
    """Typical length (m) and mass (kg) of the links."""

    length: float
    mass: float

    @property
    def inertia(self) -> float:
        """Inertia of a link about its root, kg m^2."""
        return self.mass * self.length**2 / 3

    @property
    def rate(self) -> float:
        """Rate of a falling link, rad/s."""
        return (GRAVITY / self.length) ** 0.5


def random_mechanism(
    seed: int, *, closures: bool = False, curved: bool = False, theory: str | None = None
) -> dict[str, Any]:
    """Draw a tree of 2 to 6 links, as keyword arguments of ``fa.Arm``.

    closures: one or two, which straight links close at the zero of all coordinates; ``curved``: all
    of them along curves. theory: by default any.
    """
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    length = float(np.exp(rng.uniform(np.log(0.01), np.log(10.0))))
    rods = [_rod(rng, length * float(rng.uniform(0.5, 1.5))) for _ in range(count)]
    tables = [Link(**rod).beam() for rod in rods]
    scale = Scale(
        length=length,
        mass=float(np.mean([t.mass_per_length[0] * t.x[-1] for t in tables])),
    )
    parents, stations = _tree(rng, rods)
    divided = {p for p, s in zip(parents, stations, strict=True) if s}
    links = []
    for i, (rod, parent, station) in enumerate(zip(rods, parents, stations, strict=True)):
        places = {} if parent == i else {"parent": parent}  # by default the link before
        places |= {} if station is None else {"parent_station": station}
        mesh = _mesh(rng, Link(**rod), i + 1 not in divided)
        links.append(Link(**rod, **places, **mesh))
    weight = [(0.0, 0.0), (0.0, -GRAVITY), (3.0, -9.0)][int(rng.integers(3))]
    fields: dict[str, Any] = {
        "links": links,
        "joints": [_joint(rng, scale) for _ in links],
        "payload": _payload(rng, scale),
        "gravity": weight,
        "theory": theory or str(rng.choice(["linear", "second_order"])),
    }
    base = _base(rng, scale, count)
    if base is not None:
        fields["base"] = base
    if all(joint.fixed for joint in fields["joints"]) and base is None:
        fields["joints"][0] = Joint()
    if closures:
        kinds = ["curve"] if curved else ["pin", "weld", "line"]
        fields["closures"] = _closures(rng, fields, scale, kinds)
    return fields


def random_motion(
    rng: np.random.Generator, oracle: MechanismOracle
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw coordinates and rates (dof,) of the oracle, and forces of motors (joints,).

    Links bend by a few percent of their length, stiff ones as much as a few times their weight
    bends them, so that no force hides the others.
    """
    spec = oracle.spec
    length = float(np.mean([link.length for link in spec.links]))
    mass = float(sum(np.sum(points.mass) for points in oracle.points)) / len(spec.links)
    scale = Scale(length, mass)
    sizes = np.ones(oracle.dof)
    for name, at in oracle.base_index.items():
        sizes[at] = 1.0 if name == "angle" else length
    forces = []
    for i, at in oracle.angle_of.items():
        joint = spec.joints[i]
        slides = joint.kind == "prismatic"
        sizes[at] = 0.3 * length if slides else 2.0
        sizes[oracle.spring_of[i]] = sizes[at] * (0.02 if joint.elastic else 1.0)
        forces.append(mass * GRAVITY * (1.0 if slides else length))
    for where, points in zip(oracle.shape_slice, oracle.points, strict=True):
        if where.stop > where.start:
            most = np.abs(points.deflection).max(axis=0).astype(float)
            squares = np.diag(points.stiffness_matrix) / np.diag(points.mass_matrix)
            # The stiffness accelerates points by as much as gravity, or a few times that.
            sizes[where] = np.minimum(0.05 * float(points.x[-1]), 5.0 * GRAVITY / squares) / most
    q, qd = rng.normal(size=(2, oracle.dof)) * sizes
    return q, qd * scale.rate, rng.normal(size=len(forces)) * forces


def _rod(rng: np.random.Generator, length: float) -> dict[str, Any]:
    """Draw a link with a solid section of metal, or one that its weight bends by some percent."""
    depth = length * float(rng.uniform(0.015, 0.05))
    section = Rectangle(width=depth * float(rng.uniform(1.0, 3.0)), height=depth)
    fields: dict[str, Any] = {
        "length": length,
        "flexible": decide(rng, None, 0.75),
        "hub_radius": length * float(rng.uniform(0.05, 0.2)) if decide(rng, None, 0.25) else 0.0,
    }
    if decide(rng, None, 0.4):
        material = str(rng.choice(["steel", "aluminium"]))
        return {**fields, "material": material, "section": section}
    density = 2000.0 * section.area
    weight, sag = density * GRAVITY * length, length * float(rng.uniform(0.01, 0.1))
    fields |= {"flexural_rigidity": weight * length**3 / (8.0 * sag), "mass_per_length": density}
    if decide(rng, None):
        fields["rotary_inertia_per_length"] = 2000.0 * section.second_moment
    return fields


def _tree(
    rng: np.random.Generator, rods: list[dict[str, Any]]
) -> tuple[list[int], list[float | None]]:
    """Draw the parent of each link, by number, 0: the base, and the station on it, None: the
    tip."""
    parents: list[int] = [0]
    stations: list[float | None] = [None]
    for i in range(1, len(rods)):
        parent = i if decide(rng, None, 0.5) else int(rng.integers(0, i + 1))
        station = None
        if parent and decide(rng, None, 0.4):
            share = 0.0 if decide(rng, None, 0.4) else float(rng.uniform(0.2, 0.8))
            station = share * rods[parent - 1]["length"]
        parents.append(parent)
        stations.append(station)
    return parents, stations


def _mesh(rng: np.random.Generator, link: Link, whole: bool) -> dict[str, Any]:
    """Draw elements, segments and damping; ratios of modes only for links in one part."""
    if not link.flexible:
        return {}
    elements = int(rng.integers(1, 4))
    options: dict[str, Any] = {"elements": elements}
    if whole and elements == 2 and decide(rng, None):
        options["segments"] = 2
    beam = link.beam()
    assert beam.flexural_rigidity is not None
    slowness = (beam.mass_per_length[0] / beam.flexural_rigidity[0]) ** 0.5
    period = slowness * link.length**2 / CLAMPED_FREE  # 1 / (rad/s)
    ratio = float(rng.uniform(0.001, 0.02))
    if decide(rng, None, 0.3):
        options["damping"] = RayleighDamping(stiffness_coefficient=2.0 * ratio * period)
    elif whole and "segments" not in options and decide(rng, None, 0.4):
        options["damping"] = ModalDamping(ratio=ratio)
    return options


def _joint(rng: np.random.Generator, scale: Scale) -> Joint:
    """Draw a joint that turns or slides; fixed, elastic or neither."""
    options: dict[str, Any] = {}
    if decide(rng, None, 0.5):
        options["offset"] = tuple(float(x) for x in rng.uniform(-0.3, 0.3, 2) * scale.length)
    if decide(rng, None, 0.7):
        options["mounting_angle"] = float(rng.uniform(-2.5, 2.5))
    if decide(rng, None, 0.4):
        options["mass"] = scale.mass * float(rng.uniform(0.05, 1.0))
        options["housing_inertia"] = scale.inertia * float(rng.uniform(0.01, 0.3))
    if decide(rng, None, 0.4):
        options["hub_inertia"] = scale.inertia * float(rng.uniform(0.01, 0.5))
    slides = decide(rng, None, 0.3)
    unit = scale.length if slides else 1.0
    if slides:
        options |= {"kind": "prismatic", "axis": tuple(float(x) for x in rng.normal(size=2))}
    if decide(rng, None, 0.12):
        return Joint(fixed=True, rest_angle=float(rng.uniform(-0.5, 0.5)) * unit, **options)
    inertia, torque = scale.inertia / unit**2, scale.mass * GRAVITY * scale.length / unit
    if decide(rng, None, 0.4):
        options["gear_ratio"] = float(rng.uniform(1.0, 50.0)) / unit
        reflected = inertia * float(rng.uniform(0.02, 2.0))
        options["rotor_inertia"] = reflected / options["gear_ratio"] ** 2
        if decide(rng, None):  # elastic: some degrees of twist by the weight
            options["stiffness"] = 30.0 * torque / unit * float(rng.uniform(0.5, 3.0))
    elif decide(rng, None, 0.3):
        options["stiffness"] = torque / unit * float(rng.uniform(0.2, 3.0))
        options["rest_angle"] = float(rng.uniform(-0.5, 0.5)) * unit
    if decide(rng, None, 0.4):
        options["damping"] = inertia * scale.rate * float(rng.uniform(0.01, 0.5))
    if decide(rng, None, 0.2):
        options["friction"] = Friction(
            coulomb=torque * float(rng.uniform(0.01, 0.3)),
            viscous=inertia * scale.rate * float(rng.uniform(0.01, 0.3)),
            stribeck_rate=0.1 * unit * scale.rate,
        )
    if decide(rng, None, 0.2):
        options["limits"] = JointLimits(
            lower=-0.5 * unit, upper=0.7 * unit, stiffness=20.0 * torque / unit
        )
    return Joint(**options)


def _payload(rng: np.random.Generator, scale: Scale) -> Payload:
    if decide(rng, None, 0.3):
        return Payload()
    mass, size = scale.mass * float(rng.uniform(0.1, 2.0)), 0.2 * scale.length
    offset = tuple(float(x) for x in rng.uniform(-size, size, 2))
    return Payload(
        mass=mass, inertia=mass * size**2 / 6, offset=offset if decide(rng, None) else (0.0, 0.0)
    )


def _base(rng: np.random.Generator, scale: Scale, links: int) -> Base | None:
    """Draw a base with free or elastic coordinates, or None for a fixed one."""
    if decide(rng, None, 0.35):
        return None
    names = [name for name in ("x", "y", "angle") if decide(rng, None, 0.7)] or ["x"]
    mass = scale.mass * links * float(rng.uniform(0.3, 3.0))
    size = scale.length
    fields: dict[str, Any] = {"mass": mass, "inertia": mass * size**2 * float(rng.uniform(0.1, 1))}
    if decide(rng, None):
        fields["centre"] = tuple(float(x) for x in rng.uniform(-0.3, 0.3, 2) * size)
    if decide(rng, None, 0.4):
        # Periods of the base on its springs as of a pendulum, or shorter.
        squared = scale.rate**2 * float(rng.uniform(1.0, 100.0))
        free = [name in names for name in ("x", "y", "angle")]
        weights = np.where(free, [mass, mass, fields["inertia"]], 0.0)
        fields["stiffness"] = tuple((weights * squared).tolist())
        fields["damping"] = tuple((weights * 0.1 * squared**0.5).tolist())
    return Base(free=tuple(names), **fields)


def _closures(
    rng: np.random.Generator, fields: dict[str, Any], scale: Scale, kinds: list[str]
) -> list[Closure]:
    """Draw closures that hold at zero coordinates and are independent there."""
    opened = MechanismOracle(ArmSpec(**fields), precision=np.float64)
    count = int(rng.integers(1, 3))
    for _ in range(100):
        drawn = [_closure(rng, opened, kinds) for _ in range(count)]
        spec = opened.spec.replace(closures=drawn)
        if _independent(MechanismOracle(spec, precision=np.float64), scale):
            return drawn
        count = 1
    raise ValueError("no independent closures found")


def _closure(rng: np.random.Generator, oracle: MechanismOracle, kinds: list[str]) -> Closure:
    """Draw a closure that holds at zero coordinates."""
    links = oracle.spec.links
    first = int(rng.integers(1, len(links) + 1))
    others = [None, *(i for i in range(len(links) + 1) if i != first)]
    second = others[int(rng.integers(len(others)))]
    kind = str(rng.choice(kinds))
    options: dict[str, Any] = {"kind": kind, "link": first, "to_link": second}
    if kind in ("line", "curve"):
        options["angle"] = float(rng.uniform(-3, 3))
    if kind == "curve":
        options["shape"] = _curve(rng, links[first - 1].length)
    for name, number in (("station", first), ("to_station", second)):
        if number and decide(rng, None, 0.3):
            share = 0.0 if decide(rng, None) else float(rng.uniform(0.2, 0.8))
            options[name] = share * links[number - 1].length
    options["offset"] = tuple((rng.uniform(-0.1, 0.1, 2) * links[first - 1].length).tolist())
    closure = Closure(**options)
    return closure.replace(**closing(oracle, closure))


def _curve(rng: np.random.Generator, size: float) -> Wall | RoundWall | SurfaceTable:
    """Draw a curve through the origin with radii of curvature of about a length (m)."""
    side = float(rng.uniform(-np.pi, np.pi))
    normal, radius = np.array([np.cos(side), np.sin(side)]), size * float(rng.uniform(0.5, 2.0))
    which = int(rng.integers(5))
    if which == 0:
        return Wall(point=(0.0, 0.0), normal=normal.tolist())
    if which <= 2:
        center = tuple((radius * normal).tolist())
        return RoundWall(center=center, radius=radius, inside=which == 2)
    if which == 3:
        angle = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
        x, y = radius * np.array([np.cos(angle) - 1.0, 0.7 * np.sin(angle)])
        return SurfaceTable(x=x.tolist(), y=y.tolist(), closed=True)
    x = radius * np.linspace(-1.5, 1.5, 7)
    return SurfaceTable(x=x.tolist(), y=(0.3 * radius * np.sin(x / radius)).tolist())


def closing(
    oracle: MechanismOracle, closure: Closure, q: np.ndarray | None = None
) -> dict[str, Any]:
    """Return the second point, and the angle of a weld, with which a closure holds.

    q (dof,): coordinates; by default zeros.
    """
    first, second = oracle.points_of(closure, np.zeros(oracle.dof) if q is None else q)
    c, s = np.cos(second[2]), np.sin(second[2])
    apart = np.array([[c, s], [-s, c]]) @ (first[:2] - second[:2])
    moved = {"to_offset": tuple((np.array(closure.to_offset) + apart).tolist())}
    if closure.kind == "weld":
        moved["angle"] = float(first[2] - second[2])
    return moved


def _independent(oracle: MechanismOracle, scale: Scale) -> bool:
    """Return whether closures are independent at zero coordinates."""
    nothing = np.zeros(oracle.dof)
    units = {"pin": [1.0, 1.0], "weld": [1.0, 1.0, scale.length], "line": [1.0], "curve": [1.0]}
    lengths = np.concatenate([units[closure.kind] for closure in oracle.spec.closures])
    rows = lengths[:, None] * oracle.gap_jacobian(nothing)
    values = np.linalg.eigvalsh(rows @ np.linalg.solve(oracle.mass_matrix(nothing), rows.T))
    return bool(values[0] > INDEPENDENT * values[-1])
