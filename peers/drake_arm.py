"""A case in Drake: rigid bars on springs, integrated with error control."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    RevoluteJoint,
    RevoluteSpring,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from peers.arms import TORQUE_ENDS, Case
from peers.bars import Bar, angles, bars

#: Points of the torques' spline: within 1e-11 of the sine.
_POINTS = 1001


def tip(case: Case, segments: int, accuracy: float, longest: float = 0.1) -> np.ndarray:
    """Return the tip's path (samples, 2), m; see ``prepare``."""
    return prepare(case, segments, accuracy, longest)()


def prepare(
    case: Case, segments: int, accuracy: float, longest: float = 0.1
) -> Callable[[], np.ndarray]:
    """Build the model; return what integrates it and gives the tip's path (samples, 2), m.

    Each link is cut into ``segments`` as in ``bars``. Drake's method of Runge and Kutta of order 3
    chooses its steps by ``accuracy``, a relative tolerance, up to ``longest`` s: with a stable
    limit it rejects hardly any step. It calls no Python between two samples.
    """
    diagram, plant, last = _diagram(case, segments)
    simulator = Simulator(diagram)
    ApplySimulatorConfig(
        SimulatorConfig(
            integration_scheme="runge_kutta3",
            accuracy=accuracy,
            max_step_size=longest,
            use_error_control=True,
        ),
        simulator,
    )
    context = simulator.get_mutable_context()
    own = plant.GetMyMutableContextFromRoot(context)
    end = np.array([bars(case, segments)[-1].length, 0.0, 0.0])
    start = angles(case, segments)

    def run() -> np.ndarray:
        context.SetTime(0.0)
        plant.SetPositionsAndVelocities(own, np.concatenate([start, np.zeros_like(start)]))
        simulator.Initialize()
        path = np.empty((case.samples, 2))
        for sample in range(case.samples):
            simulator.AdvanceTo(sample / case.rate)
            frame, world = last.body_frame(), plant.world_frame()
            path[sample] = plant.CalcPointsPositions(own, frame, end, world)[:2, 0]
        return path

    return run


def _diagram(case: Case, segments: int) -> tuple[Diagram, MultibodyPlant, RigidBody]:
    """Return the chain of bars with its motors driven, the plant in it, and the last bar."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(time_step=0.0))  # continuous in time
    plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, -case.gravity, 0.0]))
    last = plant.world_body()
    for number, bar in enumerate(bars(case, segments)):
        place = RigidTransform(np.array([bar.offset, 0.0, 0.0]))
        hinge_frame = plant.AddFrame(FixedOffsetFrame(f"end{number}", last.body_frame(), place))
        last = plant.AddRigidBody(f"bar{number}", _inertia(bar))
        axis = np.array([0.0, 0.0, 1.0])
        hinge = plant.AddJoint(
            RevoluteJoint(f"hinge{number}", hinge_frame, last.body_frame(), axis)
        )
        if bar.link is None:
            plant.AddForceElement(RevoluteSpring(hinge, 0.0, bar.spring))
        else:
            plant.AddJointActuator(f"motor{bar.link}", hinge)
    plant.Finalize()
    source = builder.AddSystem(TrajectorySource(_torques(case)))
    builder.Connect(source.get_output_port(), plant.get_actuation_input_port())
    return builder.Build(), plant, last


def _inertia(bar: Bar) -> SpatialInertia:
    # Inertia about the bar's own axis is required, although nothing turns about it.
    square = bar.inertia / bar.mass
    centre = np.array([0.5 * bar.length, 0.0, 0.0])
    return SpatialInertia.MakeFromCentralInertia(
        bar.mass, centre, bar.mass * UnitInertia(square, square, square)
    )


def _torques(case: Case) -> PiecewisePolynomial:
    """Return the motors' torques over time, in C++."""
    times = np.linspace(0.0, TORQUE_ENDS, _POINTS)
    values = np.multiply.outer(case.amplitude, [case.wave(t) for t in times])
    torques = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(times, values)
    after = np.array([TORQUE_ENDS, TORQUE_ENDS + case.duration])
    torques.ConcatenateInTime(PiecewisePolynomial.ZeroOrderHold(after, np.zeros((len(values), 2))))
    return torques
