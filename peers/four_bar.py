"""A flexible four-bar under gravity in Exudyn, the counterpart of ``benchmarks.closed_loop``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import exudyn
import exudyn.itemInterface as items
import numpy as np


@dataclass(frozen=True)
class FourBar:
    """Crank, coupler and rocker of one section on the ground, pinned to each other. SI units.

    angles (3,): of crank, coupler and rocker from world x at the start; rates (3,): of these.
    """

    lengths: tuple[float, float, float]
    ground: float
    flexural_rigidity: float
    axial_rigidity: float
    mass_per_length: float
    gravity: float
    angles: tuple[float, float, float]
    rates: tuple[float, float, float]
    duration: float
    rate: int  # samples per second, Hz


def prepare(case: FourBar, elements: int, step: float) -> Callable[[], np.ndarray]:
    """Build the model; return what integrates it, once, and gives the path of the tip of the
    rocker, (samples, 2) m.

    Each link has ``elements`` cable elements in absolute nodal coordinates. Generalised alpha
    method, fixed steps of ``step`` s.
    """
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(items.ObjectGround())
    start, speed = np.zeros(2), np.zeros(2)
    ends: list[tuple[int, int]] = []
    for k, (length, angle, turn) in enumerate(
        zip(case.lengths, case.angles, case.rates, strict=True)
    ):
        if k == 2:
            start, speed = np.array([case.ground, 0.0]), np.zeros(2)
        along = np.array([np.cos(angle), np.sin(angle)])
        across = turn * np.array([-along[1], along[0]])
        nodes = [
            system.AddNode(
                items.NodePoint2DSlope1(
                    referenceCoordinates=[*(start + s * length * along), *along],
                    initialVelocities=[*(speed + s * length * across), *across],
                )
            )
            for s in np.arange(elements + 1) / elements
        ]
        for pair in pairwise(nodes):
            cable = items.ObjectANCFCable2D(
                length=length / elements,
                massPerLength=case.mass_per_length,
                bendingStiffness=case.flexural_rigidity,
                axialStiffness=case.axial_rigidity,
                nodeNumbers=list(pair),
            )
            body = system.AddObject(cable)
            mass = system.AddMarker(items.MarkerBodyMass(bodyNumber=body))
            system.AddLoad(
                items.LoadMassProportional(markerNumber=mass, loadVector=[0.0, -case.gravity, 0.0])
            )
        ends.append((nodes[0], nodes[-1]))
        start, speed = start + length * along, speed + length * across
    markers = {
        node: system.AddMarker(items.MarkerNodePosition(nodeNumber=node))
        for pair in ends
        for node in pair
    }
    feet = [
        system.AddMarker(
            items.MarkerBodyPosition(bodyNumber=ground, localPosition=[place, 0.0, 0.0])
        )
        for place in (0.0, case.ground)
    ]
    pairs = [
        (feet[0], markers[ends[0][0]]),
        (markers[ends[0][1]], markers[ends[1][0]]),
        (feet[1], markers[ends[2][0]]),
        (markers[ends[1][1]], markers[ends[2][1]]),
    ]
    for pair in pairs:
        system.AddObject(items.ObjectJointRevolute2D(markerNumbers=list(pair)))
    sensor = system.AddSensor(
        items.SensorNode(
            nodeNumber=ends[2][1],
            outputVariableType=exudyn.OutputVariableType.Position,
            writeToFile=False,
            storeInternal=True,
        )
    )
    system.Assemble()
    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 1.0 / case.rate
    time = settings.timeIntegration
    time.endTime = case.duration
    time.numberOfSteps = round(case.duration / step)
    time.adaptiveStep = False
    time.newton.relativeTolerance = time.newton.absoluteTolerance = 1e-6
    settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse

    def run() -> np.ndarray:
        if not system.SolveDynamic(settings):
            raise RuntimeError(f"Exudyn failed with {elements} elements and step {step} s.")
        return np.array(system.GetSensorStoredData(sensor)[:, 1:3])

    return run
