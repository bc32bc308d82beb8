"""Record of a third bench, simulated by Exudyn: ``python tests/data/geared_bench.py``.

A flexible link hangs in gravity on an elastic gear with dry friction. Exudyn models the link by
geometrically exact beam elements in absolute coordinates, so neither its equations nor its mesh are
those of flexarm. The record is the limit of short steps (Richardson) and contains no noise, which
the tests add. The torque is the cubic spline through its samples. It needs the extra ``peers``.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from data.bench_records import FOLDER, GAUGE, RATE, Bench, interpolated, torques


@dataclass(frozen=True)
class GearedBench(Bench):
    """A bench with one link, which hangs straight at rest at first; SI units.

    The angles are those of the motor behind the gear. Damping of the joint is that of the gear's
    spring; friction and its smoothing act on the motor and are given at the joint.
    """

    gravity: float
    gear_stiffness: float
    rotor_inertia: float
    gear_ratio: float
    coulomb: float
    coulomb_negative: float
    viscous: float
    smoothing_rate: float


THREE = GearedBench(
    name="bench_geared_link",
    duration=3.0,
    lengths=(0.8,),
    rigidity=(40.0,),
    mass_per_length=(0.35,),
    damping=(4e-4,),
    hub_inertia=(0.002,),
    joint_damping=(0.06,),
    joint_mass=(0.0,),
    station=(0.06,),
    payload=0.15,
    amplitude=(1.5,),
    seed=3,
    gravity=9.81,
    gear_stiffness=60.0,
    rotor_inertia=4e-5,
    gear_ratio=30.0,
    coulomb=0.15,
    coulomb_negative=0.1,
    viscous=0.02,
    smoothing_rate=0.05,
)
#: Direction of the link at rest (rad).
START = -math.pi / 2.0
#: Beam elements of three nodes, and steps per sample of the coarse run.
_ELEMENTS, _STEPS = 12, 50
#: Radius of gyration of the sections (m), for the axial rigidity, and shear over axial rigidity.
_GYRATION, _SHEAR = 1e-3, 4.0


def friction_torque(bench: GearedBench, rate: float) -> float:
    """Return the torque (N m) against a rate (rad/s) of the joint, by the law of flexarm."""
    sign = math.tanh(rate / bench.smoothing_rate)
    level = bench.coulomb * (1.0 + sign) / 2.0 + bench.coulomb_negative * (1.0 - sign) / 2.0
    return level * sign + bench.viscous * rate


def gear_torque(backlash: float) -> Callable[..., float]:
    """Return the torque of the gear's damped spring, which has no stiffness within a gap (rad)."""

    def torque(
        _system: object,
        _time: float,
        _item: int,
        twist: float,
        rate: float,
        stiffness: float,
        damping: float,
        _offset: float,
    ) -> float:
        inside = min(max(twist, -0.5 * backlash), 0.5 * backlash)
        return stiffness * (twist - inside) + damping * rate

    return torque


def change_by_backlash(bench: GearedBench, samples: int, backlash: float) -> np.ndarray:
    """Return the change of the columns of a record by backlash (rad)."""
    torque = torques(bench, bench.duration, bench.seed)[:samples]
    gaps = (simulate(bench, torque, _STEPS, backlash=gap) for gap in (backlash, 0.0))
    return np.subtract(*gaps)


def simulate(
    bench: GearedBench,
    torque: np.ndarray,
    steps: int,
    elements: int = _ELEMENTS,
    backlash: float = 0.0,
) -> np.ndarray:
    """Return joint angle, strain and the tip (samples, 4), with ``steps`` steps per sample.

    The spring of the gear has ``backlash`` (rad).
    """
    import exudyn
    from exudyn import itemInterface as items

    container = exudyn.SystemContainer()
    system = container.AddSystem()
    beams, nodes = _add_link(system, bench, elements)
    rotor = system.AddNode(items.Node1D(referenceCoordinates=[0.0]))
    inertia = bench.rotor_inertia * bench.gear_ratio**2
    system.AddObject(items.ObjectMass1D(nodeNumber=rotor, mass=inertia))
    fixed, motor, root = (
        system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=place))
        for node, place in (
            (system.AddNode(items.NodePointGround()), 0),
            (rotor, 0),
            (nodes[0], 2),
        )
    )
    system.AddObject(
        items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=[motor, root],
            stiffness=bench.gear_stiffness,
            damping=bench.joint_damping[0],
            **({"springForceUserFunction": gear_torque(backlash)} if backlash else {}),
        )
    )
    system.AddObject(
        items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=[fixed, motor],
            damping=bench.viscous,
            springForceUserFunction=lambda _s, _t, _i, _u, rate, _k, _d, _o: friction_torque(
                bench, rate
            ),
        )
    )
    times = np.arange(len(torque)) / RATE
    fine = np.arange((len(torque) - 1) * steps + 1) / (RATE * steps)
    table = CubicSpline(times, torque[:, 0])(fine).tolist()
    system.AddLoad(
        items.LoadCoordinate(
            markerNumber=motor,
            loadUserFunction=lambda _s, t, _load: table[round(t * RATE * steps)],
        )
    )
    sensors, places = _add_sensors(system, bench, rotor, nodes[-1], beams)
    system.Assemble()
    if not system.SolveDynamic(_settings(len(torque), steps)):
        raise RuntimeError("Exudyn failed.")
    stored = [np.array(system.GetSensorStoredData(sensor)) for sensor in sensors]
    if not np.allclose(stored[0][:, 0], times, atol=1e-9):
        raise RuntimeError("Exudyn changed its steps.")
    curvature = np.stack([one[:, -1] for one in stored[2:]], axis=1)
    strain = -GAUGE * interpolated(places, curvature, bench.station[0])
    return np.column_stack([START + stored[0][:, 1], strain, stored[1][:, 1:3]])


