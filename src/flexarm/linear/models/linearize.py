"""Linear models about any state: theory page "small motion", (S.1).

The kernels evaluate accelerations and outputs at states, torques and loads with an imaginary part
of 1e-30 in one entry at a time (``kernels.derivatives.sensitivity``). Every entry of A, B, C and
D is therefore exact to rounding without hand-written derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.actions import Environment, marker, parts_of, place_loads
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import check_state
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.arm.bending import one_warning
from flexarm.arm.closed import independent_motions, least_forces, refuse_opening
from flexarm.arm.dynamics import gaps_by_q
from flexarm.arm.observe import channels_of, contact_channels
from flexarm.base.errors import InputError, Problem, check_array, check_result, public_call
from flexarm.kernels.columns import GAP_RATE
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import Loads
from flexarm.kernels.observation.point_motion import MOTION_COLUMNS, point_motions
from flexarm.linear.models.state_space import (
    Input,
    InputName,
    LinearModel,
    Output,
    OutputName,
    find_inputs,
    find_outputs,
    state_names,
    torque_places,
)
from flexarm.linear.statics.axial import warn_of_theory
from flexarm.linear.statics.equilibrium import Equilibrium, equilibrium, tangent
from flexarm.linear.statics.gaps import warn_of_backlash, warn_of_bristles, warn_of_sticking
from flexarm.model import Contact, Load

ComplexArray = NDArray[Any]


@public_call
def linearize(
    arm: Arm,
    q: ArrayLike | Equilibrium | None = None,
    qd: ArrayLike | None = None,
    torque: ArrayLike | None = None,
    *,
    inputs: Sequence[InputName] = ("torque",),
    outputs: Sequence[OutputName] = ("joint_angle",),
    tip_force: ArrayLike | None = None,
    loads: Sequence[Load] = (),
    base_acceleration: ArrayLike | None = None,
    contacts: Sequence[Contact] = (),
) -> LinearModel:
    """Linearise an arm about a state.

    Args:
        arm: the arm.
        q: (dof,) operating point; or joint angles (joints,) of straight links; or an
            `Equilibrium`, with its torque, loads and contacts; or None for the equilibrium with the
            joints at zero, or with free joints under ``torque`` if that is given.
        qd: (dof,) rates; zero by default.
        torque: (joints,) N m; by default those of the inverse dynamics at zero acceleration.
        inputs: "torque", "voltage" (of joints with a winding), "tip_force", "tip_moment",
            "base_acceleration"; a `Load`, whose numbers give the direction of a unit input; or a
            pair of a name and a `Load`.
        outputs: channels of results such as "joint_angle", "tip", "strain", "torque"; a `Sensor`.
        tip_force, loads, base_acceleration, contacts: those at the operating point, as in
            `Arm.forward_dynamics`. A contact that is open at the operating point has no effect on
            the model.

    Raises:
        InputError: if a signal is unknown, a shape is wrong, torque, loads or contacts are given
            with an equilibrium, ``base_acceleration`` is given without ``q``, or the state does not
            close the loops of a mechanism.
        EquilibriumError: if ``q`` is None and no equilibrium is found.

    Warns:
        LargeDeflectionWarning: a link is bent too far, or has too large an axial load, for the
            theory of the arm.
        AccuracyWarning: friction has bristles, which a linear model does not contain.
        FlexarmWarning: friction holds a joint that is at rest.

    The states of a mechanism with closures are independent coordinates and their rates: modes, and
    the joints that are left. ``LinearModel.states`` names them.
    """
    given = tip_force, loads, base_acceleration, contacts
    environment = Environment.of(arm, *given)
    environment.placed(arm)  # errors name this function
    count = len(q.contacts if isinstance(q, Equilibrium) else environment.contacts)
    driven, observed = find_inputs(arm, inputs), find_outputs(arm, outputs, count)
    if q is None and base_acceleration is not None:
        rule = "is not supported with an equilibrium: give q"
        raise InputError(Problem("base_acceleration", rule))
    with one_warning(report=False):
        point = _operating_point(arm, q, qd, torque, environment)
    warn_of_theory(arm, point.q, point.environment, point.qd)
    warn_of_backlash(arm, point.q)
    warn_of_bristles(arm, "the linear model")
    warn_of_sticking(arm, point.qd, "The linear model")
    if torque is None and not isinstance(q, Equilibrium) and q is not None:
        holding = arm.inverse_dynamics(point.q, point.qd, np.zeros(arm.dof), *given)
        if arm.closure_rows:
            closing = least_forces(arm, point.q, holding, np.arange(arm.dof))
            holding = holding - arm.closure_jacobian(point.q).T @ closing
        point.torque[:] = holding[arm.joint_index]
    return _Perturbed(arm, point, driven, observed).model()


@dataclass
class _Point:
    q: FloatArray
    qd: FloatArray
    torque: FloatArray
    environment: Environment


def _operating_point(
    arm: Arm,
    q: ArrayLike | Equilibrium | None,
    qd: ArrayLike | None,
    torque: ArrayLike | None,
    environment: Environment,
) -> _Point:
    loads, contacts = environment.loads, environment.contacts
    if q is None:
        q = equilibrium(arm, torque=torque, loads=loads, contacts=contacts)
    elif isinstance(q, Equilibrium) and (loads or contacts or torque is not None):
        rule = "cannot be combined with an equilibrium, which contains its own"
        raise InputError(Problem("torque, loads and contacts", rule))
    rates = np.zeros(arm.dof) if qd is None else check_array("qd", qd, (arm.dof,))
    place = q.q if isinstance(q, Equilibrium) else check_state(arm, "q", q)
    refuse_opening(arm, ("q", "qd"), place, rates)
    if isinstance(q, Equilibrium):
        own = replace(q.environment, base_acceleration=environment.base_acceleration)
        return _Point(place, rates, q.torque.copy(), own)
    tau = (
        np.zeros(arm.n_joints) if torque is None else check_array("torque", torque, (arm.n_joints,))
    )
    return _Point(place, rates, tau, environment)


class _Perturbed:
    """States, torques and loads, each row with an imaginary step in one entry.

    Row 0 is the operating point; ``size`` rows perturb a state, the other rows an input. The states
    are the independent coordinates of motions that keep the loops closed, and their rates.
    """

    def __init__(self, arm: Arm, point: _Point, inputs: list[Input], outputs: list[Output]) -> None:
        self.arm, self.point = arm, point
        self.inputs, self.outputs = inputs, outputs
        self.kernels = KernelView(arm.assembly.constants, complex)
        self.motions = independent_motions(arm, point.q, np.arange(arm.dof))
        self.size = size = 2 * self.motions.independent.size
        self.rows = 1 + size + len(inputs)
        moved = np.tile(np.concatenate([point.q, point.qd]).astype(complex), (self.rows, 1))
        moved[1 : 1 + size] += STEP * 1j * self._directions()
        self.states = arm.padded(moved.reshape(self.rows, 2, arm.dof))
        torque = np.tile(point.torque.astype(complex), (self.rows, 1))
        torque[1 + size :] += STEP * 1j * torque_places(inputs, arm.n_joints).T
        self.torque = torque
        self.placed, self.values, self.bases = self._loads()
        self.accelerations = self._respond()

    def _directions(self) -> FloatArray:
        """Return the change (size, 2 dof) of q and qd by each state.

        Rates that keep the loops closed depend on the posture, too.
        """
        motions, dof = self.motions, self.arm.dof
        Z = motions.displacements(np.eye(motions.independent.size))
        directions = np.zeros((2, Z.shape[1], 2 * dof))
        directions[0, :, :dof] = directions[1, :, dof:] = Z.T
        if motions.basis is not None:
            by_q = gaps_by_q(self.arm, np.stack([self.point.q, self.point.qd]), GAP_RATE)
            directions[0, :, dof + motions.dependent] = -motions.solver @ by_q @ Z
        return directions.reshape(self.size, 2 * dof)

    def _loads(self) -> tuple[Loads, ComplexArray, ComplexArray]:
        """Return all loads, their values (rows, k, 3) and the base accelerations (rows, 2)."""
        environment = self.point.environment
        pushes = [item.load for item in self.inputs if item.load is not None]
        with_inputs = replace(environment, loads=[*environment.loads, *pushes])
        placed = with_inputs.placed(self.arm)
        owners = [
            *(None for _ in parts_of(self.arm, environment.loads)),
            *(k for k, load in enumerate(pushes) for _ in parts_of(self.arm, [load])),
        ]
        values = np.tile(placed.value.astype(complex), (self.rows, 1, 1))
        bases = np.tile(placed.base_acceleration.astype(complex), (self.rows, 1))
        for part, owner in enumerate(owners):
            if owner is not None:
                values[:, part] = 0.0  # inputs are zero at the operating point
        push = -1
        for row, item in enumerate(self.inputs, start=1 + self.size):
            if item.axis is not None:
                bases[row, item.axis] += STEP * 1j
            if item.load is not None:
                push += 1
                own = [part for part, owner in enumerate(owners) if owner == push]
                values[row, own] = STEP * 1j * placed.value[own]
        return placed, values, bases

    def _loads_of(self, row: int) -> Loads:
        return self.placed._replace(value=self.values[row], base_acceleration=self.bases[row])

    def _respond(self) -> ComplexArray:
        kernels, acceleration = self.kernels, self.kernels.work.acceleration
        tau = self.arm.padded_torque(self.torque)
        found = np.empty((self.rows, *self.states.shape[2:]), dtype=complex)
        for row in range(self.rows):
            try:
                kernels.forward_dynamics(self.states[row], tau[row], self._loads_of(row))
            except ZeroDivisionError:  # complex division only; real division gives infinity
                acceleration[:] = np.nan
            found[row] = acceleration
        point = self.point
        check_result(found.view(np.float64), point.q, point.qd, point.torque)
        return found

    def _outputs(self) -> ComplexArray:
        """Return the outputs (rows, outputs) of every row."""
        channels: dict[str, Any] = {}
        if any(item.channel not in (None, "torque") for item in self.outputs):
            channels = channels_of(self.arm, self.states)
            channels |= contact_channels(self.arm, self.placed.contacts, self.states)
        channels["torque"] = self.torque
        columns = [np.zeros((self.rows, 0), dtype=complex)]
        motions = self._sensors()
        for item in self.outputs:
            if item.sensor is not None:
                columns.append(motions.pop(0)[:, item.sensor.columns])
            else:
                columns.append(channels[str(item.channel)].reshape(self.rows, -1))
        return np.concatenate(columns, axis=1)

    def _sensors(self) -> list[ComplexArray]:
        """Return the motions (rows, MOTION_COLUMNS) of the point of each sensor."""
        sensors = [item.sensor for item in self.outputs if item.sensor is not None]
        if not sensors:
            return []
        places = [marker(sensor.link, sensor.station) for sensor in sensors]
        stations = place_loads(self.arm, places)
        shape = (self.rows, len(sensors), MOTION_COLUMNS)
        kernels, motions = self.kernels, np.zeros(shape, complex)
        poses, tip = kernels.pose_arrays()
        for row in range(self.rows):
            now = self.states[row], self.accelerations[row], self._loads_of(row)
            buffers = kernels.work, poses, tip
            kernels.call(point_motions, *now, stations, *buffers, motions[row])
        return [motions[:, k] for k in range(len(sensors))]

    def model(self) -> LinearModel:
        """Assemble the matrices of the linear model."""
        arm, point, size = self.arm, self.point, self.size
        qdd = arm.unpadded(self.accelerations)
        chosen, half = self.motions.independent, size // 2
        by_all = qdd[1:, chosen].imag.T / STEP
        A, B = np.zeros((size, size)), np.zeros((size, len(self.inputs)))
        A[:half, half:] = np.eye(half)
        A[half:], B[half:] = by_all[:, :size], by_all[:, size:]
        seen = self._outputs()
        slopes = seen[1:].imag.T / STEP
        names, units = state_names(arm)
        states = np.concatenate([chosen, arm.dof + chosen])
        names, units = [names[k] for k in states], [units[k] for k in states]
        outputs = [name for item in self.outputs for name in item.names]
        units_of = dict(zip(names, units, strict=True))
        units_of |= {item.name: item.unit for item in self.inputs}
        units_of |= {name: item.unit for item in self.outputs for name in item.names}
        mass = self.motions.matrix(arm.mass_matrix(point.q))
        damping, stiffness = -mass @ A[half:, half:], -mass @ A[half:, :half]
        if self.motions.basis is None:
            # Exact to the rounding of each entry; the products above, to that of the largest.
            small = tangent(arm, point.q, point.qd, qdd[0].real, point.environment)
            damping, stiffness = small.damping, small.stiffness
        matrices = A, B, slopes[:, :size], slopes[:, size:]
        signals = tuple(names), tuple(item.name for item in self.inputs), tuple(outputs), units_of
        drift = np.concatenate([point.qd[chosen], qdd[0, chosen].real])
        operating = point.q, point.qd, point.torque, drift, seen[0].real
        return LinearModel(*matrices, *signals, mass, damping, stiffness, *operating)
