"""Parameters of a run, each identified by a path, and the derivatives of the run's numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from flexarm.arm.actions.environment import Environment
from flexarm.base.errors import InputError, Problem, shown
from flexarm.kernels.layout import Array
from flexarm.model.paths import number_at, with_number
from flexarm.simulation.derivatives.arm_parameters import arm_derivative
from flexarm.simulation.derivatives.differences import differences
from flexarm.simulation.derivatives.inputs import ArmInputs, Inputs, arm_inputs, no_change
from flexarm.simulation.derivatives.loop_in_duals import RecordedLoop
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.histories.samples import added_coefficients, collected_samples
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.work.open_loop import Checkpoints

#: Paths of numbers that are not those of the arm: of the state at the start, the torque samples,
#: the force on the tip, and records of the environment.
_STATE = re.compile(r"(initial|initial_rate)\[(\d{1,6})\]")
_SAMPLE = re.compile(r"torque\[(\d{1,9})\]\[(\d{1,6})\]")
_TIP = re.compile(r"tip_force\[([012])\]")
_RECORD = re.compile(r"(loads|contacts)\[(\d{1,6})\]\.(.+)")


def has_samples(paths: Sequence[str]) -> bool:
    """Return whether any path is that of a torque sample."""
    return any(_SAMPLE.fullmatch(path) for path in paths)


def is_of_arm(path: str) -> bool:
    """Return whether a path is that of a number of the arm."""
    return not any(kind.fullmatch(path) for kind in (_STATE, _SAMPLE, _TIP, _RECORD))


class Samples(NamedTuple):
    """Torque samples of a run."""

    history: PiecewiseCubic  # with stops at its kinks alone
    shape: tuple[int, int]  # (samples, joints)
    rate: float  # Hz
    interpolation: str

    def added(self, units: Array) -> Array:
        """Return the derivatives (pieces, 4, columns) by changes (samples, columns)."""
        return added_coefficients(self.history, units, self.rate, self.interpolation)

    def collected(self, pieces: Array) -> Array:
        """Return the gradient (samples, joints) from that by coefficients (pieces, k, joints)."""
        return collected_samples(self.history, pieces, self.rate, self.interpolation, self.shape[0])


@dataclass(frozen=True, eq=False)
class Parameters:
    """Parameters of a run that has been simulated.

    Attributes:
        run: the run.
        environment: loads and contacts of the run.
        inputs: its numbers.
        samples: the torque samples; None if the torque does not consist of samples.
        tip_forces: number of loads at the beginning that are the force on the tip.
        loop: the closed loop; None without a controller.
        checkpoints: from which parts of the run can be repeated; None if not requested.
    """

    run: Run
    environment: Environment
    inputs: Inputs
    samples: Samples | None
    tip_forces: int
    loop: RecordedLoop | None = None
    checkpoints: Checkpoints | None = None

    def derivatives(self, paths: Sequence[str]) -> list[Inputs]:
        """Return the derivatives of the numbers of the run by each parameter.

        Raises:
            InputError: if a path is not that of a number, is repeated, or the numbers are not
                differentiable with respect to it; all problems are listed.
        """
        found: list[Inputs] = []
        problems: list[Problem] = []
        for k, path in enumerate(paths):
            name = f"parameters[{k}]"
            try:
                if path in paths[:k]:
                    raise InputError(Problem(name, f"repeats {path}"))
                found.append(self._derivative(name, path))
            except InputError as error:
                problems += error.problems
        if problems:
            raise InputError(*problems)
        return found

    def _derivative(self, name: str, path: str) -> Inputs:
        nothing = no_change(self.inputs)
        if (place := _STATE.fullmatch(path)) is not None:
            return nothing._replace(state=self._unit_state(name, path, int(place[2]), place[1]))
        if (place := _SAMPLE.fullmatch(path)) is not None:
            return nothing._replace(torque=self._sample(name, path, int(place[1]), int(place[2])))
        if (place := _TIP.fullmatch(path)) is not None:
            if not self.tip_forces:
                raise InputError(Problem(name, "requires tip_force", hint="Zeros are possible."))
            value = np.zeros_like(self.inputs.load_value)
            value[0, int(place[1])] = 1.0
            return nothing._replace(load_value=value)
        if (place := _RECORD.fullmatch(path)) is not None:
            return self._of_record(name, path, place[1], int(place[2]), place[3])
        return nothing._replace(arm=arm_derivative(name, self.run.arm, self.environment, path))

    def _unit_state(self, name: str, path: str, place: int, which: str) -> Array:
        """Return the derivative of the state at the start by one of its entries."""
        arm, run = self.run.arm, self.run
        if place >= arm.dof:
            rule = f"have an index below {arm.dof}, the number of coordinates"
            raise InputError(Problem(name, rule, shown(path)))
        numbers = zip(arm.joint_index, arm.joint_numbers, strict=True)
        if place in [index for index, number in numbers if number in run.prescribed]:
            raise InputError(Problem(name, f"is not supported with prescribed motion: {path}"))
        unit = np.zeros((2, arm.dof))
        unit[int(which == "initial_rate"), place] = 1.0
        return arm.padded(unit)

    def _sample(self, name: str, path: str, sample: int, joint: int) -> Array:
        """Return the derivative of the torque by one of its samples."""
        arm, samples = self.run.arm, self.samples
        if samples is None or self.run.prescribed:
            rule = (
                "requires torque as an array of samples, without controller and prescribed motion"
            )
            raise InputError(Problem(name, rule))
        if sample >= samples.shape[0] or joint >= samples.shape[1]:
            rule = f"be a sample of torque, which has shape {samples.shape}"
            raise InputError(Problem(name, rule, shown(path)))
        unit = np.zeros(samples.shape)
        unit[sample, joint] = 1.0
        return arm.padded_torque(samples.added(unit))

    def _of_record(self, name: str, path: str, which: str, place: int, inside: str) -> Inputs:
        """Return the derivatives by a number of a load or a contact."""
        first = self.tip_forces if which == "loads" else 0
        records = list(getattr(self.environment, which))
        if first + place >= len(records):
            rule = f"have an index below {len(records) - first}, the number of {which}"
            raise InputError(Problem(name, rule, shown(path)))
        record = records[first + place]
        value = number_at(name, record, inside)

        def at(changed: float) -> list[Array]:
            records[first + place] = with_number(record, inside, changed)
            environment = replace(self.environment, **{which: records})
            value = Environment(environment.loads).placed(self.run.arm).value
            return [*arm_inputs(self.run.arm, environment), value]

        *arm, load_value = differences(name, path, value, abs(value) or 1.0, at)
        own = no_change(self.inputs)
        return own._replace(arm=ArmInputs(*arm), load_value=load_value)
