"""Sampled control loops: sense, update, hold, advance; of one run, or of rows side by side."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import as_slice, is_plain
from flexarm.base.errors import InputError, Problem, SimulationError, check_array, raise_any, shown
from flexarm.base.processes import single_threaded_algebra
from flexarm.control.contract.base import (
    Controller,
    Reference,
    report_of,
    requirements_of,
    update_of,
)
from flexarm.control.hardware.measurement import (
    Measurement,
    Readings,
    stride_and_delay,
)
from flexarm.integrate.base import FloatArray, Status, System
from flexarm.integrate.sampled_law import BENT, REFUSED, SampledLaw
from flexarm.model import Hardware
from flexarm.model.hardware import channel_faults
from flexarm.model.wording import nearest
from flexarm.motion import Motion
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.loop.devices import (
    Acting,
    Sensing,
    knowing_limits,
    measured_names,
    sensing_of_run,
)
from flexarm.simulation.loop.programmed_samples import (
    ProgrammedSamples,
    first_sample,
    programmed_samples,
)
from flexarm.simulation.run.integrator_choice import friction_doubt
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.validity import RunawayWatch
from flexarm.simulation.run.work import choose_by_samples

_LONGEST = 1e8  # limit on the sample times of a run, given by the memory
#: Methods of a reference that are tabulated: the motion of the joints, and others.
_OF_JOINTS = ("joint_angle", "joint_rate", "joint_acceleration")
_MORE = ("contact_force", "holding_torque", "normal", "pressing_torque", "tip")


def _looked_up(name: str) -> Callable[[Any, ArrayLike], FloatArray]:
    def look_up(self: SampledReference, t: Any) -> Any:
        if type(t) is float:  # the most common case, at every sample time
            k = round(t / self._sample_time)
            if 0 <= k < self._count and k * self._sample_time == t and name in self._tables:
                return self._tables[name][k]
        return self._look_up(name, t)

    return look_up


class SampledReference:
    """Reference that is evaluated for all sample times in one call.

    One call of a motion for a thousand times is a thousand times as fast as a thousand calls, and
    controllers evaluate the reference at every sample time. For other times, and for methods
    that are not tabulated, the reference itself is called.
    """

    vectorized = True
    joint_angle, joint_rate, joint_acceleration = map(_looked_up, _OF_JOINTS)

    def __init__(self, reference: Any, sample_time: float, duration: float) -> None:
        self._reference = reference
        self._sample_time = sample_time
        if not duration / sample_time <= _LONGEST:
            rule = f"be at least {duration / _LONGEST:.3g} s for a duration of {duration:.6g} s"
            raise InputError(Problem("controller.sample_time", rule, shown(sample_time)))
        self._schedule = np.arange(int(np.ceil(duration / sample_time)) + 1) * sample_time
        self._count = len(self._schedule)
        self._tables: dict[str, FloatArray] = {}
        if isinstance(reference, Motion):
            self._tables = dict(zip(_OF_JOINTS, reference.state(self._schedule), strict=True))

    def _look_up(self, name: str, t: ArrayLike) -> Any:
        # Only times that equal a sample time exactly have the tabulated value.
        if isinstance(t, float) or np.ndim(t) == 0:
            k = round(float(t) / self._sample_time)  # type: ignore[arg-type]
            if 0 <= k < self._count and k * self._sample_time == t:
                table = self._tables.get(name)
                if table is None:
                    table = np.asarray(getattr(self._reference, name)(self._schedule))
                    self._tables[name] = table
                return table[k]
        elif name in self._tables:
            times = np.asarray(t, dtype=np.float64)
            samples = np.rint(times / self._sample_time)
            inside = (samples >= 0.0) & (samples < self._count)
            if np.all(inside & (samples * self._sample_time == times)):
                return self._tables[name][samples.astype(np.intp)]
        return getattr(self._reference, name)(t)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # copies and pickles look these up before `_reference` is set
            raise AttributeError(name)
        if name in _MORE and hasattr(self._reference, name):
            return lambda t: self._look_up(name, t)
        return getattr(self._reference, name)


def sampled_reference(
    reference: Reference | None, sample_time: float, duration: float
) -> Reference | None:
    """Tabulate a vectorized reference at the sample times; return any other one unchanged."""
    if getattr(reference, "vectorized", False):
        return SampledReference(reference, sample_time, duration)
    return reference


def misfits(
    controller: Controller,
    arm: Arm,
    reference: Reference | None,
    hardware: Hardware | None,
    contacts: int,
    called: str = "",
) -> list[Problem]:
    """Return the requirements of a controller that are not met, one problem each."""
    requirements = requirements_of(controller, arm, reference)
    called = called or type(controller).__name__
    if requirements.joints not in (None, arm.n_joints):
        own = f"{requirements.joints} joint{'s' * (requirements.joints != 1)}"
        return [Problem("controller", f"is for {own}, but the arm has {arm.n_joints}")]
    there = measured_names(arm, hardware, contacts)

    def missing(name: str) -> Problem:
        """Return the problem of a missing measurement, with a hint on its source."""
        if name == "contact_force" and not contacts:
            return Problem("contacts", f"are missing: {called} measures {name}")
        if name == "strain" and not arm.gauges:
            return Problem("arm", f"has no gauges, but {called} reads {name}")
        hint = nearest(name, there)
        if name == "joint_rate" and "joint_angle" in there:
            hint = "An instrument of joint_angle with a rate_cutoff also measures it."
        rule = f"has no instrument for {name}, which {called} reads"
        if hardware is not None and hardware.instruments is not None:
            rule += f"; it measures {', '.join(there) or 'nothing'}"
        return Problem("hardware", rule, hint=hint)

    problems = []
    count = len(arm.gauges)
    if count and "strain" in requirements.measured and requirements.gauges not in (None, count):
        gauges = f"{requirements.gauges} gauge{'s' * (requirements.gauges != 1)}"
        problems.append(Problem("arm", f"have the {gauges} that {called} reads", str(count)))
    for name in requirements.measured:
        if name not in there and not (name == "strain" and problems):
            problems.append(missing(name))
    problems += [one.problem() for one in channel_faults(arm.spec, hardware, contacts)]
    for k, item in enumerate((hardware and hardware.instruments) or ()):
        try:
            stride_and_delay(item, controller.sample_time)
        except InputError as error:
            name = f"hardware.instruments[{k}].sample_time"
            problems += [replace(problem, name=name) for problem in error.problems]
    return problems


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

    def runs_on(self, t: Any) -> Any:
        """Return whether there is a sample at a time, or at each of several times, s."""
        # Skip a last sample time that lies before the end by rounding alone.
        return t < self.end * (1.0 - 1e-12)

    def _runs_on(self) -> bool:
        return bool(self.runs_on(self.time))

    def _look(self) -> None:  # noqa: B027
        """Examine the rows at a sample time."""

    def execute(self) -> None:
        """Advance to the end."""
        while self._runs_on():
            torque = self._command()
            self.times.append(self.time)
            self.commands.append(torque)
            self.hold(torque)
            self._look()
            self._skip()

    def _skip(self) -> None:  # noqa: B027
        """Advance by samples that need no ``_command``, if there are any."""

    def hold(self, torque: Any) -> None:
        """Command torques and advance to the next sample time, or to the end."""
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
        return np.asarray(np.asarray(self.commands)[np.clip(index, 0, None)])


class RunLoop(ControlLoop):
    """Loop of one run with its hardware; ``keep``: store the applied torques for ``acting.at``."""

    def __init__(
        self, run: Run, sample_time: float, hardware: Hardware | None, keep: bool = True
    ) -> None:
        rough = run.changes is not None or run.loads.placed.contacts.body.size > 0
        times = sample_time, run.duration
        run.adopt(choose_by_samples(run.choice, run.arm, *times, run.tolerance, rough))
        run.doubt = friction_doubt(run.integrator, run.arm, sample_time) or run.choice.doubt
        self.run, self.hardware = run, hardware
        self._sensing, self._sensed = sensing_of_run(run, hardware, sample_time), run.arm
        super().__init__(Acting(hardware, run.arm, keep), sample_time)
        self._bodies = as_slice(run.arm.assembly.joint_body)
        self._system = self._new_system()

    def _new_system(self) -> System:
        breaks = np.arange(self.acting.pieces + 1.0)
        held = np.zeros((self.acting.pieces, 4, self.run.arm.n_joints))
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
        return np.asarray(self.run.progress.state[1, self._bodies, 0])

    def _advance(self, now: float, until: float) -> None:
        drive = self._system.drive
        if self.acting.plain:
            drive.coefficients[0, 0, self._bodies] = self.acting.target
        else:
            drive.breaks[:], coefficients = self.acting.cubics(now, until)
            drive.coefficients[:, :, self._bodies] = coefficients
        self._system = self.run.carry_to(self._system, until)


class ClosedLoop(RunLoop):
    """Loop of one run with a controller."""

    _is_programmed = True  # whether laws may run as programs, without ``_command``

    def __init__(
        self,
        run: Run,
        controller: Controller,
        reference: Reference | None,
        hardware: Hardware | None,
    ) -> None:
        contacts = run.loads.placed.contacts.body.size
        problems = misfits(controller, run.arm, reference, hardware, contacts)
        raise_any(problems)
        self.controller, self.reference = controller, reference
        self._reference = sampled_reference(reference, controller.sample_time, run.duration)
        super().__init__(run, controller.sample_time, hardware)
        self._runaway, self._torque_of = RunawayWatch(run.arm), update_of(controller)
        self._measured: list[Mapping[str, FloatArray]] = []  # (samples, ...) by name
        self._first_programmed = first_sample(self) if self._is_programmed else None
        self._programmed: ProgrammedSamples | None = None
        self.seconds = 0.0  # spent in the controller

    def execute(self) -> None:
        limits = knowing_limits(self.controller, self.hardware, self.run.arm.n_joints)
        with single_threaded_algebra(), limits:
            self.controller.reset()
            super().execute()

    @property
    def sampled_reference(self) -> Reference | None:
        """The reference, tabulated at the sample times if possible."""
        return self._reference

    def _skip(self) -> None:
        if self.tick == self._first_programmed:
            self._programmed = programmed_samples(self, self._runaway.surely_small)
        while self._programmed is not None and self._runs_on():
            status, end = self._programmed.advance()
            if status is Status.PAUSED:  # many steps within a sample
                self.run.max_steps *= 2
                self._system = self.run.carry_to(self._system, min(self.time, self.end))
                self._look()
            elif status is not Status.DONE:
                raise self.run.failure(status)
            elif end == BENT:
                self._look()
            elif end == REFUSED:
                if len(self.times) < self._programmed.planned_to:
                    self._checked(self.time, self._programmed.torque)  # it is not finite
                return

    def repetition(self) -> Callable[[Run], None]:
        """Return a function that executes the loop for another run, with the controller of now."""
        controller = deepcopy(self.controller)

        def execute(run: Run) -> None:
            ClosedLoop(run, controller, self.reference, self.hardware).execute()

        return execute

    def advance_samples(self, kernel: Callable[..., int], law: SampledLaw) -> Status:
        """Advance by a loop of ``integrate.sampled_law``."""
        run, progress = self.run, self.run.progress
        assert progress.memory is not None
        arguments = self._system, run.tolerance, progress.memory, self.end, run.max_steps
        status = progress.enter(kernel, *arguments, law)
        run.meter.update(progress.time / run.duration)
        return status

    def add_samples(
        self,
        commands: FloatArray,
        readings: Mapping[str, FloatArray],
        torques: Sequence[FloatArray],
    ) -> None:
        """Note samples from the present one on, (samples, ...) each; see `Acting.add_holds`."""
        times = np.asarray((self.tick + np.arange(len(commands))) * self.sample_time)
        self.times += times.tolist()
        self.commands += list(commands)
        self.acting.add_holds(times, *torques)
        self._measured.append(readings)
        self.tick += len(commands)
        self.time = self.tick * self.sample_time

    def signals(self) -> Mapping[str, FloatArray]:
        """Return what exact sensors read at the present sample time."""
        sensors, state = sensing_of_run(self.run, None, self.sample_time), self.run.progress.state
        return sensors.values(self.tick, state, self._system, self.time)

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
            self._measured.append({name: value[None] for name, value in measurement.items()})
        return self._update(self.time, measurement)

    def _update(self, t: float, measurement: Measurement) -> FloatArray:
        """Return the torques (joints,) of the controller."""
        started = time.perf_counter()
        try:
            given = self._torque_of(t, measurement, self._reference)
        except Exception as error:
            reason = f"the controller failed with {type(error).__name__}: {error}"
            raise SimulationError(t, reason, "", self.run.state()) from error
        self.seconds += time.perf_counter() - started
        return self._checked(t, given)

    def _checked(self, t: float, given: Any) -> FloatArray:
        """Return torques (joints,) of the controller at t; SimulationError if it cannot be."""
        shape = (self.run.arm.n_joints,)
        if is_plain(given, shape) and all(map(math.isfinite, given.tolist())):
            return np.array(given)  # the controller may change its own later
        try:
            return check_array("torque", given, shape)
        except InputError as error:
            reason = f"the controller returned an unusable value: {error.at('controller')}"
            raise SimulationError(t, reason, "", self.run.state()) from None

    def report(self) -> dict[str, float]:
        """Return the controller's own report on its run."""
        return report_of(self.controller)

    def readings(self) -> Mapping[str, FloatArray]:
        """Return the readings of the hardware's instruments by name: (samples, k)."""
        names = self._measured[0] if self._measured else ()
        return {name: np.concatenate([part[name] for part in self._measured]) for name in names}
