"""The closed loop of a run in dual numbers, with the derivatives of the recorded updates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.control.analysis.linear_controller import LinearController
from flexarm.control.hardware.instruments import Readings
from flexarm.control.hardware.measurement import FloatArray
from flexarm.kernels.compilation.duals import DIRECTIONS, Duals
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.simulation.derivatives.channels import channel_derivatives
from flexarm.simulation.derivatives.dual_run import DualRun, DualStepper
from flexarm.simulation.derivatives.inputs import Inputs
from flexarm.simulation.derivatives.recorded_loop import RecordedLoop
from flexarm.simulation.derivatives.update_derivatives import is_finite, not_differentiable
from flexarm.simulation.loop.actuators import Acting
from flexarm.simulation.run.stepping import Run


def loop_in_duals(
    run: Run, inputs: Inputs, blocks: Sequence[Sequence[Inputs]], loop: RecordedLoop
) -> list[DualRun]:
    """Repeat a run with a controller in dual numbers for blocks of directions; see `DualStepper`.

    Raises:
        SimulationError: if the run fails.
    """
    steppers = [DualStepper(run, inputs, block) for block in blocks]
    _LoopInDuals(run.arm, loop, steppers).execute(run.duration)
    return [stepper.result() for stepper in steppers]


class _LoopInDuals:
    """Sampled loop of a run that has been simulated, with derivatives in each direction.

    The commands have the values of the run. Their derivatives follow from those of the readings and
    of the memory of the controller. Motors compute with complex numbers, whose imaginary parts are
    the derivatives. Python computes the directions of all steppers together, because its time does
    not depend on their number.
    """

    def __init__(self, arm: Arm, loop: RecordedLoop, steppers: Sequence[DualStepper]) -> None:
        self._arm, self._loop, self._steppers = arm, loop, steppers
        self._directions = DIRECTIONS * len(steppers)
        self._bodies = arm.assembly.joint_body
        self._acting = Acting(loop.hardware, arm, keep=False, runs=self._directions)
        tick = loop.controller.sample_time
        self._pairs = [
            (Readings(_linear(item), tick, np.random.default_rng()), str(item.output))
            for item in loop.needed
        ]
        self._memory: FloatArray = np.zeros((self._directions, 0))

    def execute(self, duration: float) -> None:
        """Advance to the end of the run, ``duration`` (s)."""
        sample_time = self._loop.controller.sample_time
        for k, t in enumerate(self._loop.times):
            self._acting.command(t, self._command(k))
            until = min((k + 1) * sample_time, duration)
            while self._steppers[0].progress.time < until:
                self._hold(until)

    def _command(self, k: int) -> Any:
        """Return the command (directions, joints) of a sample; imaginary parts are derivatives."""
        update, readings = self._loop.updates[k], self._measure(k)
        if not is_finite(update):
            update = self._without_corners(update, readings, self._loop.times[k])
        slopes = self._memory @ update.C.T + readings @ update.D.T
        self._memory = self._memory @ update.A.T + readings @ update.B.T
        return self._loop.commands[k] + 1j * STEP * slopes

    def _without_corners(
        self, update: LinearController, readings: FloatArray, t: float
    ) -> LinearController:
        """Return an update without the infinite derivatives by numbers that no parameter changes.

        Raises:
            InputError: if a parameter changes a number at a corner.
        """
        for matrix, numbers in zip(update, (self._memory, readings) * 2, strict=True):
            if np.any(numbers[:, np.any(np.isinf(matrix), axis=0)]):
                raise not_differentiable(self._loop.controller, t)
        return LinearController(*(np.where(np.isinf(part), 0.0, part) for part in update))

    def _measure(self, k: int) -> FloatArray:
        """Return the derivatives (directions, p) of the readings of a sample."""
        found: dict[str, FloatArray] = {}
        for readings, channel in self._pairs:
            if readings.exact:
                found[readings.labels[0]] = self._slopes(channel)
                continue
            if readings.wants(k):
                readings.take(k, self._slopes(channel))
            readings.write_available(k, found)
        count = self._directions
        nothing = {name: np.zeros((count, size)) for name, size in self._loop.sizes.items()}
        if k == 0:
            self._refuse_stored(found)
        parts = [found.get(name, nothing[name]) for name in nothing]
        return np.concatenate([np.zeros((count, 0)), *parts], axis=1)

    def _refuse_stored(self, first: Mapping[str, FloatArray]) -> None:
        """Raise if a parameter changes a first reading that the controller stores.

        Raises:
            InputError: if it does.
        """
        for name in self._loop.stored:
            if np.any(first.get(name, 0.0)):
                rule = f"stores its first {name}, which a parameter changes"
                hint = "Give it a reference."
                raise InputError(Problem("controller", rule, hint=hint))

    def _hold(self, until: float) -> None:
        """Advance to ``until`` (s), or to the time at which the applied torque changes."""
        now = self._steppers[0].progress.time
        rate: Any = None
        if not self._acting.plain:
            value = self._states()[0].array[1, self._bodies, 0, 0]
            rate = value + 1j * STEP * self._slopes("joint_rate")
        self._acting.hold(now, rate)
        change = self._acting.next_change(now, until)
        breaks, cubics = self._acting.cubics(now, change)
        slopes = np.moveaxis(cubics.imag / STEP, 2, -1)
        for k, stepper in enumerate(self._steppers):
            drive = stepper.system.drive
            torque = cast(Duals, drive.coefficients).array
            drive.breaks[:] = breaks
            torque[:, :, self._bodies, 0] = cubics[:, :, 0].real
            torque[:, :, self._bodies, 1:] = slopes[..., DIRECTIONS * k : DIRECTIONS * (k + 1)]
            stepper.advance(change)

    def _states(self) -> list[Duals]:
        return [cast(Duals, stepper.progress.state) for stepper in self._steppers]

    def _slopes(self, channel: str) -> FloatArray:
        """Return the derivatives (directions, k) of a channel at present."""
        states = self._states()
        if channel in ("joint_angle", "joint_rate"):
            row = int(channel == "joint_rate")
            parts = [state.array[row, self._bodies, 0, 1:] for state in states]
            return np.concatenate(parts, axis=1).T
        found = []
        for stepper, state in zip(self._steppers, states, strict=True):
            now = stepper.at(Duals(state.array[None]))
            found += channel_derivatives(self._arm, now, DIRECTIONS, [channel])
        return np.array([one[channel].ravel() for one in found])


def _linear(item: Any) -> Any:
    """Return the instrument of the derivatives of readings: without added errors and range."""
    kept = [fault for fault in item.faults if fault.kind not in ("bias", "drift")]
    return item.replace(noise=0.0, bias=0.0, limit=np.inf, faults=kept)
