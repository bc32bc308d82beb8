"""A case in Exudyn: beam elements in absolute coordinates, joined by constraints."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import exudyn
import exudyn.itemInterface as items
import numpy as np
from exudyn.advancedUtilities import CreateSymbolicUserFunction

from peers.arms import TORQUE_ENDS, Case, steps_per_sample
from peers.closed_chain import ClosedChain

#: Shear rigidity over axial rigidity: of a solid rod of metal, about.
_SHEAR = 0.4


def tip(case: Case, elements: int, step: float, exact: bool = False) -> np.ndarray:
    """Return the tip's path (samples, 2), m; see ``prepare``."""
    return prepare(case, elements, step, exact)()


def prepare(
    case: Case, elements: int, step: float, exact: bool = False
) -> Callable[[], np.ndarray]:
    """Build the model; return what integrates it, once, and gives the tip's path (samples, 2), m.

    Each link has ``elements`` cable elements of Bernoulli and Euler in absolute nodal coordinates
    or, with ``exact``, geometrically exact ones of three nodes: bending of any size, and a little
    stretch and shear. Generalised alpha method, fixed steps of ``step`` s.
    It raises ``RuntimeError`` where Newton's method failed at a step.
    """
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(items.ObjectGround())
    inboard = system.AddMarker(items.MarkerBodyPosition(bodyNumber=ground))
    reaction = None  # the ground takes the first motor's
    kept: list[object] = []
    position = np.zeros(2)
    for number, (length, angle) in enumerate(zip(case.lengths, case.start, strict=True)):
        axis = np.array([math.cos(angle), math.sin(angle)])
        add_link = _add_exact_link if exact else _add_cables
        nodes, sections = add_link(system, case, position, length * axis, elements)
        root = system.AddMarker(items.MarkerNodePosition(nodeNumber=nodes[0]))
        system.AddObject(items.ObjectJointRevolute2D(markerNumbers=[inboard, root]))
        inboard = system.AddMarker(items.MarkerNodePosition(nodeNumber=nodes[-1]))
        _add_torque(system, sections[0], case.amplitude[number], kept)
        if reaction is not None:
            _add_torque(system, reaction, -case.amplitude[number], kept)
        reaction = sections[1]
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
    settings = _settings(case, step)

    def run() -> np.ndarray:
        # Exudyn holds no reference to what its loads evaluate.
        assert kept or not any(case.amplitude)
        if not system.SolveDynamic(settings):
            raise RuntimeError(f"Exudyn failed with {elements} elements and step {step} s.")
        stored = system.GetSensorStoredData(sensor)
        times = np.arange(case.samples) / case.rate
        if stored.shape[0] != case.samples or not np.allclose(stored[:, 0], times, atol=1e-9):
            raise RuntimeError(f"Exudyn did not keep to steps of {step} s.")
        return np.array(stored[:, 1:3])

    return run


def _add_cables(
    system: exudyn.MainSystem, case: Case, root: np.ndarray, vector: np.ndarray, elements: int
) -> tuple[list[int], list[int]]:
    """Add a straight link from ``root`` along ``vector``; return nodes and markers of its ends."""
    length = float(np.linalg.norm(vector))
    slope = vector / length
    nodes = [
        system.AddNode(
            items.NodePoint2DSlope1(referenceCoordinates=[*(root + share * vector), *slope])
        )
        for share in np.arange(elements + 1) / elements
    ]
    cables = [add_cable(system, case, length / elements, pair) for pair in pairwise(nodes)]
    ends = (cables[0], 0.0), (cables[-1], length / elements)
    sections = [
        system.AddMarker(items.MarkerBodyRigid(bodyNumber=cable, localPosition=[station, 0.0, 0.0]))
        for cable, station in ends
    ]
    return nodes, sections


def _add_exact_link(
    system: exudyn.MainSystem, case: Case, root: np.ndarray, vector: np.ndarray, elements: int
) -> tuple[list[int], list[int]]:
    """The same of geometrically exact elements, whose ends and middles are nodes with an angle."""
    length, angle = float(np.linalg.norm(vector)), math.atan2(vector[1], vector[0])
    nodes = [
        system.AddNode(
            items.NodeRigidBody2D(referenceCoordinates=[*(root + share * vector), angle])
        )
        for share in np.arange(2 * elements + 1) / (2 * elements)
    ]
    radius_of_gyration = math.sqrt(case.flexural_rigidity / case.axial_rigidity)
    for k in range(elements):
        beam = items.ObjectBeamGeometricallyExact2D(
            nodeNumbers=nodes[2 * k : 2 * k + 3],
            length=length / elements,
            massPerLength=case.mass_per_length,
            # Cross-sections of the others have none; zero would leave rotations without mass.
            crossSectionInertia=1e-3 * case.mass_per_length * radius_of_gyration**2,
            bendingStiffness=case.flexural_rigidity,
            axialStiffness=case.axial_rigidity,
            shearStiffness=_SHEAR * case.axial_rigidity,
            includeReferenceRotations=True,
        )
        _add_heavy(system, case, beam)
    ends = nodes[0], nodes[-1]
    return nodes, [system.AddMarker(items.MarkerNodeRigid(nodeNumber=node)) for node in ends]


def add_cable(
    system: exudyn.MainSystem, case: Case | ClosedChain, length: float, ends: tuple[int, int]
) -> int:
    """Add a cable element with its weight between two nodes."""
    cable = items.ObjectANCFCable2D(
        length=length,
        massPerLength=case.mass_per_length,
        bendingStiffness=case.flexural_rigidity,
        axialStiffness=case.axial_rigidity,
        nodeNumbers=list(ends),
    )
    return _add_heavy(system, case, cable)


def _add_heavy(system: exudyn.MainSystem, case: Case | ClosedChain, beam: object) -> int:
    """Add an element with its weight."""
    number: int = system.AddObject(beam)
    mass = system.AddMarker(items.MarkerBodyMass(bodyNumber=number))
    system.AddLoad(
        items.LoadMassProportional(markerNumber=mass, loadVector=[0.0, -case.gravity, 0.0])
    )
    return number


def _add_torque(
    system: exudyn.MainSystem, section: int, amplitude: float, kept: list[object]
) -> None:
    """Let a motor act on a cross-section, given by its marker.

    Written in Exudyn's own symbols, which it evaluates without calling Python. ``kept`` receives
    what must live as long as the system.
    """
    if amplitude == 0.0:
        return
    symbols = exudyn.symbolic

    def torque(system: object, t: object, vector: object) -> list[object]:
        wave = amplitude * symbols.sin(2.0 * math.pi * t)
        return [0.0, 0.0, symbols.IfThenElse(t <= TORQUE_ENDS, wave, symbols.Real(0.0))]

    function = CreateSymbolicUserFunction(
        system, torque, "loadVectorUserFunction", itemTypeName="LoadTorqueVector"
    )
    kept.append(function)
    system.AddLoad(items.LoadTorqueVector(markerNumber=section, loadVectorUserFunction=function))


def _settings(case: Case, step: float) -> exudyn.SimulationSettings:
    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 1.0 / case.rate
    time = settings.timeIntegration
    time.endTime = case.duration
    time.numberOfSteps = (case.samples - 1) * steps_per_sample(case, step)
    # A step that fails must fail aloud: by default it is cut in two, and again, without a word.
    time.adaptiveStep = False
    # Rounding of the large axial forces keeps the residual from falling to the default of 1e-10.
    time.newton.relativeTolerance = 1e-6
    time.newton.absoluteTolerance = 1e-6
    settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
    return settings
