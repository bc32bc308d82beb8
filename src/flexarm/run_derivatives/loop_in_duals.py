"""The closed loop of a run in dual numbers, with the derivatives of the recorded updates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from flexarm.arm import Arm
from flexarm.engine.stepping import Run
from flexarm.errors import InputError, Problem
from flexarm.hardware.instruments import Readings
from flexarm.hardware.measurement import FloatArray
from flexarm.kernels.compilation.dual_arrays import Duals
from flexarm.kernels.compilation.duals import DIRECTIONS
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.loop.actuators import Acting
from flexarm.loop_analysis.linear_controller import LinearController
from flexarm.run_derivatives.channels import channel_derivatives
from flexarm.run_derivatives.dual_run import DualRun, DualStepper
from flexarm.run_derivatives.inputs import Inputs
from flexarm.run_derivatives.recorded_loop import RecordedLoop
from flexarm.run_derivatives.update_derivatives import is_finite, not_differentiable


def loop_in_duals(run: Run, inputs: Inputs, by: Sequence[Inputs], loop: RecordedLoop) -> DualRun:
    """Repeat a run with a controller in dual numbers; see `DualStepper`.

    Raises:
        SimulationError: if the run fails.
    """
    stepper = DualStepper(run, inputs, by)
    _LoopInDuals(run.arm, loop, stepper).execute(run.duration)
    return stepper.result()


class _LoopInDuals:
    """Sampled loop of a run that has been simulated, with derivatives in each direction.

    The commands have the values of the run. Their derivatives follow from those of the readings and
    of the memory of the controller. Motors compute with complex numbers, whose imaginary parts are
    the derivatives.
    """

    def __init__(self, arm: Arm, loop: RecordedLoop, stepper: DualStepper) -> None:
        self._arm, self._loop, self._stepper = arm, loop, stepper
        self._progress, self._bodies = stepper.progress, arm.assembly.joint_body
        drive = stepper.system.drive
        self._breaks, self._coefficients = drive.breaks, cast(Duals, drive.coefficients)
        self._acting = Acting(loop.hardware, arm, keep=False, runs=DIRECTIONS)
        tick = loop.controller.sample_time
        self._pairs = [
            (Readings(_linear(item), tick, np.random.default_rng()), str(item.output))
            for item in loop.instruments
        ]
        self._memory: FloatArray = np.zeros((DIRECTIONS, 0))

    def execute(self, duration: float) -> None:
        """Advance to the end of the run, ``duration`` (s)."""
        sample_time = self._loop.controller.sample_time
        for k, t in enumerate(self._loop.times):
            self._acting.command(t, self._command(k))
            until = min((k + 1) * sample_time, duration)
            while self._progress.time < until:
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
        nothing = {name: np.zeros((DIRECTIONS, size)) for name, size in self._loop.sizes.items()}
        if k == 0:
            self._refuse_stored(found)
        parts = [found.get(name, nothing[name]) for name in nothing]
        return np.concatenate([np.zeros((DIRECTIONS, 0)), *parts], axis=1)

    def _refuse_stored(self, first: Mapping[str, FloatArray]) -> None:
        """Raise if a parameter changes a first reading that the controller stores.

        Raises:
            InputError: if it does.
        """
        for name in self._loop.stored:
            if np.any(first.get(name, 0.0)):
                rule = f"stores its first {name}, which a parameter changes"
                hint = "Give it a reference, or declare the attribute in start_memory."
                raise InputError(Problem("controller", rule, hint=hint))

    def _hold(self, until: float) -> None:
        """Advance to ``until`` (s), or to the time at which the applied torque changes."""
        now, state = self._progress.time, self._state()
        rate: Any = None
        if not self._acting.plain:
            rate = state.array[1, self._bodies, 0].T
            rate = rate[0] + 1j * STEP * rate[1:]
        self._acting.hold(now, rate)
        change = self._acting.next_change(now, until)
        self._breaks[:], cubics = self._acting.cubics(now, change)
        torque = np.concatenate([cubics[:, :, :1].real, cubics.imag / STEP], axis=2)
        self._coefficients.array[:, :, self._bodies] = np.moveaxis(torque, 2, -1)
        self._stepper.advance(change)

    def _state(self) -> Duals:
        return cast(Duals, self._progress.state)

    def _slopes(self, channel: str) -> FloatArray:
        """Return the derivatives (directions, k) of a channel at present."""
        state = self._state()
        if channel in ("joint_angle", "joint_rate"):
            return state.slopes[:, int(channel == "joint_rate"), self._bodies, 0]
        now = self._stepper.at(Duals(state.array[None]))
        found = channel_derivatives(self._arm, now, DIRECTIONS, [channel])
        return np.array([one[channel].ravel() for one in found])


def _linear(item: Any) -> Any:
    """Return the instrument of the derivatives of readings: without added errors and range."""
    kept = [fault for fault in item.faults if fault.kind not in ("bias", "drift")]
    return item.replace(noise=0.0, bias=0.0, limit=np.inf, faults=kept)
