"""A case in Exudyn: cable elements in absolute coordinates, joined by constraints."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import exudyn
import exudyn.itemInterface as items
import numpy as np

from peers.arms import RATE, Case, steps_per_sample


def tip(case: Case, elements: int, step: float) -> np.ndarray:
    """Return the tip's path (samples, 2), m.

    Each link has ``elements`` cable elements of Bernoulli and Euler in absolute nodal coordinates:
    bending of any size, and a little stretch. Generalised alpha method, fixed steps of ``step`` s.

    Raises:
        RuntimeError: Newton's method failed at a step.
    """
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(items.ObjectGround())
    inboard = system.AddMarker(items.MarkerBodyPosition(bodyNumber=ground))
    reaction = None  # the ground takes the first motor's
    position = np.zeros(2)
    for number, (length, angle) in enumerate(zip(case.lengths, case.start, strict=True)):
        axis = np.array([math.cos(angle), math.sin(angle)])
        nodes, cables = _add_link(system, case, position, length * axis, elements)
        root = system.AddMarker(items.MarkerNodePosition(nodeNumber=nodes[0]))
        system.AddObject(items.ObjectJointRevolute2D(markerNumbers=[inboard, root]))
        inboard = system.AddMarker(items.MarkerNodePosition(nodeNumber=nodes[-1]))
        _add_torque(system, cables[0], 0.0, _component(case, number, 1.0))
        if reaction is not None:
            _add_torque(system, *reaction, _component(case, number, -1.0))
        reaction = cables[-1], length / elements
        position = position + length * axis
    sensor = system.AddSensor(
        items.SensorNode(
            nodeNumber=nodes[-1],
            outputVariableType=exudyn.OutputVariableType.Position,
            writeToFile=False,
            storeInternal=True,
        )
    )
    system.Assemble()
    if not system.SolveDynamic(_settings(case, step)):
        raise RuntimeError(f"Exudyn failed with {elements} elements and step {step} s.")
    stored = system.GetSensorStoredData(sensor)
    times = np.arange(case.samples) / RATE
    if stored.shape[0] != case.samples or not np.allclose(stored[:, 0], times, atol=1e-9):
        raise RuntimeError(f"Exudyn did not keep to steps of {step} s.")
    return np.array(stored[:, 1:3])


def _add_link(
    system: exudyn.MainSystem, case: Case, root: np.ndarray, vector: np.ndarray, elements: int
) -> tuple[list[int], list[int]]:
    """Add a straight link from ``root`` along ``vector``; return its nodes and its elements."""
    length = float(np.linalg.norm(vector))
    slope = vector / length
    nodes = [
        system.AddNode(
            items.NodePoint2DSlope1(referenceCoordinates=[*(root + share * vector), *slope])
        )
        for share in np.arange(elements + 1) / elements
    ]
    cables = []
    for pair in pairwise(nodes):
        cable = system.AddObject(
            items.ObjectANCFCable2D(
                length=length / elements,
                massPerLength=case.mass_per_length,
                bendingStiffness=case.flexural_rigidity,
                axialStiffness=case.axial_rigidity,
                nodeNumbers=list(pair),
            )
        )
        cables.append(cable)
        mass = system.AddMarker(items.MarkerBodyMass(bodyNumber=cable))
        system.AddLoad(
            items.LoadMassProportional(markerNumber=mass, loadVector=[0.0, -case.gravity, 0.0])
        )
    return nodes, cables


def _component(case: Case, joint: int, sign: float) -> Callable[[float], float]:
    return lambda t: sign * case.torque(t)[joint]


def _add_torque(
    system: exudyn.MainSystem, cable: int, station: float, torque: Callable[[float], float]
) -> None:
    """Let a torque act on the cross-section of an element at a distance from its root."""
    section = system.AddMarker(
        items.MarkerBodyRigid(bodyNumber=cable, localPosition=[station, 0.0, 0.0])
    )
    system.AddLoad(
        items.LoadTorqueVector(
            markerNumber=section,
            loadVectorUserFunction=lambda system, t, vector: [0.0, 0.0, torque(t)],
        )
    )


def _settings(case: Case, step: float) -> exudyn.SimulationSettings:
    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 1.0 / RATE
    time = settings.timeIntegration
    time.endTime = case.duration
    time.numberOfSteps = (case.samples - 1) * steps_per_sample(step)
    # A step that fails must fail aloud: by default it is cut in two, and again, without a word.
    time.adaptiveStep = False
    # Rounding of the large axial forces keeps the residual from falling to the default of 1e-10.
    time.newton.relativeTolerance = 1e-6
    time.newton.absoluteTolerance = 1e-6
    settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
    return settings
