"""Closed-loop simulation: sensing, control and actuation at each sample time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy

import numpy as np
from numpy.typing import NDArray

from flexarm.base.errors import InputError, SimulationError, check_array
from flexarm.control.contract.base import Controller, Reference, report_of
from flexarm.control.hardware.instruments import Readings
from flexarm.control.hardware.measurement import Measurement, readings_by_name
from flexarm.integrate.base import FloatArray
from flexarm.model import Hardware
from flexarm.simulation.loop.requirements import misfits
from flexarm.simulation.loop.sampled_loop import SampleSchedule
from flexarm.simulation.loop.sampled_reference import sampled_reference
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.validity import RunawayWatch


class ClosedLoop:
    """Closed-loop run: measure, compute the torque, apply it until the next sample time.

    Raises:
        InputError: if controller, hardware and arm do not fit each other.
    """

    def __init__(
        self,
        run: Run,
        controller: Controller,
        reference: Reference | None,
        hardware: Hardware | None,
    ) -> None:
        contacts = run.loads.placed.contacts.body.size
        problems = misfits(controller, run.arm, reference, hardware, contacts)
        if problems:
            raise InputError(*problems)
        self._run = run
        self.controller = controller
        self.reference = reference
        self._reference = sampled_reference(reference, controller.sample_time, run.duration)
        self._schedule = SampleSchedule(run, controller.sample_time, hardware)
        self._runaway = RunawayWatch(run.arm)
        self.hardware = hardware
        self.times: list[float] = []
        self.commands: list[FloatArray] = []
        self.measured: list[Measurement] = []
        self.seconds = 0.0  # spent in the controller

    def execute(self) -> None:
        """Simulate to the end of the run.

        Raises:
            SimulationError: if the integrator fails, the motion diverges, or the controller
                raises or does not return finite torques.
        """
        run, schedule = self._run, self._schedule
        self.controller.reset()
        # Skip a last sample time that lies before the end by rounding alone.
        while schedule.time < run.duration * (1.0 - 1e-12):
            torque = self._update(schedule.time, schedule.measure())
            self.times.append(schedule.time)
            self.commands.append(torque)
            schedule.hold(torque)
            self._look(schedule.time)
            if schedule.tick % 256 == 0:
                run.meter.update(run.progress.time / run.duration)

    def repetition(self) -> Callable[[Run], None]:
        """Return a function that executes the loop for another run, with the controller of now."""
        controller = deepcopy(self.controller)

        def execute(run: Run) -> None:
            ClosedLoop(run, controller, self.reference, self.hardware).execute()

        return execute

    def _look(self, t: float) -> None:
        absurd = self._runaway(self._run.progress.state)
        if absurd:
            reason = f"{absurd}: the loop is unstable."
            hint = "Reduce the gains or the sample time, or design for this arm."
            raise SimulationError(t, reason, hint, self._run.state())

    def _update(self, t: float, measurement: Measurement) -> FloatArray:
        run = self._run
        if self.hardware is not None:
            self.measured.append(measurement)
        started = time.perf_counter()
        try:
            given = self.controller.update(t, measurement, self._reference)
        except Exception as error:
            reason = f"the controller failed with {type(error).__name__}: {error}"
            raise SimulationError(t, reason, "", run.state()) from error
        self.seconds += time.perf_counter() - started
        try:
            return check_array("torque", given, (run.arm.joints,))
        except InputError as error:
            reason = f"the controller returned an unusable value: {error.at('controller')}"
            raise SimulationError(t, reason, "", run.state()) from None

    def torque_at(self, times: FloatArray) -> FloatArray:
        """Return the applied torque (T, joints) at times (T,)."""
        return self._schedule.acting.at(times)

    def command_at(self, times: FloatArray) -> FloatArray:
        """Return the last torque commanded by the controller (T, joints) at times (T,)."""
        index = np.searchsorted(np.asarray(self.times), times * (1.0 + 1e-12), side="right") - 1
        return np.asarray(self.commands)[np.clip(index, 0, None)]

    @property
    def limited(self) -> bool:
        """Whether the torque of any motor has a limit."""
        return self._schedule.acting.limited

    def saturated(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """See ``Acting.saturated``."""
        return self._schedule.acting.saturated()

    def sensors(self) -> Sequence[Readings]:
        """Return the states of the instruments; empty without hardware."""
        return self._schedule.instruments

    def report(self) -> dict[str, float]:
        """Return the controller's own report on its run."""
        return report_of(self.controller)

    def readings(self) -> Mapping[str, FloatArray]:
        """Return the readings of the hardware's instruments by name: (samples, k)."""
        return readings_by_name(self.measured)
