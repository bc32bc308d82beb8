"""Export of arms to simulators of rigid bodies: flexible links as rigid bars on springs.

The virtual joints of a link are at the nodes of the Gauss quadrature of its flexibility
int p(x) dx / (E I), and their flexibilities are its weights. With two joints or more, this integral
is exact for the polynomials of degree 3, so the static deflection under any force and moment at the
tip of a link is exact. Frequencies converge fast with the number of joints.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from os import PathLike
from pathlib import Path
from string import Template
from typing import NamedTuple
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_count
from flexarm.base.errors import InputError, Problem, public_call, raise_any
from flexarm.base.late import linalg
from flexarm.base.writing.places import check_place, write_text
from flexarm.model import Joint, Link, ModalDamping, SectionTable
from flexarm.model.arm.spec import serial_only

#: Points of the quadrature in each interval of the table of a link.
_POINTS = 20
_UNSUPPORTED = ("friction", "limits", "rotor_inertia", "winding")


class Comparison(NamedTuple):
    """A number of the flexible arm and of its chain, with locked joints at zero angles."""

    name: str
    flexible: float
    chain: float

    @property
    def error(self) -> float:
        """Relative error of the chain."""
        return self.chain / self.flexible - 1.0


@dataclass(frozen=True, eq=False)
class RigidChain:
    """Arm of rigid links."""

    arm: Arm  # the rigid arm; the bending of links is the rotation of some of its joints
    #: For each link of the flexible arm the place of its first bar in ``arm``, from 0
    starts: tuple[int, ...]
    driven: tuple[int, ...]  # the same for its joints that are not fixed
    comparisons: tuple[Comparison, ...]  # frequencies and static flexibilities


def rigid_chain(arm: Arm, count: int) -> RigidChain:
    """Replace flexible links by rigid bars on virtual joints; InputError for friction, stops."""
    serial_only(arm.spec, "an export to simulators of rigid bodies")
    problems = [
        Problem(f"joints[{k}].{name}", "is not supported")
        for k, joint in enumerate(arm.spec.joints)
        for name in _UNSUPPORTED
        if getattr(joint, name)
    ]
    raise_any(problems)
    links: list[Link] = []
    joints: list[Joint] = []
    starts = []
    for link, joint in zip(arm.spec.links, arm.spec.joints, strict=True):
        starts.append(len(links))
        bars, springs = _bars(link, count)
        links += bars
        joints += [joint, *springs]
    spec = arm.spec.replace(links=links, joints=joints, theory="linear")
    chain = Arm(spec)
    driven = [starts[number - 1] for number in arm.joint_numbers]
    compared = _comparisons(arm, chain, driven)
    return RigidChain(chain, tuple(starts), tuple(driven), compared)


def _bars(link: Link, count: int) -> tuple[list[Link], list[Joint]]:
    """Return the bars of a link, and the virtual joints between them."""
    if not link.flexible:
        return [link], []
    beam = link.beam()
    x = np.array(beam.x, dtype=np.float64)
    places, flexibility = _quadrature(x, np.array(beam.flexural_rigidity), count)
    cuts = [0.0, *places.tolist(), link.length]
    bars = [_bar(beam, start, end) for start, end in pairwise(cuts)]
    bars[0] = bars[0].replace(hub_radius=link.hub_radius)
    springs = [Joint(stiffness=1.0 / one) for one in flexibility.tolist()]
    factor = _damping_factor(link, bars, springs)
    return bars, [Joint(stiffness=one.stiffness, damping=factor * one.stiffness) for one in springs]


def _bar(beam: SectionTable, start: float, end: float) -> Link:
    """Return the rigid part of a beam from ``start`` to ``end``, m from its root."""
    inner = [one for one in beam.x if start < one < end]
    x = np.array([start, *inner, end])
    mass = np.interp(x, beam.x, beam.mass_per_length)
    inertia = np.interp(x, beam.x, beam.rotary_inertia_per_length or np.zeros(len(beam.x)))
    table = SectionTable(
        x=(x - start).tolist(),
        mass_per_length=mass.tolist(),
        rotary_inertia_per_length=inertia.tolist(),
    )
    return Link(length=end - start, table=table, flexible=False)


def _quadrature(x: FloatArray, rigidity: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights of the Gauss quadrature with the weight function 1 / (E I)."""
    # Golub and Welsch: eigenvalues of the matrix of the recurrence of orthogonal polynomials, which
    # is computed with the weight function at many points (Stieltjes).
    points, shares = np.polynomial.legendre.leggauss(_POINTS)
    half = 0.5 * np.diff(x)[:, None]
    at = (x[:-1, None] + half * (1.0 + points)).ravel()
    weight = (half * shares).ravel() / np.interp(at, x, rigidity)
    diagonal, beside = np.zeros(count), np.zeros(count)
    before, now = np.zeros_like(at), np.full_like(at, weight.sum() ** -0.5)
    for k in range(count):
        diagonal[k] = weight @ (at * now**2)
        new = (at - diagonal[k]) * now - (beside[k - 1] * before if k else 0.0)
        beside[k] = np.sqrt(weight @ new**2)
        before, now = now, new / beside[k]
    places, vectors = linalg.eigh_tridiagonal(diagonal, beside[:-1])
    return places, vectors[0] ** 2 * weight.sum()


