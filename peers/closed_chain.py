"""Closed chains of flexible bars under gravity, in flexarm and in Exudyn.

`python -m peers.closed_chain` prints the reference values of the gallery.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

import flexarm as fa
from flexarm.arm.closed import AssembledState


@dataclass(frozen=True)
class Bar:
    """A uniform bar. SI units."""

    length: float
    angle: float = 0.0  # from world x at the start
    rate: float = 0.0  # of this angle


@dataclass(frozen=True)
class ClosedChain:
    """Two chains of bars of one section from pins in the ground, whose ends are pinned together."""

    left: tuple[Bar, ...]  # from the origin
    right: tuple[Bar, ...]  # from (ground, 0)
    ground: float
    flexural_rigidity: float
    duration: float
    axial_rigidity: float = 1.3e7  # of a slender steel rod of this mass, N
    mass_per_length: float = 0.5
    gravity: float = 9.81
    rate: int = 8  # samples per second, Hz


def prepare(case: ClosedChain, elements: int, step: float) -> Callable[[], np.ndarray]:
    """Build the model; return what integrates it, once, and gives the path of the end of the right
    chain, (samples, 2) m.

    Each bar has ``elements`` cable elements in absolute nodal coordinates. Generalised alpha
    method, fixed steps of ``step`` s.
    """
    import exudyn
    import exudyn.itemInterface as items

    container = exudyn.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(items.ObjectGround())
    ends = []
    for foot, bars in ((0.0, case.left), (case.ground, case.right)):
        place, speed = np.array([foot, 0.0]), np.zeros(2)
        marker = system.AddMarker(
            items.MarkerBodyPosition(bodyNumber=ground, localPosition=[foot, 0.0, 0.0])
        )
        for bar in bars:
            along = np.array([np.cos(bar.angle), np.sin(bar.angle)])
            across = bar.rate * np.array([-along[1], along[0]])
            nodes = _bar(system, case, bar.length, elements, (place, along), (speed, across))
            first, last = (
                system.AddMarker(items.MarkerNodePosition(nodeNumber=nodes[k])) for k in (0, -1)
            )
            system.AddObject(items.ObjectJointRevolute2D(markerNumbers=[marker, first]))
            place, speed = place + bar.length * along, speed + bar.length * across
            marker, node = last, nodes[-1]
        ends.append((marker, node))
    system.AddObject(items.ObjectJointRevolute2D(markerNumbers=[marker for marker, _ in ends]))
    sensor = system.AddSensor(
        items.SensorNode(
            nodeNumber=ends[1][1],
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


def _bar(system, case, length, elements, straight, motion) -> list[int]:  # type: ignore[no-untyped-def]
    """Add a bar from its start and direction, with its velocity; return its nodes."""
    import exudyn.itemInterface as items

    from peers.exudyn_arm import add_cable

    (place, along), (speed, across) = straight, motion
    nodes = [
        system.AddNode(
            items.NodePoint2DSlope1(
                referenceCoordinates=[*(place + s * length * along), *along],
                initialVelocities=[*(speed + s * length * across), *across],
            )
        )
        for s in np.arange(elements + 1) / elements
    ]
    for pair in pairwise(nodes):
        add_cable(system, case, length / elements, pair)
    return nodes


def closed(case: ClosedChain) -> ClosedChain:
    """Return the case with the angles and rates of both last bars at which their ends meet.

    The first of two meeting points is taken, to the left of the line from the start of the left
    bar to that of the right one.
    """
    starts, speeds = [], []
    for foot, bars in ((0.0, case.left[:-1]), (case.ground, case.right[:-1])):
        place, speed = np.array([foot, 0.0]), np.zeros(2)
        for bar in bars:
            along = np.array([np.cos(bar.angle), np.sin(bar.angle)])
            place = place + bar.length * along
            speed = speed + bar.length * bar.rate * np.array([-along[1], along[0]])
        starts.append(place)
        speeds.append(speed)
    lengths = case.left[-1].length, case.right[-1].length
    apart = starts[1] - starts[0]
    far = float(np.linalg.norm(apart))
    share = (far**2 + lengths[0] ** 2 - lengths[1] ** 2) / (2.0 * far)
    along = apart / far
    height = np.sqrt(lengths[0] ** 2 - share**2)
    meeting = starts[0] + share * along + height * np.array([-along[1], along[0]])
    arms = [meeting - start for start in starts]
    turns = [np.array([-arm[1], arm[0]]) for arm in arms]
    rates = np.linalg.solve(np.column_stack([turns[0], -turns[1]]), speeds[1] - speeds[0])
    last = [
        Bar(length, float(np.arctan2(arm[1], arm[0])), float(rate))
        for length, arm, rate in zip(lengths, arms, rates, strict=True)
    ]
    return replace(case, left=(*case.left[:-1], last[0]), right=(*case.right[:-1], last[1]))


def mechanism(case: ClosedChain, segments: int, modes: int) -> tuple[fa.Arm, AssembledState]:
    """Return the case in the second-order theory of flexarm, and its state at the start.

    The tip of the arm is the end of the right chain.
    """
    bars = (*case.left, *case.right)
    links = [
        fa.Link(
            length=bar.length,
            flexural_rigidity=case.flexural_rigidity,
            mass_per_length=case.mass_per_length,
            segments=segments,
            elements=4 * segments,
            modes=modes,
        )
        for bar in bars
    ]
    foot = len(case.left)
    links[foot] = links[foot].replace(parent=0)
    joints = [fa.Joint() for _ in bars]
    joints[foot] = fa.Joint(offset=(case.ground, 0.0))
    arm = fa.Arm(
        links=links,
        joints=joints,
        closures=[fa.Closure(link=foot, to_link=len(bars))],
        gravity=(0.0, -case.gravity),
        theory="second_order",
    )
    chains = case.left, case.right
    angles = [np.diff([bar.angle for bar in bars], prepend=0.0) for bars in chains]
    rates = [np.diff([bar.rate for bar in bars], prepend=0.0) for bars in chains]
    start = fa.assembled(arm, arm.rest(np.concatenate(angles)), arm.rest(np.concatenate(rates)))
    return arm, start


#: A crank that turns, coupler and rocker; and two bars from each foot, which fall from rest.
FOUR_BAR = closed(
    ClosedChain(
        left=(Bar(0.3, 0.7, 12.0), Bar(0.9)),
        right=(Bar(0.7),),
        ground=1.0,
        flexural_rigidity=200.0,
        duration=1.0,
    )
)
FIVE_BAR = closed(
    ClosedChain(
        left=(Bar(0.5, 2.0), Bar(0.7)),
        right=(Bar(0.4, 1.0), Bar(0.8)),
        ground=0.4,
        flexural_rigidity=20.0,
        duration=1.0,
    )
)
#: Elements, step (s), and axial rigidity (N) of the runs that are extrapolated.
STIFF = 1.3e7
SETTINGS = (
    (8, 1.25e-4, STIFF),
    (16, 1.25e-4, STIFF / 10.0),
    (16, 1.25e-4, STIFF),
    (16, 6.25e-5, STIFF),
)


def main() -> None:
    """Print the paths of the meeting point at eighths of the run, and what changes them.

    They are extrapolated to steps of zero (the method has order 2) and to no extension.
    """
    for name, case in (("four-bar", FOUR_BAR), ("five-bar", FIVE_BAR)):
        coarse, soft, middle, fine = (
            prepare(replace(case, axial_rigidity=axial), elements, step)()
            for elements, step, axial in SETTINGS
        )
        steps, extension = (fine - middle) / 3.0, (middle - soft) / 9.0
        changes = ("elements", middle - coarse), ("steps", steps), ("extension", extension)
        print(name, *(f"{what} {np.abs(change).max():.1e} m" for what, change in changes))
        limit = fine + steps + extension
        print(np.array2string(limit[1:], precision=9, separator=", "), flush=True)


if __name__ == "__main__":
    main()
