"""A closed loop in dual numbers, with the derivatives of the steps of its controller.

The steps are differentiated by their memory and their readings. Derivatives of a law that accepts
complex numbers are exact. Central differences of order 8 differentiate other laws: for smooth ones
their error is 1e-12. Differences of order 6 estimate it, so that a law that is not smooth is
rejected.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from functools import partial
from typing import Any, cast

import numpy as np

from flexarm.base.errors import InputError, Problem, raise_any, shown
from flexarm.control.analysis.linear_controller import LinearController, StepMap
from flexarm.control.contract.base import Controller, Reference, Rest, has_poles
from flexarm.control.hardware.measurement import FloatArray, Measurement, Readings
from flexarm.kernels.compilation.duals import DIRECTIONS, Duals
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.model import Hardware, Instrument
from flexarm.simulation.derivatives.differences import local_slopes
from flexarm.simulation.derivatives.dual_run import (
    DualRun,
    DualStepper,
    Inputs,
    channel_derivatives,
)
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.loop.control_loop import ClosedLoop, ControlLoop
from flexarm.simulation.loop.devices import Acting, Sensing, measured_names
from flexarm.simulation.run.stepping import Run

#: First step of the differences, relative to the largest number of a reading or of the memory, and
#: the step of numbers that have all been zero. They are no multiple of a resolution, at which a law
#: that rounds would seem to be linear.
_SHIFT, _SMALL = 0.01 * 0.95**0.5, 1e-3 * 0.95**0.5
#: Relative difference of two updates with the same memory and readings that is rounding.
_SAME = 1e-9


class UpdateDerivatives:
    """Derivatives of the updates of a controller, computed in the order of the updates.

    Attributes:
        stored: names of first readings on which planned inputs depend, without a reference.
    """

    def __init__(self, controller: Any, reference: Reference | None) -> None:
        if not has_poles(controller):
            rule = "have a step that can be linearised, for derivatives of runs"
            hint = "Write step instead of update; see the page on your own controllers."
            raise InputError(Problem("controller", rule, type(controller).__name__, hint))
        self.stored: list[str] = []
        self._controller, self._reference = controller, reference
        self._before: Any = None
        self._rests = False
        self._largest = np.zeros(0)
        self._last: LinearController | None = None
        self._slope = np.zeros((0, 0))  # the same derivatives in one matrix

    def remember(self) -> None:
        """Store the memory of the controller before its next update."""
        self._before = self._controller.memory if self._last is not None else None

    def after(self, t: float, measurement: Measurement, torque: FloatArray) -> LinearController:
        """Return the derivatives of the update that the controller has just made at t (s)."""
        law = self._controller
        inputs = law.planned(t, law._reference_or_rest(measurement, self._reference))
        if self._last is None and self._reference is None:
            self._rests = self._follows_rest(t, measurement)
        step = StepMap(law, self._before, measurement, inputs, self._rests)
        now, again = step(np.array([step.point, step.point]))
        if not (_same(now[-torque.size :], torque) and _same(again, now)):
            rule = f"is not supported with derivatives of runs: its step at t = {t:.6g} s depends"
            hint = "A step changes no attributes; see flexarm.Controller."
            rule += " on more than its memory, readings and inputs"
            raise InputError(Problem("controller", rule, hint=hint))
        slope = step.slope() if step.analytic else self._differenced(step, measurement, t)
        if self._last is None or not np.array_equal(slope, self._slope):
            self._slope, self._last = slope, step.linear(slope)
        return self._last

    def _follows_rest(self, t: float, measurement: Measurement) -> bool:
        """Return whether inputs contain the first measured angles; note if others do."""
        planned = []
        for shift in (0.0, _SMALL):
            law = deepcopy(self._controller)
            law.reset()
            moved = {name: value + shift for name, value in measurement.items()}
            planned.append(law.planned(t, Rest(moved)))
        first, other = planned
        changed = {name for name in first if not np.array_equal(first[name], other[name])}
        self.stored = ["joint_angle"] if changed - {"reference_angle"} else []
        return changed == {"reference_angle"}

    def _differenced(self, step: StepMap, measurement: Measurement, t: float) -> FloatArray:
        """Return derivatives by differences, infinite ones at corners."""
        readings = [np.ravel(value) for value in measurement.values()]
        before = step.point[: step.point.size - sum(part.size for part in readings)]
        parts = [*([before] if before.size else []), *readings]
        sizes = np.array([np.abs(part).max(initial=0.0) for part in parts])
        if sizes.size == self._largest.size:
            sizes = np.maximum(sizes, self._largest)
        self._largest = sizes
        steps = np.where(sizes > 0.0, _SHIFT * sizes, _SMALL)
        slope = local_slopes(step, step.point, np.repeat(steps, [part.size for part in parts])).T
        if np.any(np.isnan(slope)):
            raise not_differentiable(self._controller, t)
        return slope


def is_finite(update: LinearController) -> bool:
    """Return whether an update has no corner where it was differentiated."""
    return all(bool(np.all(np.isfinite(matrix))) for matrix in update)


def not_differentiable(controller: Any, t: float) -> InputError:
    """Return the error of a controller whose update at t (s) has no derivative."""
    given = f"{type(controller).__name__}, which is not at t = {t:.6g} s"
    return InputError(Problem("controller", "be differentiable for a derivative", given))


def _same(found: FloatArray, wanted: FloatArray) -> bool:
    return bool(np.all(np.abs(found - wanted) <= _SAME * np.abs(wanted).max(initial=0.0)))


class RecordedLoop(ClosedLoop):
    """Closed loop that stores the derivatives of the updates of its controller.

    Attributes:
        updates: derivatives of each update, with columns for the readings in ``labels``.
        sensors: one instrument for each measured channel.
    """

    _is_programmed = False

    def __init__(
        self,
        run: Run,
        controller: Controller,
        reference: Reference | None,
        hardware: Hardware | None,
        signals: Sequence[str],
    ) -> None:
        super().__init__(run, controller, reference, hardware)
        if run.default_step is not None:
            rule = f"is required for {run.integrator.name} with derivatives of closed loops"
            raise InputError(Problem("step", rule))
        self.sensors = _instruments(run, hardware)
        self._limited = [item for item in self.sensors if np.isfinite(item.limit)]
        self._signals = signals
        self._refuse_instruments()
        self.updates: list[LinearController] = []
        self.sizes: dict[str, int] = {}
        self._used: set[str] = set()  # readings that the last update depends on
        self._ever_used: set[str] = set()
        self._reached: set[str] = set()  # rates that include a reading at the limit
        self._derivatives = UpdateDerivatives(controller, self._reference)

    @property
    def history(self) -> PiecewiseCubic:
        """Torque of a hold interval, zero here: the loop in dual numbers writes its own."""
        pieces = self.acting.pieces
        held = np.zeros((pieces, 4, self.run.arm.n_joints))
        return PiecewiseCubic(np.arange(pieces + 1.0), held, np.zeros(0))

    @property
    def stored(self) -> list[str]:
        """Names of the first readings that the controller stores without declaring it."""
        return self._derivatives.stored

    @property
    def needed(self) -> list[Instrument]:
        """Instruments whose readings an update depends on, or the controller stores."""
        names = self._ever_used.union(self.stored)
        return [item for item in self.sensors if not names.isdisjoint(item.labels)]

    def _refuse_instruments(self) -> None:
        """Raise if a reading of an instrument of the hardware has no derivative."""
        problems = []
        given = self.hardware.instruments if self.hardware is not None else None
        for k, item in enumerate(given or ()):
            name = f"hardware.instruments[{k}]"
            if item.resolution > 0.0:
                rule = "is not supported with derivatives of runs"
                hint = "Rounded readings have no derivative. Leave it out, or add noise instead."
                problems.append(Problem(f"{name}.resolution", rule, hint=hint))
            if item.output not in self._signals:
                rule = "be a channel that follows from q and qd, for derivatives of runs"
                problems.append(Problem(f"{name}.signal", rule, shown(item.signal)))
        raise_any(problems)

    def _update(self, t: float, measurement: Measurement) -> FloatArray:
        if not self.updates:
            self.sizes = {name: value.size for name, value in measurement.items()}
        self._derivatives.remember()
        torque = super()._update(t, measurement)
        update = self._derivatives.after(t, measurement, torque)
        if not self.updates or update is not self.updates[-1]:
            self._used = self._readings_of(update, measurement)
            self._ever_used |= self._used
        for item in self._limited:
            now = np.any(np.abs(measurement[item.label]) >= item.limit)
            self._reached |= set(item.labels[1:] if now else ())
            used = self._used.intersection(item.labels)
            if used & self._reached or (used and now):
                rule = f"is reached by {item.label}, which has no derivative there"
                raise InputError(Problem("hardware.instruments.limit", rule))
        self.updates.append(update)
        return torque

    def _readings_of(self, update: LinearController, measurement: Measurement) -> set[str]:
        """Return the names of the readings that an update uses."""
        start, found = 0, set()
        for name, value in measurement.items():
            part = slice(start, start + value.size)
            start += value.size
            if not (np.any(update.B[:, part]) or np.any(update.D[:, part])):
                continue
            if not any(name in item.labels for item in self.sensors):
                rule = f"reads {name}, which is not supported with derivatives of runs"
                raise InputError(Problem("controller", rule))
            found.add(name)
        return found


def _instruments(run: Run, hardware: Hardware | None) -> list[Instrument]:
    """Return the instruments of the hardware; without it, ideal ones of the supported readings."""
    if hardware is not None and hardware.instruments is not None:
        return list(hardware.instruments)
    names = measured_names(run.arm, None, 0)
    return [Instrument(name) for name in names]


def loop_in_duals(
    run: Run, inputs: Inputs, blocks: Sequence[Sequence[Inputs]], loop: RecordedLoop
) -> list[DualRun]:
    """Repeat a run with a controller in dual numbers in blocks of directions; see `DualStepper`."""
    steppers = [DualStepper(run, inputs, block) for block in blocks]
    _LoopInDuals(run, loop, steppers).execute()
    return [stepper.result() for stepper in steppers]


class _LoopInDuals(ControlLoop):
    """Loop of a run that has been simulated, with a row for the derivatives in each direction.

    The commands have the values of the run. Their derivatives follow from those of the readings and
    of the memory of the controller. Motors compute with complex numbers, whose imaginary parts are
    the derivatives. Python computes the directions of all steppers together, because its time does
    not depend on their number.
    """

    def __init__(self, run: Run, loop: RecordedLoop, steppers: Sequence[DualStepper]) -> None:
        self._arm, self._loop, self._steppers = run.arm, loop, steppers
        self._duration, self._directions = run.duration, DIRECTIONS * len(steppers)
        self._bodies = run.arm.assembly.joint_body
        acting = Acting(loop.hardware, run.arm, keep=False, runs=self._directions)
        super().__init__(acting, loop.sample_time)
        sensors = []
        for item in loop.needed:
            readings = Readings(_linear(item), self.sample_time, np.random.default_rng())
            sensors.append((readings, partial(self._slopes, str(item.output))))
        self._sensing = Sensing(sensors)
        self._memory: FloatArray = np.zeros((self._directions, 0))

    @property
    def end(self) -> float:
        """End of the run, s."""
        return self._duration

    @property
    def now(self) -> float:
        """Time that the steppers have reached, s."""
        return self._steppers[0].progress.time

    def _runs_on(self) -> bool:
        return self.tick < len(self._loop.times)

    def _command(self) -> Any:
        """Return the command (directions, joints) of a sample; imaginary parts are derivatives."""
        k = self.tick
        update, readings = self._loop.updates[k], self._measured()
        if not is_finite(update):
            # Infinite derivatives by numbers that no parameter changes have no effect.
            for matrix, numbers in zip(update, (self._memory, readings) * 2, strict=True):
                if np.any(numbers[:, np.any(np.isinf(matrix), axis=0)]):
                    raise not_differentiable(self._loop.controller, self.time)
            update = LinearController(*(np.where(np.isinf(part), 0.0, part) for part in update))
        slopes = self._memory @ update.C.T + readings @ update.D.T
        self._memory = self._memory @ update.A.T + readings @ update.B.T
        return self._loop.commands[k] + 1j * STEP * slopes

    def _measured(self) -> FloatArray:
        """Return the derivatives (directions, p) of the readings of a sample."""
        slopes = self._sensing.values(self.tick)
        count = self._directions
        nothing = {name: np.zeros((count, size)) for name, size in self._loop.sizes.items()}
        for name in self._loop.stored if self.tick == 0 else ():
            if np.any(slopes.get(name, 0.0)):
                rule = f"stores its first {name}, which a parameter changes"
                raise InputError(Problem("controller", rule, hint="Give it a reference."))
        parts = [slopes.get(name, nothing[name]) for name in nothing]
        return np.concatenate([np.zeros((count, 0)), *parts], axis=1)

    def _rates(self) -> Any:
        value = self._states()[0].array[1, self._bodies, 0, 0]
        return value + 1j * STEP * self._slopes("joint_rate")

    def _advance(self, now: float, until: float) -> None:
        breaks, cubics = self.acting.cubics(now, until)
        slopes = np.moveaxis(cubics.imag / STEP, 2, -1)
        for k, stepper in enumerate(self._steppers):
            drive = stepper.system.drive
            torque = cast(Duals, drive.coefficients).array
            drive.breaks[:] = breaks
            torque[:, :, self._bodies, 0] = cubics[:, :, 0].real
            torque[:, :, self._bodies, 1:] = slopes[..., DIRECTIONS * k : DIRECTIONS * (k + 1)]
            stepper.advance(until)

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
