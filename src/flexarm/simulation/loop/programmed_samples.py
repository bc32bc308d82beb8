"""Samples of a loop whose law and devices run as a program between the steps, without Python."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.stations import place_gauges
from flexarm.control.contract.base import Arrays
from flexarm.control.contract.law_program import SENSED, flat, program_of
from flexarm.control.hardware.measurement import FloatArray, Measurement
from flexarm.integrate.base import Status
from flexarm.integrate.sampled_law import END, LOOPS, REFUSED, TICK, SampledLaw
from flexarm.kernels.controller_terms.law_program import LawProgram, law_step

if TYPE_CHECKING:
    from flexarm.simulation.loop.control_loop import ClosedLoop

#: Samples of one compiled call, after which Ctrl-C is noticed and the progress bar moves.
_CHUNK = 1024
#: Least number of samples of a run for which the loop is compiled: 2 s, once per machine.
_WORTH = 500
#: Evaluations of a program of which the fastest counts as its time.
_TIMED = 5


class _Step:
    """Step of a loop with its instruments and motors, as a function of numbers.

    Names of memory and inputs begin with their owner: ``law.``, ``motors.`` or the number of an
    instrument.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        self._law, self._acting, self._tick = loop.controller, loop.acting, loop.tick
        self._instruments = {str(i): item for i, item in enumerate(loop.instruments)}
        self._signals = {name: str(item.signal) for name, item in self._instruments.items()}
        self._noted = loop.hardware is not None

    def memory(self) -> dict[str, Any]:
        """Return the memory before the next sample."""
        instruments = {name: item.numbers() for name, item in self._instruments.items()}
        return _joined({"law": self._law.memory, "motors": self._acting.numbers(), **instruments})

    def keep(self, memory: Arrays, tick: int, sample_time: float) -> None:
        """Store the memory before sample ``tick``."""
        self._law._keep(_of(memory, "law"))
        for name, item in self._instruments.items():
            item.set_numbers(tick, _of(memory, name))
        waits = self._acting.delay_in(sample_time) or 0
        times: Any = np.arange(tick - waits, tick) * sample_time
        self._acting.set_numbers(_of(memory, "motors"), times)

    def noise(self, signals: Arrays, samples: int) -> dict[str, FloatArray]:
        """Return the noise (samples, size) of the instruments."""
        return {
            f"{name}.noise": item.noise(samples, np.size(signals[self._signals[name]]))
            for name, item in self._instruments.items()
            if not item.exact
        }

    def shapes(self, signals: Arrays) -> dict[str, tuple[int, ...]]:
        """Return the shapes of the readings that results contain."""
        if not self._noted:
            return {}
        noise = {name: np.zeros(row.shape[1]) for name, row in self.noise(signals, 0).items()}
        _, values = self.readings(self.memory(), signals, noise)
        return {name: np.shape(value) for name, value in values.items()}

    def readings(self, memory: Arrays, signals: Arrays, inputs: Arrays) -> tuple[Arrays, Arrays]:
        """Return the next memory of the instruments, and their readings; those of exact sensors."""
        if not self._instruments:
            return {}, signals
        after: dict[str, Any] = {}
        values: dict[str, Any] = {}
        for name, item in self._instruments.items():
            value = signals[self._signals[name]]
            if item.exact:
                values[item.labels[0]] = value
                continue
            moved, drawn = copy(item), _of(inputs, name)["noise"]
            moved.set_numbers(self._tick, _of(memory, name), drawn if len(drawn) else None)
            moved.take(self._tick, value)
            moved.write_available(self._tick, values)
            after[name] = moved.numbers()
        return _joined(after), values

    def __call__(self, memory: Arrays, signals: Arrays, inputs: Arrays) -> tuple[Arrays, Arrays]:
        """Return the next memory, and results; see ``law_program.LoopStep``."""
        after, values = self.readings(memory, signals, inputs)
        measured = Measurement(**values)
        law, torque = self._law.step(_of(memory, "law"), measured, _of(inputs, "law"))
        rate, planned = signals["joint_rate"], _of(inputs, "motors")
        motors, held, rows = self._acting.step(_of(memory, "motors"), torque, rate, planned)
        noted = [np.ravel(value) for value in values.values()] if self._noted else []
        results = {"torque": torque, "held": held}
        results["noted"] = np.concatenate([np.zeros(0), *noted, *rows])
        return {**_joined({"law": law, "motors": motors}), **after}, results


