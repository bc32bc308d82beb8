"""The numbers of a run that parameters change, and their derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.arm.actions.environment import Environment
from flexarm.arm.arm import Arm
from flexarm.arm.stations import place_gauges
from flexarm.kernels.layout import ArmConstants, Array
from flexarm.simulation.run.stepping import Run


class ArmInputs(NamedTuple):
    """Numbers that depend on the parameters of an arm, or their derivatives by one of them.

    The first five arrays are those of ``ArmConstants``, the next five those of ``Loads``, the last
    three those of ``Contacts``; shapes as there.
    """

    arm: Array
    body: Array
    mode: Array
    centrifugal: Array
    shortening: Array
    gauges: Array  # (gauges, m) strain per modal coordinate
    load_weight: Array
    load_lever: Array
    load_rows: Array
    load_slopes: Array
    load_shortening: Array
    point_rows: Array
    point_shortening: Array
    point_law: Array

    @property
    def constants(self) -> ArmConstants:
        """The constants of the arm."""
        return ArmConstants(*self[:5])


class Inputs(NamedTuple):
    """All numbers of a run that parameters change, or their derivatives by one parameter."""

    arm: ArmInputs
    state: Array  # (2, n, 1 + m) at the start
    torque: Array  # (pieces, 4, n) coefficients of the drive
    load_value: Array  # (loads, 3)


def arm_inputs(arm: Arm, environment: Environment) -> ArmInputs:
    """Return the numbers of an arm with loads and contacts.

    Raises:
        InputError: if a load or a contact is not on the arm.
    """
    placed = Environment(environment.loads, None, environment.contacts).placed(arm)
    contacts = placed.contacts
    return ArmInputs(
        *arm.assembly.constants,
        place_gauges(arm, arm.gauges)[0],
        placed.weight,
        placed.lever,
        placed.rows,
        placed.slopes,
        placed.shortening,
        contacts.rows,
        contacts.shortening,
        contacts.law,
    )


def inputs_of_run(run: Run, environment: Environment) -> Inputs:
    """Return the numbers of a run that has been simulated."""
    assert run.history is not None
    system = run.system(run.history)
    drive = system.drive
    own = arm_inputs(run.arm, environment)
    # The run may have prescribed joints, and its contacts know the mobility of the arm.
    own = own._replace(**system.constants._asdict(), point_law=drive.loads.contacts.law)
    return Inputs(own, run.samples[0].copy(), drive.coefficients, drive.amplitude)


def no_change(inputs: Inputs) -> Inputs:
    """Return derivatives of zero, which must not be modified."""
    return Inputs(
        ArmInputs(*(_zeros(array) for array in inputs.arm)),
        *(_zeros(array) for array in inputs[1:]),
    )


def _zeros(array: Array) -> Array:
    return np.broadcast_to(np.float64(0.0), array.shape)
