"""Time stepping of a run: its system, its advance in time, and its reaction forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.actions import EMPTY, Environment, loads_inboard
from flexarm.arm.arm import Arm
from flexarm.arm.stations import cuts_at
from flexarm.base.errors import FlexarmWarning, InputError, Problem, SimulationError
from flexarm.integrate.base import (
    Drive,
    FloatArray,
    Integrator,
    Progress,
    Status,
    System,
    Tolerance,
)
from flexarm.integrate.reactions import reactions_many, section_forces_many
from flexarm.kernels.compilation.cache import INTERPRETED, can_compile
from flexarm.kernels.layout import compile_time_sizes, new_workspace
from flexarm.simulation.histories.loads import LoadHistory, constants_with
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.changes import ROUNDING, ArmChanges, ChangedArm, evenly
from flexarm.simulation.run.contacts import contact_frequency, contacts_of_run
from flexarm.simulation.run.default_step import DefaultStep, default_step
from flexarm.simulation.run.events import Found, Watch
from flexarm.simulation.run.integrator_choice import Choice, friction_doubt
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import RunSettings
from flexarm.simulation.run.tolerance import for_arm

#: Channels of the three section forces, in the order of the kernels.
SECTION_CHANNELS = ("axial_force", "shear_force", "bending_moment")
#: Hints for failures that neither a smaller step nor other gains avoid.
_HINTS = {
    Status.PRESSED_THROUGH: "Increase the stiffness of the contact or the radius of the surface."
}
_HINT = (
    "Try integrator='auto', a smaller step or tighter rtol and atol, fewer elements or modes=k on "
    "the links; check torques, gains and damping signs."
)
#: Steps of one compiled call, times coordinates: some tenths of a second, for the progress bar and
#: Ctrl-C. It is a number and not a time, because joints with friction settle anew in each call, and
#: a result may not depend on the speed of the machine.
_CALL_WORK = 3e5
#: Compiling for one model size takes about ten seconds and saves a third of each step. It pays off
#: if this much work remains, which takes a minute on an idle machine. Work is counted in
#: evaluations of the dynamics times coordinates. The remaining work is extrapolated from the work
#: done, once that reaches the second number (some seconds), because the beginning of a run may be
#: its most difficult part. Large sizes gain little, because their loops are long.
_WORTH_COMPILING, _TRIED, _MOST_BODIES, _MOST_MODES = 5e8, 5e7, 8, 16
#: Limits on the remaining steps of a run and of a sample time (days of computing). A run that
#: exceeds both is unstable: its motion becomes faster and faster.
_MOST_STEPS, _MOST_STEPS_A_TICK = 1e9, 1e6
#: Samples whose reactions are computed at once, which bounds the scratch memory of long runs.
_CHUNK = 4096


#: Statuses that most calls return; attributes of an enumeration are slow.
_DONE, _PAUSED = Status.DONE, Status.PAUSED

#: Coordinates and rates, (dof,) each.
State = tuple[FloatArray, FloatArray]
#: Texts of warnings and their categories.
Notices = list[tuple[str, type[FlexarmWarning]]]


def section_channels(forces: FloatArray) -> dict[str, FloatArray]:
    """Return section forces (stations, samples, links, 3) by channel; empty without stations."""
    if not len(forces):
        return {}
    return {
        name: forces[..., part].transpose(1, 2, 0).copy()
        for part, name in enumerate(SECTION_CHANNELS)
    }


def failure_of(
    status: Status, time: float, state: State, reason: str = "", hint: str = ""
) -> SimulationError:
    """Return the error for a run that ended at a time and state (q, qd) for the given reason."""
    reason = reason or status.sentence
    return SimulationError(time, reason, hint or _HINTS.get(status, _HINT), state)


class Span(NamedTuple):
    """Part of a run between two changes of its arm."""

    arm: Arm
    loads: LoadHistory
    end: int  # number of samples up to the change
    until: float  # time of the change, s


def system_of(
    arm: Arm,
    prescribed: tuple[int, ...],
    loads: LoadHistory,
    history: PiecewiseCubic,
    specialized: bool | None = None,
) -> System:
    """Combine an arm, its loads and a torque history; the arguments are attributes of ``Run``."""
    constants = constants_with(arm, prescribed)
    coefficients = arm.padded_torque(history.coefficients)
    contacts = loads.placed.contacts
    drive = Drive(
        history.breaks,
        coefficients,
        loads.stops_with(history),
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
    if specialized and not INTERPRETED and not can_compile():
        hint = "pip install 'flexarm[jit]' brings it; without specialized, no run needs it."
        raise InputError(Problem("specialized", "needs Numba, which is not installed", hint=hint))
    sizes = compile_time_sizes(constants) if specialized else arm.assembly.sizes
    return System(sizes, constants, drive, new_workspace(constants))


def accelerations_at(
    arm: Arm, system: System, times: FloatArray, states: FloatArray, given: FloatArray
) -> FloatArray:
    """Compute the accelerations (T, n, 1 + m) of states at times; ``given`` as in `Run.reactions`.

    ``system``: of a run, whose torque does not count.
    """
    n, accelerations = arm.assembly.bodies, np.zeros((len(times), *states.shape[2:]))
    shapes = (n, 3), (n, 3), (n,), (arm.closure_rows + 1,)
    others = (np.zeros((len(times), *shape)) for shape in shapes)
    reactions_many(system, times, states, arm.padded_torque(given), accelerations, *others)
    return accelerations


@dataclass
class Run:
    """Arguments and current progress of one run.

    ``arm`` and ``loads`` are those of the present, after the last change of the arm.
    """

    arm: Arm
    choice: Choice
    integrator: Integrator
    tolerance: Tolerance
    progress: Progress
    duration: float
    horizon: float  # s: the duration or, if it is not limited, a time of its order
    sample_times: FloatArray
    samples: FloatArray
    loads: LoadHistory
    meter: Meter
    settings: RunSettings
    prescribed: tuple[int, ...] = ()  # joints, from 1, whose motion is prescribed
    specialized: bool | None = None  # compile for this model size; None decides by remaining work
    watch: Watch | None = None  # search for events
    history: PiecewiseCubic | None = None  # of a run without a controller
    loads_of: Callable[[float], LoadHistory] | None = None  # loads for another relative tolerance
    discarded: int = 0  # evaluations that are not part of the result
    doubt: str = ""  # warning that the result may be less accurate than the defaults promise
    notices: Notices = field(default_factory=list)  # warnings of the result
    default_step: DefaultStep | None = None  # search for the step of a fixed-step method
    request: float | None = None  # error over the reach; None if tolerances are given
    error: float | None = None  # its estimate, if a second run verified large tolerances
    max_steps: int = 64
    changes: ArmChanges | None = None  # of the arm during the run
    environment: Environment = EMPTY  # source of ``loads``
    spans: list[Span] = field(default_factory=list)  # before the last change of the arm

    def system(self, history: PiecewiseCubic) -> System:
        """Combine the arm, its loads and a torque history into the system to integrate."""
        return system_of(self.arm, self.prescribed, self.loads, history, self.specialized)

    def adopt(self, choice: Choice) -> None:
        """Use another integrator."""
        self.choice, self.integrator = choice, choice.integrator
        if self.watch is not None:
            tolerance = self.tolerance
            self.watch = replace(self.watch, integrator=self.integrator, tolerance=tolerance)

    def accelerations(self, given: FloatArray) -> FloatArray:
        """Compute the accelerations (T, n, 1 + m) at the samples; ``given`` as in `reactions`."""
        system = self.system(PiecewiseCubic.constant(np.zeros(self.arm.n_joints)))
        return accelerations_at(self.arm, system, self.sample_times, self.samples, given)

    def reactions(
        self, times: FloatArray, angle: FloatArray, given: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Compute motor torques, joint reactions and section forces at the samples.

        Args:
            times: (T,) sample times, s.
            angle: (T, links) absolute angles of the links at their roots, rad.
            given: (T, joints) torques, or accelerations of prescribed joints.

        Returns:
            Motor torques (T, joints), joint forces (T, links, 2) in world axes, joint moments
            (T, links), section forces (stations, T, links, 3), and forces of closures (T, rows + 1)
            with their independence in the last column.
        """
        arm, states = self.arm, self.samples[: len(times)]
        n = arm.assembly.bodies
        system = self.system(PiecewiseCubic.constant(np.zeros(arm.n_joints)))
        wrench, motor = np.zeros((len(times), n, 3)), np.zeros((len(times), n))
        torques, closing = arm.padded_torque(given), np.zeros((len(times), arm.closure_rows + 1))
        cuts = cuts_at(arm, self.settings.stations) if self.settings.stations else []
        sections = []  # the arm cut at one station of each link, with the loads inboard of these
        for cut in cuts:
            inboard = loads_inboard(arm, self.loads.owners, self.loads.placed, cut.reach)
            drive = system.drive._replace(loads=inboard)
            sections.append(System(cut.sizes, cut.constants, drive, system.work))
        inside = np.zeros((len(cuts), len(times), arm.n_links, 3))
        for start in range(0, len(times), _CHUNK):
            part = slice(start, start + _CHUNK)
            now = times[part], states[part]
            motion = np.zeros((len(now[0]), *states.shape[2:])), np.zeros((len(now[0]), n, 3))
            reactions_many(
                system, *now, torques[part], *motion, wrench[part], motor[part], closing[part]
            )
            for section, cut, forces in zip(sections, cuts, inside[:, part], strict=True):
                section_forces_many(section, cut.stations, *now, *motion, wrench[part], forces)
        bodies = arm.assembly.link_root
        cosine, sine = np.cos(angle), np.sin(angle)
        x, y = wrench[:, bodies, 0], wrench[:, bodies, 1]
        force = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=2)
        # Return a given torque exactly, without the rounding of the inverse dynamics.
        torque = np.array(given)
        if self.prescribed:
            torque = np.where(self._moved(), motor[:, arm.assembly.joint_body], given)
        return torque, force, wrench[:, bodies, 2], inside, closing

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
        if work < _TRIED or ahead < _WORTH_COMPILING or not can_compile():
            return system
        self.specialized = True
        return system._replace(sizes=compile_time_sizes(system.constants))

    def carry_to(self, system: System, until: float) -> System:
        """Advance to a time and return the system for the next call.

        Raises:
            SimulationError: if the integrator fails before ``until``.
        """
        changes = self.changes
        if changes is None:
            return self._carried(system, until)
        while True:
            if self.progress.time >= min(until, self.duration):  # an event may end the run
                return system
            if changes.due(self.progress.time):
                system = self._changed(system, changes)
                continue  # an event in the jump may end the run or change the arm again
            begins = changes.next_time < until * (1.0 - ROUNDING)
            system = self._carried(system, changes.next_time if begins else until)

    def _changed(self, system: System, changes: ArmChanges) -> System:
        """Make the changes of the arm that are due; return the system after them.

        The integrator starts again, because the motion is not smooth there.
        """
        progress, before = self.progress, self.arm
        free = np.setdiff1d(np.arange(before.dof), before.joint_index[self._moved()])
        old = progress.state.copy()
        self.arm, state = changes.apply(progress.time, old, free)
        if self.arm is before:
            return system
        if self.arm.assembly.has_sticking and not self.integrator.follows_sticking:
            name = self.integrator.name
            reason = f"friction holds a joint from here on, which {name} does not support."
            hint = "Use integrator='auto', or friction that creeps: smoothing_rate=0.01."
            raise self.failure(Status.DIVERGED, reason, hint)
        now = np.searchsorted(self.sample_times, progress.time * (1.0 + ROUNDING), side="right")
        self.samples[progress.sample : now] = old  # samples at this time are before the change
        progress.sample = max(progress.sample, int(now))
        self.spans.append(Span(before, self.loads, progress.sample, progress.time))
        progress.state[...] = state
        progress.memory = progress.method = progress.entry = None
        touching = contacts_of_run(self.arm, self.environment.contacts, state)
        self.loads = replace(self.loads, placed=self.loads.placed._replace(contacts=touching))
        tolerance = for_arm(self.tolerance, self.arm, state, self.horizon)
        fastest = max(tolerance.fastest, contact_frequency(self.arm, touching))
        self.tolerance = tolerance._replace(fastest=fastest)
        if self.default_step is not None:
            self.default_step = default_step(self.integrator, self.tolerance)
        self.doubt = self.doubt or friction_doubt(self.integrator, self.arm, np.inf)
        if self.watch is not None:
            self._handle_jump(self.watch, old)
        constants, drive = constants_with(self.arm, self.prescribed), system.drive
        contacts = touching._replace(seen=touching.seen.copy())
        drive = drive._replace(loads=drive.loads._replace(contacts=contacts))
        return System(system.sizes, constants, drive, new_workspace(constants))

    def _handle_jump(self, watch: Watch, before: FloatArray) -> None:
        """Handle the events in the jump from a state ``before`` to that of the present."""
        assert self.changes is not None
        for event in watch.jump(before, self.progress, self.tolerance):
            name = watch.log.names[event.place]
            if watch.log.events[event.place].terminal:
                self._end_at(event)
                self.spans[-1] = self.spans[-1]._replace(end=self.progress.sample - 1)
            elif name in watch.log.triggers:
                watch.log.triggers.discard(name)
                self.changes.trigger(name, event.time)

    def begin_again(self) -> None:
        """Return to the arm at the start of the run, for another pass."""
        if self.changes is not None:
            self.changes.reset()
            self.arm = self.changes.first
            self.loads = self.spans[0].loads if self.spans else self.loads
            self.spans = []
            if self.watch is not None:
                self.watch.log.triggers = set(self.changes.waiting)

    def parts(self) -> list[tuple[slice, Run]]:
        """Return the samples of each span, and a run of its arm with these samples only."""
        lengths = {self.progress.sample, len(self.sample_times), len(self.samples)}
        if not self.spans and len(lengths) == 1:
            return [(slice(0, self.progress.sample), self)]
        last = Span(self.arm, self.loads, self.progress.sample, self.progress.time)
        runs, begin = [], 0
        for span in [*self.spans, last]:
            part = slice(begin, max(span.end, begin))
            count = part.stop - part.start
            progress = replace(self.progress, sample=count)
            run = replace(self, arm=span.arm, loads=span.loads, progress=progress, spans=[])
            run.sample_times, run.samples = self.sample_times[part], self.samples[part]
            runs.append((part, run))
            begin = part.stop
        return [one for one in runs if one[0].stop > one[0].start] or runs[:1]

    def changed_arms(self) -> list[ChangedArm]:
        """Return the arms after the changes that have happened; only a few of very many."""
        if not self.spans:
            return []
        ends = [*(span.until for span in self.spans), self.duration]
        arms = [*(span.arm for span in self.spans[1:]), self.arm]
        kept = evenly(list(zip(arms, ends[:-1], ends[1:], strict=False)))
        begins = [begin for _, begin, _ in kept[1:]] + ends[-1:]
        words = "after the change of the arm at t = {:g} s"
        return [
            ChangedArm(arm, begin, until, words.format(begin))
            for (arm, begin, _), until in zip(kept, begins, strict=True)
        ]

    @property
    def first_arm(self) -> Arm:
        """The arm at the start of the run."""
        return self.arm if self.changes is None else self.changes.first

    def _carried(self, system: System, until: float) -> System:
        """Advance to a time up to which the arm does not change, or to an event."""
        if self.default_step is not None:
            return self.default_step.carry(self, system, until)
        while True:
            progress = self.progress
            system, status = self.advance(system, progress, until, self.sample_times, self.samples)
            if self.watch is not None and self.ended_by_event(system, status):
                return system
            if status is _DONE:
                return system
            if status is not _PAUSED:
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
        target = until, sample_times, samples, self.max_steps
        status = self.integrator.advance(system, self.tolerance, progress, *target)
        if status is not _PAUSED:
            return system, status
        if self.max_steps * progress.state.size < 2.0 * _CALL_WORK:
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

        The event that ends the run becomes its last sample. If an event function fails, samples
        after that are dropped.
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
        name = self.watch.log.names[event.place]
        if not self.watch.log.events[event.place].terminal:
            return self._stopped_for_change(name, event)
        self._end_at(event)
        return True

    def _end_at(self, event: Found) -> None:
        """End the run at an event, which becomes the last sample."""
        progress = self.progress
        keep = int(np.searchsorted(self.sample_times, event.time))
        self.sample_times = np.append(self.sample_times[:keep], event.time)
        if keep == len(self.samples):  # the event lies after the last sample
            self.samples = np.concatenate([self.samples, event.state[None]])
        self.samples[keep] = event.state
        progress.state[...] = event.state
        self.duration = progress.time = event.time
        progress.sample = keep + 1

    def _stopped_for_change(self, name: str, event: Found) -> bool:
        """Return to an event at which the arm changes; the run goes on from there."""
        assert self.changes is not None
        assert self.watch is not None
        progress = self.progress
        progress.state[...] = event.state
        progress.time = event.time
        progress.sample = int(np.searchsorted(self.sample_times, event.time))
        progress.memory = progress.method = progress.entry = None
        self.watch.log.triggers.discard(name)
        self.watch.go_on(progress, self.tolerance)
        self.changes.trigger(name, event.time)
        return True

    def failure(self, status: Status, reason: str = "", hint: str = "") -> SimulationError:
        """Return the error for a run that ended with a status or for the given reason."""
        return failure_of(status, self.progress.time, self.state(), reason, hint)

    def state(self) -> State:
        """Return the last valid state (q, qd)."""
        state = self.arm.unpadded(self.progress.state)
        return state[0], state[1]