def _damping_factor(link: Link, bars: list[Link], springs: list[Joint]) -> float:
    """Return the damping of springs over stiffness (s): that of the first mode stays."""
    damping = link.damping
    if damping is None:
        return 0.0
    if not isinstance(damping, ModalDamping):
        return damping.stiffness_coefficient
    alone = Arm(links=bars, joints=[Joint(fixed=True), *springs])
    return 2.0 * damping.ratios(1)[0] / float(locked(alone, [])[0][0])


def locked(arm: Arm, driven: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return frequencies (rad/s) and tip flexibility (3, 3) with locked joints, without gravity."""
    still = Arm(arm.spec.replace(gravity=(0.0, 0.0)))
    rest = np.zeros(arm.dof)
    moving = np.setdiff1d(np.arange(arm.dof), driven)
    kept = np.ix_(moving, moving)
    K, M = still.stiffness_matrix(rest)[kept], still.mass_matrix(rest)[kept]
    tip = np.array([still.tip_velocity(rest, unit) for unit in np.eye(arm.dof)[moving]])
    return np.sqrt(linalg.eigh(K, M)[0]), tip.T @ np.linalg.solve(K, tip)


def coordinates(chain: Arm, driven: Sequence[int]) -> list[int]:
    """Return the places in q of the joints at the roots of some bars."""
    numbers = list(chain.joint_numbers)
    return [int(chain.joint_index[numbers.index(place + 1)]) for place in driven]


def _comparisons(arm: Arm, chain: Arm, driven: list[int]) -> tuple[Comparison, ...]:
    if arm.dof == arm.n_joints:
        return ()
    exact, bars = locked(arm, arm.joint_index.tolist()), locked(chain, coordinates(chain, driven))
    rows = [
        Comparison("tip deflection per force, m/N", exact[1][1, 1], bars[1][1, 1]),
        Comparison("tip rotation per moment, rad/(N m)", exact[1][2, 2], bars[1][2, 2]),
    ]
    for k, pair in enumerate(zip(exact[0][:4], bars[0][:4], strict=False), 1):
        rows.append(Comparison(f"frequency {k}, Hz", *(one / (2.0 * np.pi) for one in pair)))
    return tuple(Comparison(row.name, float(row.flexible), float(row.chain)) for row in rows)


class Body(NamedTuple):
    """A rigid body on a hinge, or welded to the body before. SI units.

    Body axes: origin at the hinge, x along the bar. Inertia is about the centre of mass.
    """

    name: str
    offset: float  # of the hinge along the x axis of the body before
    angle: float  # of a welded body, rad
    length: float
    mass: float
    centre: tuple[float, float]
    inertia: float
    joint: str | None  # name of the hinge; None if it is welded
    stiffness: float
    damping: float
    rest_angle: float


def bodies(chain: RigidChain) -> list[Body]:
    """Return bars, then a payload with an offset; InputError for a body without mass or inertia."""
    arm, constants = chain.arm, chain.arm.assembly.constants
    numbers = {place: number for number, place in enumerate(chain.driven, 1)}
    link, bar, chain_bodies, offset = 0, 0, [], 0.0
    for i in range(arm.assembly.bodies):
        length, tip = float(constants.length[i]), float(constants.tip_mass[i])
        mass = float(constants.mass[i]) + tip
        x = (float(constants.first_moment_x[i]) + tip * length) / mass if mass else 0.0
        y = float(constants.first_moment_y[i]) / mass if mass else 0.0
        about_hinge = float(constants.inertia[i] + constants.tip_inertia[i]) + tip * length**2
        is_bar = i < arm.n_links
        free = bool(constants.free[i]) and is_bar
        if i in chain.starts:
            link, bar = link + 1, 0
        bar += 1
        name = f"link{link}_{bar}" if is_bar else "payload"
        joint = f"joint{numbers[i]}" if i in numbers else f"bending{link}_{bar - 1}"
        chain_bodies.append(
            Body(
                name,
                offset,
                0.0 if free else float(constants.joint_angle[i]),
                length,
                mass,
                (x, y),
                about_hinge - mass * (x * x + y * y),
                joint if free else None,
                float(constants.joint_stiffness[i]),
                float(constants.joint_damping[i]),
                float(constants.joint_rest[i]),
            )
        )
        offset = length
    problems = [
        Problem("arm", f"has no mass or no inertia in {body.name}")
        for body in chain_bodies
        if body.mass <= 0.0 or body.inertia <= 0.0
    ]
    raise_any(problems)
    return chain_bodies


#: Largest number of virtual joints of a link.
_MOST = 64


@public_call
def export_mjcf(arm: Arm, path: str | PathLike[str], *, virtual_joints: int = 4) -> Path:
    """Write an arm as a model of MuJoCo (MJCF).

    Every flexible link becomes rigid bars on virtual joints with springs. Static deflections under
    forces and moments at the tip are exact for links without shear; the file contains the errors of
    the first frequencies. Driven joints have motors and sensors.

    Args:
        arm: the arm.
        path: the file, ``.xml``.
        virtual_joints: number of virtual joints of each flexible link, at least 2.

    Returns:
        The file.

    Raises:
        InputError: if a joint has friction, limits or a rotor, a part has no mass, or the file
            cannot be written.
    """
    return _export(arm, path, virtual_joints, ".xml", _mjcf)


@public_call
def export_urdf(arm: Arm, path: str | PathLike[str], *, virtual_joints: int = 4) -> Path:
    """Write an arm as a robot in URDF.

    The bars and joints are those of ``export_mjcf``. URDF has no springs: their stiffness is in
    elements for Gazebo, and other programs must be given it.

    Args:
        arm, virtual_joints: as in ``export_mjcf``.
        path: the file, ``.urdf``.

    Returns:
        The file.

    Raises:
        InputError: as in ``export_mjcf``.
    """
    return _export(arm, path, virtual_joints, ".urdf", _urdf)


@public_call
def export_exudyn(arm: Arm, path: str | PathLike[str], *, virtual_joints: int = 4) -> Path:
    """Write an arm as a Python script that builds and simulates it in Exudyn.

    The bars and joints are those of ``export_mjcf``, as one kinematic tree. The functions ``build``
    and ``run`` of the script accept joint angles at the start, torques over time and a duration.

    Args:
        arm, virtual_joints: as in ``export_mjcf``.
        path: the file, ``.py``.

    Returns:
        The file.

    Raises:
        InputError: as in ``export_mjcf``, or if no joint moves.
    """
    return _export(arm, path, virtual_joints, ".py", _exudyn_script)


def _export(
    arm: Arm,
    path: str | PathLike[str],
    virtual_joints: int,
    suffix: str,
    text_of: Callable[[RigidChain, list[Body], str], str],
) -> Path:
    count = check_count("virtual_joints", virtual_joints, 2, _MOST)
    chain = rigid_chain(arm, count)
    parts = bodies(chain)
    place = check_place("path", path, (suffix,))
    write_text(text_of(chain, parts, place.stem), place)
    return place


#: Time step of MJCF files times the largest frequency with locked joints, rad/s; the classical
#: Runge-Kutta method is unstable from 2.8 on.
_REACH = 1.0
#: Radius (m) of the drawn bars, relative to the reach.
_RADIUS = 0.01


def _mjcf(chain: RigidChain, masses: list[Body], name: str) -> str:
    """Return a model of MuJoCo: hinges with springs, motors, sensors of joints and tip."""
    root = Element("mujoco", model=name)
    root.append(Comment(_explained(chain, "")))
    SubElement(root, "compiler", angle="radian")
    gravity = " ".join(map(repr, (*map(float, chain.arm.spec.gravity), 0.0)))
    option = SubElement(
        root, "option", gravity=gravity, integrator="RK4", timestep=_time_step(chain)
    )
    SubElement(option, "flag", contact="disable")
    parent = SubElement(root, "worldbody")
    actuators, sensors = SubElement(root, "actuator"), SubElement(root, "sensor")
    radius = repr(_RADIUS * float(np.sum(chain.arm.lengths)))
    tip = [body for body in masses if body.name != "payload"][-1]
    for body in masses:
        parent = SubElement(parent, "body", name=body.name, pos=f"{body.offset!r} 0 0")
        if body.joint is None:
            parent.set("euler", f"0 0 {body.angle!r}")
        else:
            attributes = {"name": str(body.joint), "type": "hinge", "axis": "0 0 1"}
            if body.stiffness:
                attributes |= {
                    "stiffness": repr(body.stiffness),
                    "springref": repr(body.rest_angle),
                }
            if body.damping:
                attributes["damping"] = repr(body.damping)
            SubElement(parent, "joint", attributes)
            if body.joint.startswith("joint"):
                SubElement(actuators, "motor", name=body.joint, joint=body.joint)
                SubElement(sensors, "jointpos", name=f"{body.joint}_angle", joint=body.joint)
                SubElement(sensors, "jointvel", name=f"{body.joint}_rate", joint=body.joint)
        x, y = body.centre
        inertia = " ".join([repr(body.inertia)] * 3)
        SubElement(
            parent, "inertial", pos=f"{x!r} {y!r} 0", mass=repr(body.mass), diaginertia=inertia
        )
        if body.name != "payload":
            ends = f"0 0 0 {body.length!r} 0 0"
            SubElement(parent, "geom", type="capsule", fromto=ends, size=radius, mass="0")
        if body is tip:
            SubElement(parent, "site", name="tip", pos=f"{body.length!r} 0 0")
    SubElement(sensors, "framepos", name="tip", objtype="site", objname="tip")
    return _text(root)


def _urdf(chain: RigidChain, masses: list[Body], name: str) -> str:
    """Return a robot in URDF; springs are tags for Gazebo, because URDF itself has none."""
    root = Element("robot", name=name)
    root.append(Comment(_explained(chain, _URDF)))
    SubElement(root, "link", name="base")
    parent = "base"
    for body in masses:
        link = SubElement(root, "link", name=body.name)
        inertial = SubElement(link, "inertial")
        SubElement(inertial, "origin", xyz="{!r} {!r} 0".format(*body.centre), rpy="0 0 0")
        SubElement(inertial, "mass", value=repr(body.mass))
        values = dict.fromkeys(("ixx", "iyy", "izz"), repr(body.inertia))
        SubElement(inertial, "inertia", values | dict.fromkeys(("ixy", "ixz", "iyz"), "0"))
        kind = "fixed" if body.joint is None else "continuous"
        connection = SubElement(root, "joint", name=body.joint or f"{body.name}_weld", type=kind)
        SubElement(connection, "parent", link=parent)
        SubElement(connection, "child", link=body.name)
        SubElement(connection, "origin", xyz=f"{body.offset!r} 0 0", rpy=f"0 0 {body.angle!r}")
        if body.joint is not None:
            SubElement(connection, "axis", xyz="0 0 1")
            SubElement(connection, "dynamics", damping=repr(body.damping))
        parent = body.name
    tip = [body for body in masses if body.name != "payload"][-1]
    SubElement(root, "link", name="tip")
    joint = SubElement(root, "joint", name="at_tip", type="fixed")
    SubElement(joint, "parent", link=tip.name)
    SubElement(joint, "child", link="tip")
    SubElement(joint, "origin", xyz=f"{tip.length!r} 0 0", rpy="0 0 0")
    for body in masses:
        if body.joint is not None and body.stiffness:
            tag = SubElement(root, "gazebo", reference=body.joint)
            SubElement(tag, "springStiffness").text = repr(body.stiffness)
            SubElement(tag, "springReference").text = repr(body.rest_angle)
    return _text(root)


_URDF = """
    URDF has no springs: the elements gazebo contain them, and other programs must be given them.
    URDF has no gravity: the program sets it."""


def _explained(chain: RigidChain, more: str) -> str:
    """Return the text in front of a file, with the errors of the chain."""
    table = [f"    {'locked joints, zero angles':<34} {'flexible':>12} {'this file':>12}"]
    for row in chain.comparisons:
        percent = round(100.0 * row.error, 4) + 0.0  # rounding has no sign
        numbers = f"{row.flexible:>12.6g} {row.chain:>12.6g} {percent:>+9.4f} %"
        table.append(f"    {row.name:<34} {numbers}")
    lines = [
        " Generated by flexarm. Planar arm, rotations about z. SI units.",
        "    Hinges joint1, joint2, ... are driven; hinges bending... are springs that replace the",
        "    bending of the links.",
        *(table if chain.comparisons else []),
    ]
    return "\n".join(lines) + more + "\n"


def _time_step(chain: RigidChain) -> str:
    """Return a stable time step of two digits, s."""
    frequencies = locked(chain.arm, coordinates(chain.arm, chain.driven))[0]
    longest = _REACH / float(frequencies.max()) if frequencies.size else math.inf
    return f"{min(longest, 0.002):.2g}"


def _text(root: Element) -> str:
    indent(root)
    return f'<?xml version="1.0"?>\n{tostring(root, encoding="unicode")}\n'


@dataclass
class _Part:
    """A hinge with the rigid body on it, to which welded ones are added.

    Axes are those of the hinge; ``place`` and ``angle`` are its axes in those of the part before.
    """

    name: str
    place: tuple[float, float]
    angle: float
    spring: tuple[float, float, float]
    mass: float = 0.0
    centre: complex = 0j
    inertia: float = 0.0

    def add(self, body: Body, root: complex, angle: float) -> None:
        """Add a body whose axes are at ``root`` with an angle, in those of this hinge."""
        mass = self.mass + body.mass
        own = root + complex(*body.centre) * cmath.rect(1.0, angle)
        centre = (self.mass * self.centre + body.mass * own) / mass
        self.inertia += body.inertia + self.mass * abs(self.centre - centre) ** 2
        self.inertia += body.mass * abs(own - centre) ** 2
        self.mass, self.centre = mass, centre

    def row(self) -> str:
        """Return the line of the script."""
        centre = (self.centre.real, self.centre.imag)
        numbers = self.place, self.angle, self.mass, centre, self.inertia, *self.spring
        return f'    ("{self.name}", {", ".join(map(repr, numbers))}),'


def _exudyn_script(chain: RigidChain, masses: list[Body], name: str) -> str:
    """Return a script that builds the chain in Exudyn; welded bodies are part of those before."""
    parts: list[_Part] = []
    root, angle, tip = 0j, 0.0, 0j  # axes of the last body, in those of its hinge
    for body in masses:
        root += body.offset * cmath.rect(1.0, angle)
        angle += body.angle
        if body.joint is not None:
            spring = body.stiffness, body.damping, body.rest_angle
            parts.append(_Part(body.joint, (root.real, root.imag), angle, spring))
            root, angle = 0j, 0.0
        if parts:  # a body welded to the base does not move
            parts[-1].add(body, root, angle)
        if body.name != "payload":
            tip = root + body.length * cmath.rect(1.0, angle)
    if not parts:
        raise InputError(Problem("arm", "has no joint that moves and no flexible link"))
    script = files("flexarm.bridges.rigid_chain") / "exudyn_script.txt"
    return Template(script.read_text(encoding="utf-8")).substitute(
        name=name,
        explained=_explained(chain, ""),
        angles=[0.3] * len(chain.driven),
        torques=[1.0] * len(chain.driven),
        rows="\n".join(part.row() for part in parts),
        tip=repr((tip.real, tip.imag)),
        gravity=repr(tuple(map(float, chain.arm.spec.gravity))),
        step=_time_step(chain),
    )
