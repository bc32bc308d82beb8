"""The loop of sensing, control and acting, tick by tick."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from flexarm.control import Controller, Hardware, Measurement, Reference
from flexarm.errors import InputError, SimulationError, check_array
from flexarm.integrate.base import FloatArray, System
from flexarm.simulate.acting import Acting
from flexarm.simulate.sampled_reference import sampled_reference
from flexarm.simulate.sensing import sensing_of
from flexarm.simulate.stepping import Run
from flexarm.simulate.torque_history import TorqueHistory


class ClosedLoop:
    """Sense, control, hold the torque, advance; again at the next sample time."""

    def __init__(
        self,
        run: Run,
        controller: Controller,
        reference: Reference | None,
        hardware: Hardware | None,
    ) -> None:
        self._run = run
        self._controller = controller
        self._reference = sampled_reference(reference, controller.sample_time, run.duration)
        self._bodies = run.arm.assembly.joint_body
        self._sensing = sensing_of(run, hardware, controller.sample_time)
        self._acting = Acting(hardware, run.arm.joints)
        self.hardware = hardware
        self.ticks: list[float] = []
        self.asked: list[FloatArray] = []
        self.measured: list[Measurement] = []
        self.seconds = 0.0  # spent in the controller

    def execute(self) -> None:
        """Simulate to the end.

        Raises:
            SimulationError: the integrator gave up, or the controller returned no finite torque.
        """
        run, acting = self._run, self._acting
        breaks = np.arange(acting.pieces + 1.0)
        held = np.zeros((acting.pieces, 4, run.arm.joints))
        system = run.system(TorqueHistory(breaks, held, np.zeros(0)))
        sample_time = self._controller.sample_time
        self._controller.reset()
        tick = 0
        while True:
            t = tick * sample_time
            # A last tick that is left over from rounding alone would hold no time.
            if t >= run.duration * (1.0 - 1e-12):
                return
            torque = self._update(tick, t, system)
            self.ticks.append(t)
            self.asked.append(torque)
            acting.ask(t, torque)
            tick += 1
            until = min(tick * sample_time, run.duration)
            while run.progress.time < min(until, run.duration):  # an event may end the run
                system = self._advance(system, until)
            if tick % 256 == 0:
                run.meter.update(run.progress.time / run.duration)

    def _advance(self, system: System, until: float) -> System:
        """Go on to ``until``, or to where another torque begins to act."""
        run, acting, now = self._run, self._acting, self._run.progress.time
        acting.hold(now, run.progress.state[1, self._bodies, 0])
        change = acting.next_change(now, until)
        drive = system.drive
        if acting.plain:
            drive.coefficients[0, 0, self._bodies] = acting.target
        else:
            drive.breaks[:], coefficients = acting.cubics(now, change)
            drive.coefficients[:, :, self._bodies] = coefficients
        return run.carry_to(system, change)

    def _update(self, tick: int, t: float, system: System) -> FloatArray:
        run = self._run
        measurement = self._sensing.measure(tick, t, run.progress.state, system)
        if self.hardware is not None:
            self.measured.append(measurement)
        started = time.perf_counter()
        try:
            given = self._controller.update(t, measurement, self._reference)
        except Exception as error:
            reason = f"the controller failed with {type(error).__name__}: {error}"
            raise SimulationError(t, reason, "", run.state()) from error
        self.seconds += time.perf_counter() - started
        try:
            return check_array("controller", "torque", given, (run.arm.joints,))
        except InputError as error:
            raise SimulationError(
                t, f"the controller's answer cannot be used: {error}", "", run.state()
            ) from None

    def torque_at(self, times: FloatArray) -> FloatArray:
        """Return the torque that acts at times (T,): (T, joints)."""
        return self._acting.at(times)

    def asked_at(self, times: FloatArray) -> FloatArray:
        """Return the torque that the controller asked for last at times (T,): (T, joints)."""
        index = np.searchsorted(np.asarray(self.ticks), times * (1.0 + 1e-12), side="right") - 1
        return np.asarray(self.asked)[np.clip(index, 0, None)]

    def readings(self) -> Mapping[str, FloatArray]:
        """Return what the hardware's instruments said at each sample time, by name: (ticks, k)."""
        names = self.measured[0] if self.measured else ()
        return {name: np.array([item[name] for item in self.measured]) for name in names}
