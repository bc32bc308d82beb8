"""From one sample time to the next: sense, take a torque, hold it."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.engine.stepping import Run
from flexarm.hardware.hardware import Hardware
from flexarm.hardware.measurement import Measurement
from flexarm.histories.torques import TorqueHistory
from flexarm.integrate.base import FloatArray, System
from flexarm.loop.actuators import Acting
from flexarm.loop.sensors import sensing_of


class Ticks:
    """A run cut into sample times, with the hardware between it and whoever gives the torques.

    Args:
        sample_time: s. keep: whether the torques that acted are kept for ``acting.at``.

    Raises:
        InputError: the hardware does not fit the arm or the sample time.
    """

    def __init__(
        self, run: Run, sample_time: float, hardware: Hardware | None, keep: bool = True
    ) -> None:
        self.run, self._hardware = run, hardware
        self.sample_time = sample_time
        self.tick = 0  # number of the sample time that it stands at
        self._sensing = sensing_of(run, hardware, sample_time)
        self.acting = Acting(hardware, run.arm.joints, keep)
        self._bodies = run.arm.assembly.joint_body
        self._system = self._new_system()

    def _new_system(self) -> System:
        breaks = np.arange(self.acting.pieces + 1.0)
        held = np.zeros((self.acting.pieces, 4, self.run.arm.joints))
        return self.run.system(TorqueHistory(breaks, held, np.zeros(0)))

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy or a pickle keeps: readers and system are made anew of the run.

        Nothing in the system outlasts a sample time: torque, loads and touches are written into it
        before they are read.
        """
        kept = {name: value for name, value in self.__dict__.items() if name != "_system"}
        return kept | {"_sensing": self._sensing.memory()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._sensing = sensing_of(self.run, self._hardware, self.sample_time)
        self._sensing.recall(state["_sensing"])
        self._system = self._new_system()

    @property
    def time(self) -> float:
        """Sample time (s) that it stands at."""
        return self.tick * self.sample_time

    def measure(self) -> Measurement:
        """Return what the sensors say; to be asked once at each sample time, in order."""
        return self._sensing.measure(self.tick, self.time, self.run.progress.state, self._system)

    def hold(self, torque: FloatArray) -> None:
        """Ask for a torque (joints,) N m and go on to the next sample time, or to the run's end.

        Raises:
            SimulationError: the integrator gave up.
        """
        self.acting.ask(self.time, torque)
        self.tick += 1
        until = min(self.time, self.run.duration)
        while self.run.progress.time < min(until, self.run.duration):  # an event may end the run
            self._advance(until)

    def _advance(self, until: float) -> None:
        """Go on to ``until``, or to where another torque begins to act."""
        run, acting, now = self.run, self.acting, self.run.progress.time
        acting.hold(now, run.progress.state[1, self._bodies, 0])
        change = acting.next_change(now, until)
        drive = self._system.drive
        if acting.plain:
            drive.coefficients[0, 0, self._bodies] = acting.target
        else:
            drive.breaks[:], coefficients = acting.cubics(now, change)
            drive.coefficients[:, :, self._bodies] = coefficients
        self._system = run.carry_to(self._system, change)
