"""Chains of rigid bodies as a Python script for Exudyn: one kinematic tree."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flexarm.base.errors import InputError, Problem
from flexarm.bridges.rigid_chain.bodies import Body
from flexarm.bridges.rigid_chain.chain import RigidChain
from flexarm.bridges.rigid_chain.files import explained, time_step

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


def exudyn_script(chain: RigidChain, found: list[Body], name: str) -> str:
    """Return a script that builds the chain in Exudyn; welded bodies are part of those before.

    Raises:
        InputError: if nothing moves.
    """
    parts: list[_Part] = []
    root, angle, tip = 0j, 0.0, 0j  # axes of the last body, in those of its hinge
    for body in found:
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
        explained=explained(chain, ""),
        angles=[0.3] * len(chain.driven),
        torques=[1.0] * len(chain.driven),
        rows="\n".join(part.row() for part in parts),
        tip=repr((tip.real, tip.imag)),
        gravity=repr(tuple(map(float, chain.arm.spec.gravity))),
        step=time_step(chain),
    )


def _turned(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))