def _add_link(system: object, bench: GearedBench, elements: int) -> tuple[list[int], list[int]]:
    """Add the link with hub, payload and gravity; return its beam elements and their nodes."""
    from exudyn import itemInterface as items

    length = bench.lengths[0]
    axis = np.array([math.cos(START), math.sin(START)])
    nodes = [
        system.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*(x * axis), START]))
        for x in np.linspace(0.0, length, 2 * elements + 1)
    ]
    axial = bench.rigidity[0] / _GYRATION**2
    beams = [
        system.AddObject(
            items.ObjectBeamGeometricallyExact2D(
                nodeNumbers=nodes[2 * k : 2 * k + 3],
                length=length / elements,
                massPerLength=bench.mass_per_length[0],
                # flexarm's link has none; zero would leave rotations without mass.
                crossSectionInertia=1e-3 * bench.mass_per_length[0] * _GYRATION**2,
                bendingStiffness=bench.rigidity[0],
                bendingDamping=bench.damping[0] * bench.rigidity[0],
                axialStiffness=axial,
                shearStiffness=_SHEAR * axial,
                includeReferenceRotations=True,
            )
        )
        for k in range(elements)
    ]
    hub = items.ObjectRigidBody2D(nodeNumber=nodes[0], mass=0.0, inertia=bench.hub_inertia[0])
    system.AddObject(hub)
    tip = system.AddObject(items.ObjectMassPoint2D(nodeNumber=nodes[-1], mass=bench.payload))
    for body in (*beams, tip):
        mass = system.AddMarker(items.MarkerBodyMass(bodyNumber=body))
        weight = [0.0, -bench.gravity, 0.0]
        system.AddLoad(items.LoadMassProportional(markerNumber=mass, loadVector=weight))
    ground = system.AddObject(items.ObjectGround())
    pivot = system.AddMarker(items.MarkerBodyPosition(bodyNumber=ground))
    root = system.AddMarker(items.MarkerNodePosition(nodeNumber=nodes[0]))
    system.AddObject(items.ObjectJointRevolute2D(markerNumbers=[pivot, root]))
    return beams, nodes


def _add_sensors(
    system: object, bench: GearedBench, rotor: int, tip: int, beams: list[int]
) -> tuple[list[int], np.ndarray]:
    """Add sensors of the motor, the tip, and curvatures at the returned places (m).

    Curvatures of quadratic elements are most accurate at the two points of Gauss.
    """
    import exudyn
    from exudyn import itemInterface as items

    kinds = exudyn.OutputVariableType
    kept = {"writeToFile": False, "storeInternal": True}
    sensors = [
        system.AddSensor(
            items.SensorNode(nodeNumber=rotor, outputVariableType=kinds.Coordinates, **kept)
        ),
        system.AddSensor(
            items.SensorNode(nodeNumber=tip, outputVariableType=kinds.Position, **kept)
        ),
    ]
    piece, places = bench.lengths[0] / len(beams), []
    for number, beam in enumerate(beams[:3]):
        for side in (-1.0, 1.0):
            place = side * piece / (2.0 * math.sqrt(3.0))
            places.append((number + 0.5) * piece + place)
            sensor = items.SensorBody(
                bodyNumber=beam,
                localPosition=[place, 0.0, 0.0],
                outputVariableType=kinds.CurvatureLocal,
                **kept,
            )
            sensors.append(system.AddSensor(sensor))
    return sensors, np.array(places)


def _settings(samples: int, steps: int) -> object:
    import exudyn

    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 1.0 / RATE
    time = settings.timeIntegration
    time.endTime = (samples - 1) / RATE
    time.numberOfSteps = (samples - 1) * steps
    time.adaptiveStep = False
    time.newton.relativeTolerance = 1e-6
    time.newton.absoluteTolerance = 1e-6
    settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
    return settings


def write() -> None:
    """Write the record as CSV."""
    torque = torques(THREE, THREE.duration, THREE.seed) + 0.0  # no negative zeros
    coarse, fine = (simulate(THREE, torque, steps) for steps in (_STEPS, 2 * _STEPS))
    limit = fine + (fine - coarse) / 3.0
    print("largest correction of the steps:", np.abs(limit - fine).max(axis=0))
    heads = ["time [s]", "torque_1 [N m]", "joint_angle_1 [rad]", "strain_1 [1]"]
    heads += ["tip_x [m]", "tip_y [m]"]
    table = np.column_stack([np.arange(len(torque)) / RATE, torque, limit])
    path = FOLDER / f"{THREE.name}.csv"
    np.savetxt(path, table, fmt="%.8g", delimiter=",", header=",".join(heads), comments="")


if __name__ == "__main__":
    write()