def _joined(parts: Mapping[str, Arrays]) -> dict[str, Any]:
    return {f"{part}.{name}": value for part in parts for name, value in parts[part].items()}


def _of(arrays: Arrays, part: str) -> dict[str, Any]:
    start = part + "."
    return {name[len(start) :]: arrays[name] for name in arrays if name.startswith(start)}


class ProgrammedSamples:
    """Samples of a loop with the program of its step; see ``integrate.sampled_law``."""

    def __init__(
        self,
        loop: ClosedLoop,
        step: _Step,
        program: LawProgram,
        signals: Arrays,
        inputs: FloatArray,
        small: float,
    ) -> None:
        self._loop, self._step, self._program, self._small = loop, step, program, small
        self._signals, self._shapes = signals, step.shapes(signals)
        # Inputs and breaks of torques that are planned, and the sample after the last of them.
        self._planned, self._next = (np.zeros((0, 0)), np.zeros((0, 0))), loop.tick
        self._set_planned(loop.tick, inputs[None])
        arm = loop.run.arm
        rows, bodies = place_gauges(arm, arm.gauges)
        joints = np.array(arm.assembly.joint_body)
        self._sensors = joints, bodies, rows, np.zeros(len(bodies))
        self._seconds = _seconds(program)

    def advance(self) -> tuple[Status, int]:
        """Advance by some samples; return the status of the run, and how the call has ended."""
        loop, program, first = self._loop, self._program, self._loop.tick
        started = time.perf_counter()
        inputs, breaks = self._rows_from(first)
        loop.seconds += time.perf_counter() - started
        memory = self._step.memory()
        program.numbers[program.memory] = flat(memory)
        commands = np.zeros((len(inputs), loop.run.arm.n_joints))
        noted = np.zeros((len(inputs), program.noted.size))
        count = np.array([first, first + len(inputs), first, REFUSED])
        times, rows = np.array([loop.sample_time, loop.end]), (inputs, breaks, commands, noted)
        law = SampledLaw(program, *self._sensors, *rows, count, self._small, times)
        status = loop.advance_samples(LOOPS[loop.run.integrator.stepper], law)
        done = int(count[TICK]) - first
        self._note(commands[:done], noted[:done])
        loop.seconds += done * self._seconds
        if done:
            ends = np.cumsum([np.size(value) for value in memory.values()])[:-1]
            parts = np.split(program.numbers[program.memory], ends)
            after = {}  # in the shapes and with the types of the values before
            for (name, value), part in zip(memory.items(), parts, strict=False):
                array = np.asarray(value)
                after[name] = part.reshape(array.shape).astype(array.dtype)[()]
            self._step.keep(after, loop.tick, loop.sample_time)
        return status, int(count[END])

    def _note(self, commands: FloatArray, noted: FloatArray) -> None:
        """Note readings and torques of samples."""
        readings: dict[str, FloatArray] = {}
        at, joints = 0, commands.shape[1]
        for name, shape in self._shapes.items():
            size = math.prod(shape)
            readings[name] = noted[:, at : at + size].reshape(len(noted), *shape)
            at += size
        rows = [noted[:, k : k + joints] for k in range(at, noted.shape[1], joints)]
        self._loop.add_samples(commands, readings, rows or [commands])

    def _rows_from(self, first: int) -> tuple[FloatArray, FloatArray]:
        """Return inputs (samples, r) and breaks from a sample on; none where planning fails.

        Each sample is planned once, in order: a plan may look ahead by counting its calls.
        """
        loop, law = self._loop, self._loop.controller
        ahead = self._next - first
        if ahead > 0:
            inputs, breaks = self._planned
            return inputs[len(inputs) - ahead :], breaks[len(breaks) - ahead :]
        times = np.arange(first, first + _CHUNK) * loop.sample_time
        times = times[loop.runs_on(times)]
        self._set_planned(first, self._plan(law, _reference(loop), times))
        return self._planned

    def _set_planned(self, first: int, rows: FloatArray) -> None:
        """Set the inputs of a law (samples, r) from a sample on; add those of its devices."""
        self._next = first + len(rows)
        if not len(rows):
            self._planned = rows, rows
            return
        parts, breaks = [rows], np.zeros((len(rows), 0))
        if not self._loop.acting.plain:
            motors = [_motors(self._loop, k) for k in range(first, self._next)]
            parts.append(np.array([flat(inputs) for inputs, _ in motors]))
            breaks = np.array([row for _, row in motors])
        parts += self._step.noise(self._signals, len(rows)).values()
        self._planned = np.concatenate(parts, axis=1), breaks

    def _plan(self, law: Any, reference: Any, times: FloatArray) -> FloatArray:
        if getattr(reference, "vectorized", False):
            try:
                return _rows(law.planned(times, reference), times, law, reference)
            except Exception:  # of a plan for one time
                pass
        rows: list[FloatArray] = []
        for t in times.tolist():
            try:
                rows.append(flat(law.planned(t, reference)))
            except Exception:  # the sample itself reports the reason
                break
        return np.array(rows) if rows else np.zeros((0, 0))

    @property
    def planned_to(self) -> int:
        """Number of the first sample that is not planned."""
        return self._next

    @property
    def torque(self) -> FloatArray:
        """Torques (joints,) of the last evaluation, N m."""
        return np.asarray(self._program.numbers[self._program.torque])


