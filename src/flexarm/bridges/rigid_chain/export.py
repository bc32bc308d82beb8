"""Export of arms to simulators of rigid bodies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_count
from flexarm.base.errors import InputError, Problem, public_call
from flexarm.base.writing.places import check_place, write_text
from flexarm.bridges.rigid_chain.chain import (
    Body,
    RigidChain,
    bodies,
    coordinates,
    locked,
    rigid_chain,
)

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
            _add_hinge(parent, body)
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
        _connect(root, parent, body)
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


def _add_hinge(parent: Element, body: Body) -> None:
    given = {"name": str(body.joint), "type": "hinge", "axis": "0 0 1"}
    if body.stiffness:
        given |= {"stiffness": repr(body.stiffness), "springref": repr(body.rest_angle)}
    if body.damping:
        given["damping"] = repr(body.damping)
    SubElement(parent, "joint", given)


def _connect(root: Element, parent: str, body: Body) -> None:
    kind = "fixed" if body.joint is None else "continuous"
    joint = SubElement(root, "joint", name=body.joint or f"{body.name}_weld", type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=body.name)
    SubElement(joint, "origin", xyz=f"{body.offset!r} 0 0", rpy=f"0 0 {body.angle!r}")
    if body.joint is not None:
        SubElement(joint, "axis", xyz="0 0 1")
        SubElement(joint, "dynamics", damping=repr(body.damping))


def _time_step(chain: RigidChain) -> str:
    """Return a stable time step of two digits, s."""
    frequencies = locked(chain.arm, coordinates(chain.arm, chain.driven))[0]
    longest = _REACH / float(frequencies.max()) if frequencies.size else math.inf
    return f"{min(longest, 0.002):.2g}"


def _text(root: Element) -> str:
    indent(root)
    return f'<?xml version="1.0"?>\n{tostring(root, encoding="unicode")}\n'


_SCRIPT = '''\
"""{name}: a planar arm in Exudyn.

{explained}
Run this file to print the path of the tip, or import it:

    system, tip = build(angles={angles}, torque=lambda t: {torques})
    times, x, y = run(system, tip, duration=1.0)
"""

import sys

import exudyn
import numpy as np
from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree, SensorKinematicTree

#: One row per hinge: name, position (m) and angle (rad) of its axes on the body before, mass (kg),
#: centre of mass (m), moment of inertia about it (kg m^2), stiffness (N m/rad), damping (N m s/rad)
#: and angle of rest (rad) of its spring.
HINGES = [
{rows}
]
#: Driven hinges.
DRIVEN = [k for k, row in enumerate(HINGES) if row[0].startswith("joint")]
#: Tip on the last body, m.
TIP = {tip}
GRAVITY = {gravity}  # m/s^2
STEP = {step}  # s


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def build(angles=None, torque=None):
    """Return the system and the number of the sensor of its tip.

    angles: of the driven joints at the start, rad; springs start without torque.
    torque: function of the time (s) that returns the torques of the driven joints, N m.
    """
    count = len(HINGES)
    start = np.array([row[8] for row in HINGES])
    if angles is not None:
        start[DRIVEN] = angles
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    system.variables["container"] = container  # lives as long as the system
    node = system.AddNode(
        NodeGenericODE2(
            referenceCoordinates=[0.0] * count,
            initialCoordinates=start.tolist(),
            initialCoordinates_t=[0.0] * count,
            numberOfODE2Coordinates=count,
        )
    )
    columns = list(zip(*HINGES, strict=True))
    tree = ObjectKinematicTree(
        nodeNumber=node,
        jointTypes=[exudyn.JointType.RevoluteZ] * count,
        linkParents=list(range(-1, count - 1)),
        jointTransformations=exudyn.Matrix3DList([rotation(a) for a in columns[2]]),
        jointOffsets=exudyn.Vector3DList([[*place, 0.0] for place in columns[1]]),
        linkMasses=list(columns[3]),
        linkCOMs=exudyn.Vector3DList([[*centre, 0.0] for centre in columns[4]]),
        linkInertiasCOM=exudyn.Matrix3DList([np.diag([0.0, 0.0, one]) for one in columns[5]]),
        jointPControlVector=list(columns[6]),
        jointDControlVector=list(columns[7]),
        jointPositionOffsetVector=list(columns[8]),
        jointVelocityOffsetVector=[0.0] * count,
        gravity=[*GRAVITY, 0.0],
    )
    if torque is not None:

        def forces(system, t, number, q, q_t):
            found = np.zeros(count)
            found[DRIVEN] = torque(t)
            return found.tolist()

        tree.forceUserFunction = forces
    body = system.AddObject(tree)
    sensor = system.AddSensor(
        SensorKinematicTree(
            objectNumber=body,
            linkNumber=count - 1,
            localPosition=[*TIP, 0.0],
            outputVariableType=exudyn.OutputVariableType.Position,
            storeInternal=True,
            writeToFile=False,
        )
    )
    system.Assemble()
    return system, sensor


def run(system, tip, duration, step=STEP):
    """Simulate with the classical Runge-Kutta method; return times (s) and x, y of the tip (m)."""
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.endTime = duration
    settings.timeIntegration.numberOfSteps = int(np.ceil(duration / step))
    settings.timeIntegration.verboseMode = 0
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = duration / np.ceil(duration / step)
    if not system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.RK44):
        raise RuntimeError("Exudyn failed; try a shorter step.")
    return system.GetSensorStoredData(tip)[:, :3].T


if __name__ == "__main__":
    times, x, y = run(*build(), duration=float(sys.argv[1]) if len(sys.argv) > 1 else 1.0)
    for k in np.unique(np.linspace(0, len(times) - 1, 11).astype(int)):
        print(f"{{times[k]:.4f}} s: tip at {{x[k]:.6f}} m, {{y[k]:.6f}} m")
'''


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
        own = root + complex(*body.centre) * _turned(angle)
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
        root += body.offset * _turned(angle)
        angle += body.angle
        if body.joint is not None:
            spring = body.stiffness, body.damping, body.rest_angle
            parts.append(_Part(body.joint, (root.real, root.imag), angle, spring))
            root, angle = 0j, 0.0
        if parts:  # a body welded to the base does not move
            parts[-1].add(body, root, angle)
        if body.name != "payload":
            tip = root + body.length * _turned(angle)
    if not parts:
        raise InputError(Problem("arm", "has no joint that moves and no flexible link"))
    return _SCRIPT.format(
        name=name,
        explained=_explained(chain, ""),
        angles=[0.3] * len(chain.driven),
        torques=[1.0] * len(chain.driven),
        rows="\n".join(part.row() for part in parts),
        tip=repr((tip.real, tip.imag)),
        gravity=repr(tuple(map(float, chain.arm.spec.gravity))),
        step=_time_step(chain),
    )


def _turned(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))
