"""Sampled control loops: sense, update, hold, advance; of one run, or of rows side by side."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np

from flexarm.arm.assembly.scratch import as_slice
from flexarm.base.errors import InputError, SimulationError, check_array
from flexarm.control.contract.base import Controller, Reference, report_of
from flexarm.control.hardware.instruments import Readings
from flexarm.control.hardware.measurement import Measurement, readings_by_name
from flexarm.integrate.base import FloatArray, System
from flexarm.model import Hardware
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.loop.actuators import Acting
from flexarm.simulation.loop.requirements import misfits
from flexarm.simulation.loop.sampled_reference import sampled_reference
from flexarm.simulation.loop.sensors import Sensing, sensing_of_run
from flexarm.simulation.run.integrator_choice import friction_doubt
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.validity import RunawayWatch
from flexarm.simulation.run.work.estimate import choose_by_samples


class ControlLoop(ABC):
    """Loop whose torques are constant commands from one sample time to the next.

    A row is a run, or a direction of a derivative; what advances rows is that of the subclass.

    Attributes:
        acting: the motors. sample_time: s.
        tick, time: number of the current sample time, and the time, s.
        times, commands: of the samples so far, s and (..., joints) N m.
    """

    def __init__(self, acting: Acting, sample_time: float) -> None:
        self.acting, self.sample_time = acting, sample_time
        self.tick, self.time = 0, 0.0
        self.times: list[float] = []
        self.commands: list[Any] = []

    @property
    @abstractmethod
    def end(self) -> float:
        """End of the rows, s, which an event may bring forward."""

    @property
    @abstractmethod
    def now(self) -> float:
        """Time that the rows have reached, s."""

    @abstractmethod
    def _command(self) -> Any:
        """Sense and update: return the commands (..., joints) of the current sample."""

    @abstractmethod
    def _rates(self) -> Any:
        """Return the joint rates (..., joints), rad/s."""

    @abstractmethod
    def _advance(self, now: float, until: float) -> None:
        """Advance the rows between two times (s) under the torque of ``acting``."""

    def _runs_on(self) -> bool:
        # Skip a last sample time that lies before the end by rounding alone.
        return self.time < self.end * (1.0 - 1e-12)

    def _look(self) -> None:  # noqa: B027
        """Examine the rows at a sample time."""

    def execute(self) -> None:
        """Advance to the end.

        Raises:
            SimulationError: if the integrator fails, the motion diverges, or the controller raises
                or does not return finite torques.
        """
        while self._runs_on():
            torque = self._command()
            self.times.append(self.time)
            self.commands.append(torque)
            self.hold(torque)
            self._look()

    def hold(self, torque: Any) -> None:
        """Command torques and advance to the next sample time, or to the end.

        Raises:
            SimulationError: if the integrator fails.
        """
        acting = self.acting
        acting.command(self.time, torque)
        self.tick += 1
        self.time = self.tick * self.sample_time
        now, end = self.now, self.end
        until = min(self.time, end)
        while now < until and now < end:
            acting.hold(now, None if acting.plain else self._rates())
            self._advance(now, acting.next_change(now, until))
            now, end = self.now, self.end

    def command_at(self, times: FloatArray) -> FloatArray:
        """Return the last commands (T, ..., joints) at times (T,)."""
        index = np.searchsorted(np.asarray(self.times), times * (1.0 + 1e-12), side="right") - 1
        commands: FloatArray = np.asarray(self.commands)[np.clip(index, 0, None)]
        return commands


class RunLoop(ControlLoop):
    """Loop of one run, with the hardware between arm and controller.

    Args:
        sample_time: s.
        keep: whether the applied torques are stored for ``acting.at``.

    Raises:
        InputError: if the hardware does not fit the arm or the sample time, or the run is hopeless.
    """

    def __init__(
        self, run: Run, sample_time: float, hardware: Hardware | None, keep: bool = True
    ) -> None:
        run.adopt(choose_by_samples(run.choice, run.arm, sample_time, run.duration))
        run.doubt = friction_doubt(run.integrator, run.arm, sample_time) or run.choice.doubt
        self.run, self.hardware = run, hardware
        self._sensing, self._sensed = sensing_of_run(run, hardware, sample_time), run.arm
        super().__init__(Acting(hardware, run.arm, keep), sample_time)
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
        return kept | {"_sensing": self._sensing.readings}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._sensing = self._sensing_with(state["_sensing"])
        self._system = self._new_system()

    def _sensing_with(self, readings: Sequence[Readings]) -> Sensing:
        """Return the sensors of the present arm, with their states between sample times."""
        self._sensed = self.run.arm
        return sensing_of_run(self.run, self.hardware, self.sample_time).recalled(readings)

    @property
    def end(self) -> float:
        """End of the run, s."""
        return self.run.duration

    @property
    def now(self) -> float:
        """Time that the run has reached, s."""
        return self.run.progress.time

    @property
    def instruments(self) -> Sequence[Readings]:
        """States of the instruments; empty for exact sensors."""
        return self._sensing.readings

    def measure(self) -> Measurement:
        """Return the readings of the sensors; call once at each sample time, in order."""
        if self._sensed is not self.run.arm:  # it has changed
            self._sensing = self._sensing_with(self._sensing.readings)
        state = self.run.progress.state
        return Measurement(**self._sensing.values(self.tick, state, self._system, self.time))

    def _command(self) -> FloatArray:
        raise NotImplementedError  # the commands come from outside

    def _rates(self) -> FloatArray:
        rates: FloatArray = self.run.progress.state[1, self._bodies, 0]
        return rates

    def _advance(self, now: float, until: float) -> None:
        drive = self._system.drive
        if self.acting.plain:
            drive.coefficients[0, 0, self._bodies] = self.acting.target
        else:
            drive.breaks[:], coefficients = self.acting.cubics(now, until)
            drive.coefficients[:, :, self._bodies] = coefficients
        self._system = self.run.carry_to(self._system, until)


class ClosedLoop(RunLoop):
    """Loop of one run with a controller.

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
        self.controller, self.reference = controller, reference
        self._reference = sampled_reference(reference, controller.sample_time, run.duration)
        super().__init__(run, controller.sample_time, hardware)
        self._runaway = RunawayWatch(run.arm)
        self._measured: list[Measurement] = []
        self.seconds = 0.0  # spent in the controller

    def execute(self) -> None:
        """See `ControlLoop.execute`."""
        self.controller.reset()
        super().execute()

    def execute_again(self, run: Run) -> None:
        """Execute the loop for another run, with a copy of the controller from its start.

        Raises:
            SimulationError: like ``execute``.
        """
        controller = deepcopy(self.controller)
        ClosedLoop(run, controller, self.reference, self.hardware).execute()

    def _look(self) -> None:
        run = self.run
        absurd = self._runaway(run.progress.state)
        if absurd:
            reason = f"{absurd}: the loop is unstable."
            hint = "Reduce the gains or the sample time, or design for this arm."
            raise SimulationError(self.time, reason, hint, run.state())
        if self.tick % 256 == 0:
            run.meter.update(run.progress.time / run.duration)

    def _command(self) -> FloatArray:
        measurement = self.measure()
        if self.hardware is not None:
            self._measured.append(measurement)
        return self._update(self.time, measurement)

    def _update(self, t: float, measurement: Measurement) -> FloatArray:
        """Return the torques (joints,) of the controller."""
        started = time.perf_counter()
        try:
            given = self.controller.update(t, measurement, self._reference)
        except Exception as error:
            reason = f"the controller failed with {type(error).__name__}: {error}"
            raise SimulationError(t, reason, "", self.run.state()) from error
        self.seconds += time.perf_counter() - started
        try:
            return check_array("torque", given, (self.run.arm.joints,))
        except InputError as error:
            reason = f"the controller returned an unusable value: {error.at('controller')}"
            raise SimulationError(t, reason, "", self.run.state()) from None

    def report(self) -> dict[str, float]:
        """Return the controller's own report on its run."""
        return report_of(self.controller)

    def readings(self) -> Mapping[str, FloatArray]:
        """Return the readings of the hardware's instruments by name: (samples, k)."""
        return readings_by_name(self._measured)