def _reference(loop: ClosedLoop) -> Any:
    """Return the reference of the plans after the first sample."""
    reference = loop.sampled_reference
    return loop.controller._rest if reference is None else reference


def _rows(planned: Any, times: FloatArray, law: Any, reference: Any) -> FloatArray:
    """Return inputs at many times (samples, r), compared with those of single times."""
    if any(np.shape(value)[:1] != times.shape for value in planned.values()):
        raise ValueError("the plan is for one time")
    parts = [np.reshape(value, (len(times), -1)) for value in planned.values()]
    rows = np.concatenate([np.zeros((len(times), 0)), *parts], axis=1)
    for k in (0, len(times) // 2, -1):
        if not np.array_equal(rows[k], flat(law.planned(float(times[k]), reference))):
            raise ValueError("the plan is for one time")
    return rows


def _seconds(program: LawProgram) -> float:
    """Return the time of an evaluation of a program, s."""
    trial = program._replace(numbers=program.numbers.copy())
    durations = []
    for _ in range(_TIMED):
        started = time.perf_counter()
        law_step(trial)
        durations.append(time.perf_counter() - started)
    return min(durations)


def _motors(loop: ClosedLoop, k: int) -> tuple[Arrays, FloatArray]:
    """Return the planned inputs of the motors at sample k, and the breaks of their torques."""
    before, t, until = (j * loop.sample_time for j in (k - 1, k, k + 1))
    return loop.acting.planned(t, min(until, loop.end), before)


def first_sample(loop: ClosedLoop) -> int | None:
    """Return the first sample whose step can be recorded, if the law's can; None without one.

    Before it, delayed readings and torques are not complete.
    """
    run, instruments = loop.run, loop.instruments
    alone = run.changes is None and run.watch is None and run.default_step is None
    alone = alone and not run.loads.placed.contacts.body.size
    alike = all(item.steps_alike and item.signal in SENSED for item in instruments)
    long = loop.end >= _WORTH * loop.sample_time
    waits = loop.acting.delay_in(loop.sample_time)
    if waits is None or not (alone and alike and long and run.integrator.stepper in LOOPS):
        return None
    return max([1, waits, *(item.late for item in instruments)])


def programmed_samples(loop: ClosedLoop, small: float) -> ProgrammedSamples | None:
    """Return samples by a program from the present one on; None if the loop needs Python."""
    law, step = loop.controller, _Step(loop)
    signals = loop.signals()
    try:
        planned = law.planned(loop.time, _reference(loop))
        noise = {name: np.zeros(row.shape[1]) for name, row in step.noise(signals, 0).items()}
        inputs = {**_joined({"law": planned, "motors": _motors(loop, loop.tick)[0]}), **noise}
        program = program_of(law, step.memory(), signals, inputs, step)
    except Exception:  # the next sample reports the reason
        return None
    if program is None:
        return None
    return ProgrammedSamples(loop, step, program, signals, flat(planned), small)
