"""Time stepping of a run: its system, its advance in time, and its reaction forces."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexarm.arm import Arm
from flexarm.assembly.kernel_view import KernelView
from flexarm.engine.default_step import DefaultStep
from flexarm.engine.event_search import Watch
from flexarm.engine.integrator_choice import Choice, choose_by_drive
from flexarm.engine.progress import Meter
from flexarm.engine.section_forces import cut_systems, fill_sections
from flexarm.errors import SimulationError
from flexarm.histories.loads import LoadHistory
from flexarm.histories.piecewise import PiecewiseCubic
from flexarm.integrate.base import (
    Drive,
    FloatArray,
    Integrator,
    Progress,
    Status,
    System,
    Tolerance,
)
from flexarm.integrate.reactions import reactions_many
from flexarm.kernels.columns import FREE
from flexarm.kernels.layout import ArmConstants, compile_time_sizes

#: Duration (s) of one compiled call: short enough for the progress bar and Ctrl-C.
_CALL_SECONDS = 0.1
#: Compiling for one model size takes about ten seconds and saves a third of each step. It pays off
#: if this much work remains, which takes a minute on an idle machine. Work is counted in
#: evaluations of the dynamics times coordinates. The remaining work is extrapolated from the work
#: done, once that reaches the second number (some seconds), because the beginning of a run may be
#: its most difficult part. Large sizes gain little, because their loops are long.
_WORTH_COMPILING, _TRIED, _MOST_BODIES, _MOST_MODES = 5e8, 5e7, 8, 16
#: Limits on the remaining steps of a run and of a sample time (days of computing). A run that
#: exceeds both is unstable: its motion becomes faster and faster.
_MOST_STEPS, _MOST_STEPS_A_TICK = 1e9, 1e6
#: Hints for failures that neither a smaller step nor other gains avoid.
_HINTS = {
    Status.PRESSED_THROUGH: "Increase the stiffness of the contact or the radius of the surface.",
}
#: Samples whose reactions are computed at once, which bounds the scratch memory of long runs.
_CHUNK = 4096


@dataclass
class Run:
    """Arguments and current progress of one run."""

    arm: Arm
    choice: Choice
    integrator: Integrator
    tolerance: Tolerance
    progress: Progress
    duration: float
    sample_times: FloatArray
    samples: FloatArray
    loads: LoadHistory
    meter: Meter
    prescribed: tuple[int, ...] = ()  # joints, from 1, whose motion is prescribed
    stations: int = 0  # on each link, for section forces
    specialized: bool | None = None  # compile for this model size; None decides by remaining work
    watch: Watch | None = None  # search for events
    history: PiecewiseCubic | None = None  # of a run without a controller
    loads_of: Callable[[float], LoadHistory] | None = None  # loads for another relative tolerance
    discarded: int = 0  # evaluations that are not part of the result
    doubt: str = ""  # warning that the result may be less accurate than the defaults promise
    default_step: DefaultStep | None = None  # search for the step of a fixed-step method
    max_steps: int = 64

    def system(self, history: PiecewiseCubic) -> System:
        """Combine the arm, its loads and a torque history into the system to integrate."""
        constants = self._constants()
        coefficients = self.arm.padded_torque(history.coefficients)
        loads, contacts = self.loads, self.loads.placed.contacts
        stops = history.stops
        if stops.size or loads.factors.stops.size:
            stops = np.unique(np.concatenate([stops, loads.factors.stops]))
        drive = Drive(
            history.breaks,
            coefficients,
            stops,
            # The kernels overwrite these values as time goes on, so each system has its own copy.
            loads.placed._replace(
                value=loads.placed.value.copy(),
                base_acceleration=loads.placed.base_acceleration.copy(),
                contacts=contacts._replace(seen=contacts.seen.copy()),
            ),
            loads.placed.value,
            loads.factors.breaks,
            loads.factors.coefficients,
        )
        kernels = KernelView(constants)
        sizes = compile_time_sizes(constants) if self.specialized else kernels.sizes
        return System(sizes, constants, drive, kernels.work)

    def _constants(self) -> ArmConstants:
        """Return the constants of the arm, with prescribed joints marked as not free."""
        constants = self.arm.assembly.constants
        if not self.prescribed:
            return constants
        body = constants.body.copy()
        body[self.arm.assembly.joint_body[self._moved()], FREE] = 0.0
        return constants._replace(body=body)

    def reactions(
        self, times: FloatArray, angle: FloatArray, given: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Compute motor torques, joint reactions and section forces at the samples.

        Args:
            times: (T,) sample times, s.
            angle: (T, links) absolute angles of the links at their roots, rad.
            given: (T, joints) torques, or accelerations of prescribed joints.

        Returns:
            Motor torques (T, joints), joint forces (T, links, 2) in world axes, joint moments
            (T, links) and section forces (stations, T, links, 3).
        """
        arm, states = self.arm, self.samples[: len(times)]
        n = arm.assembly.bodies
        system = self.system(PiecewiseCubic.constant(np.zeros(arm.joints)))
        wrench, motor = np.zeros((len(times), n, 3)), np.zeros((len(times), n))
        torques = arm.padded_torque(given)
        cuts = cut_systems(arm, system, self.loads, self.stations)
        inside = np.zeros((len(cuts), len(times), arm.links, 3))
        for start in range(0, len(times), _CHUNK):
            part = slice(start, start + _CHUNK)
            now = times[part], states[part]
            motion = np.zeros((len(now[0]), *states.shape[2:])), np.zeros((len(now[0]), n, 3))
            reactions_many(system, *now, torques[part], *motion, wrench[part], motor[part])
            fill_sections(cuts, *now, *motion, wrench[part], inside[:, part])
        bodies = arm.assembly.link_body
        cosine, sine = np.cos(angle), np.sin(angle)
        x, y = wrench[:, bodies, 0], wrench[:, bodies, 1]
        force = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=2)
        # Return a given torque exactly, without the rounding of the inverse dynamics.
        torque = np.array(given)
        if self.prescribed:
            torque = np.where(self._moved(), motor[:, arm.assembly.joint_body], given)
        return torque, force, wrench[:, bodies, 2], inside

    def _moved(self) -> NDArray[np.bool_]:
        """Return which of the movable joints have a prescribed motion, (joints,)."""
        return np.isin(self.arm.joint_numbers, self.prescribed)

    def _specialize(self, system: System, progress: Progress) -> System:
        """Switch a long run to code compiled for its model size; the state does not change."""
        n, m = system.constants.S.shape
        if self.specialized is not None or n > _MOST_BODIES or m > _MOST_MODES:
            return system
        # Count work and not time, because the time depends on the load of the machine.
        work = progress.evaluations * n * (1 + m)
        ahead = work * (self.duration / max(progress.time, 1e-9 * self.duration) - 1.0)
        if work < _TRIED or ahead < _WORTH_COMPILING:
            return system
        self.specialized = True
        return system._replace(sizes=compile_time_sizes(system.constants))

    def carry_to(self, system: System, until: float) -> System:
        """Advance to a time and return the system for the next call.

        Raises:
            SimulationError: if the integrator fails before ``until``.
        """
        if self.default_step is not None:
            return self.default_step.carry(self, system, until)
        while True:
            progress = self.progress
            system, status = self.advance(system, progress, until, self.sample_times, self.samples)
            if self.ended_by_event(system, status) or status == Status.DONE:
                return system
            if status != Status.PAUSED:
                raise self.failure(status)

    def advance(
        self,
        system: System,
        progress: Progress,
        until: float,
        sample_times: FloatArray,
        samples: FloatArray,
    ) -> tuple[System, Status]:
        """Make some steps towards a time; return the system for the next call and the status.

        Raises:
            SimulationError: if the step has become too short to reach the time.
        """
        started = time.perf_counter()
        status = self.integrator.advance(
            system, self.tolerance, progress, until, sample_times, samples, self.max_steps
        )
        if status != Status.PAUSED:
            return system, status
        if time.perf_counter() - started < _CALL_SECONDS:
            self.max_steps *= 2
        self.meter.update(progress.time / self.duration)
        ahead = (until - progress.time) / progress.step
        share = max(until - progress.time, 0.0) / self.duration
        if ahead > max(_MOST_STEPS * share, _MOST_STEPS_A_TICK):
            reason = (
                f"the step has shrunk to {progress.step:.2g} s, and t = {until:.6g} s is "
                f"{ahead:.1g} such steps away: the motion grows without bound."
            )
            raise self.failure(status, reason)
        return self._specialize(system, progress), status

    def ended_by_event(self, system: System, status: Status) -> bool:
        """Search the computed samples for events; return whether one ended the run.

        The event that ends the run becomes its last sample.

        Raises:
            SimulationError: if an event function fails; samples after the failure are dropped.
        """
        if self.watch is None:
            return False
        progress = self.progress
        try:
            event = self.watch.look(system, progress, self.sample_times, self.samples, status)
        except SimulationError as error:
            done = self.sample_times[: progress.sample]
            progress.sample = int(np.searchsorted(done, error.time, side="right"))
            raise
        if event is None:
            return False
        keep = int(np.searchsorted(self.sample_times, event.time))
        self.sample_times = np.append(self.sample_times[:keep], event.time)
        if keep == len(self.samples):  # the event lies after the last sample
            self.samples = np.concatenate([self.samples, event.state[None]])
        self.samples[keep] = event.state
        progress.state[...] = event.state
        self.duration = progress.time = event.time
        progress.sample = keep + 1
        return True

    def failure(self, status: Status, reason: str = "", hint: str = "") -> SimulationError:
        """Return the error for a run that ended with a status or for the given reason."""
        return failure_of(status, self.progress.time, self.state(), reason, hint)

    def state(self) -> tuple[FloatArray, FloatArray]:
        """Return the last valid state (q, qd)."""
        state = self.arm.unpadded(self.progress.state)
        return state[0], state[1]


def failure_of(
    status: Status,
    time: float,
    state: tuple[FloatArray, FloatArray],
    reason: str = "",
    hint: str = "",
) -> SimulationError:
    """Return the error for a run that ended at a time and state (q, qd) for the given reason."""
    reason = reason or status.sentence
    hint = (
        hint
        or _HINTS.get(status)
        or (
            "Try integrator='auto', a smaller step or tighter rtol and atol, fewer elements or "
            "modes=k on the links; check torques, gains and damping signs."
        )
    )
    return SimulationError(time, reason, hint, state)


def run_open_loop(run: Run, history: PiecewiseCubic) -> None:
    """Simulate a run under a given torque history."""
    run.history = history
    stops = np.concatenate([history.stops, run.loads.factors.stops])
    choice = choose_by_drive(run.choice, run.arm, run.tolerance, stops, run.duration)
    if choice is not run.choice:
        run.choice, run.integrator, run.doubt = choice, choice.integrator, choice.doubt
        if run.watch is not None:
            run.watch = replace(run.watch, integrator=choice.integrator)
    run.carry_to(run.system(history), run.duration)
