"""Sample times of a run: measure, command a torque, advance to the next one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from flexarm.arm.assembly.kernel_view import as_slice
from flexarm.control.hardware.instruments import Readings
from flexarm.control.hardware.measurement import Measurement
from flexarm.integrate.base import FloatArray, System
from flexarm.model import Hardware
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.loop.actuators import Acting
from flexarm.simulation.loop.sensors import sensing_of
from flexarm.simulation.run.integrator_choice import friction_doubt
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.work.estimate import choose_by_samples


class SampleSchedule:
    """Run divided into sample times, with the hardware between arm and controller.

    Args:
        sample_time: s.
        keep: whether the applied torques are stored for ``acting.at``.

    Raises:
        InputError: if the hardware does not fit the arm or the sample time, or the run is hopeless.
    """

    def __init__(
        self, run: Run, sample_time: float, hardware: Hardware | None, keep: bool = True
    ) -> None:
        self.run, self._hardware = run, hardware
        self.sample_time = sample_time
        run.choice = choose_by_samples(run.choice, run.arm, sample_time, run.duration)
        run.integrator = run.choice.integrator
        if run.watch is not None:
            run.watch = replace(run.watch, integrator=run.integrator)
        run.doubt = friction_doubt(run.integrator, run.arm, sample_time) or run.choice.doubt
        self.tick = 0  # number of the current sample time
        self._sensing, self._sensed = sensing_of(run, hardware, sample_time), run.arm
        self.acting = Acting(hardware, run.arm, keep)
        self._bodies = as_slice(run.arm.assembly.joint_body)
        self._system = self._new_system()

    def _new_system(self) -> System:
        breaks = np.arange(self.acting.pieces + 1.0)
        held = np.zeros((self.acting.pieces, 4, self.run.arm.joints))
        return self.run.system(PiecewiseCubic(breaks, held, np.zeros(0)))

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for copies and pickles; readers and system are created again.

        The system stores nothing from one sample time to the next: torque, loads and contact
        forces are written before they are read.
        """
        kept = {name: value for name, value in self.__dict__.items() if name != "_system"}
        return kept | {"_sensing": self._sensing.memory()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._sense(state["_sensing"])
        self._system = self._new_system()

    def _sense(self, memory: tuple[Readings, ...]) -> None:
        """Create the sensors of the present arm, with their states between sample times."""
        self._sensing = sensing_of(self.run, self._hardware, self.sample_time)
        self._sensing.recall(memory)
        self._sensed = self.run.arm

    @property
    def time(self) -> float:
        """Current sample time (s)."""
        return self.tick * self.sample_time

    @property
    def instruments(self) -> tuple[Readings, ...]:
        """States of the instruments; empty for exact sensors."""
        return self._sensing.memory()

    def measure(self) -> Measurement:
        """Return the readings of the sensors; call once at each sample time, in order."""
        if self._sensed is not self.run.arm:  # it has changed
            self._sense(self._sensing.memory())
        return self._sensing.measure(self.tick, self.time, self.run.progress.state, self._system)

    def hold(self, torque: FloatArray) -> None:
        """Command a torque (joints,) N m and advance to the next sample time or the run's end.

        Raises:
            SimulationError: if the integrator fails.
        """
        self.acting.command(self.time, torque)
        self.tick += 1
        until = min(self.time, self.run.duration)
        while self.run.progress.time < min(until, self.run.duration):  # an event may end the run
            self._advance(until)

    def _advance(self, until: float) -> None:
        """Advance to ``until``, or to the time at which the applied torque changes."""
        run, acting, now = self.run, self.acting, self.run.progress.time
        rate = None if acting.plain else run.progress.state[1, self._bodies, 0]
        acting.hold(now, rate)
        change = acting.next_change(now, until)
        drive = self._system.drive
        if acting.plain:
            drive.coefficients[0, 0, self._bodies] = acting.target
        else:
            drive.breaks[:], coefficients = acting.cubics(now, change)
            drive.coefficients[:, :, self._bodies] = coefficients
        self._system = run.carry_to(self._system, change)
