"""Samples of a loop whose law runs as a program between the steps, without Python."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.stations import place_gauges
from flexarm.control.contract.law_program import flat, program_of
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


class ProgrammedSamples:
    """Samples of a loop with the program of its law; see ``integrate.sampled_law``."""

    def __init__(
        self, loop: ClosedLoop, program: LawProgram, inputs: FloatArray, small: float
    ) -> None:
        self._loop, self._program, self._small = loop, program, small
        # The rows of inputs that are planned, and the sample after the last of them.
        self._planned, self._next = inputs[None], loop.tick + 1
        arm = loop.run.arm
        rows, bodies = place_gauges(arm, arm.gauges)
        joints = np.array(arm.assembly.joint_body)
        self._sensors = joints, bodies, rows, np.zeros(len(bodies))
        self._seconds = _seconds(program)

    def advance(self) -> tuple[Status, int]:
        """Advance by some samples; return the status of the run, and how the call has ended."""
        loop, program, first = self._loop, self._program, self._loop.tick
        started = time.perf_counter()
        inputs = self._rows_from(first)
        loop.seconds += time.perf_counter() - started
        memory = loop.controller.memory
        program.numbers[program.memory] = flat(memory)
        commands = np.zeros((len(inputs), loop.run.arm.n_joints))
        count = np.array([first, first + len(inputs), first, REFUSED])
        times = np.array([loop.sample_time, loop.end])
        law = SampledLaw(program, *self._sensors, inputs, commands, count, self._small, times)
        status = loop.advance_samples(LOOPS[loop.run.integrator.stepper], law)
        done = int(count[TICK]) - first
        loop.add_holds(commands[:done])
        loop.seconds += done * self._seconds
        if done:
            ends = np.cumsum([np.size(value) for value in memory.values()])[:-1]
            parts = np.split(program.numbers[program.memory], ends)
            after = {}  # in the shapes and with the types of the values before
            for (name, value), part in zip(memory.items(), parts, strict=False):
                array = np.asarray(value)
                after[name] = part.reshape(array.shape).astype(array.dtype)[()]
            loop.controller._keep(after)
        return status, int(count[END])

    def _rows_from(self, first: int) -> FloatArray:
        """Return the planned inputs (samples, r) from a sample on; none where planning fails.

        Each sample is planned once, in order: a plan may look ahead by counting its calls.
        """
        loop, law = self._loop, self._loop.controller
        ahead = self._next - first
        if ahead > 0:
            return self._planned[len(self._planned) - ahead :]
        times = np.arange(first, first + _CHUNK) * loop.sample_time
        times = times[loop.runs_on(times)]
        self._planned = self._plan(law, _reference(loop), times)
        self._next = first + len(self._planned)
        return self._planned

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
        return np.array(rows).reshape(len(rows), self._program.inputs.size)

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


def programmed_samples(
    loop: ClosedLoop, measurement: Measurement, small: float
) -> ProgrammedSamples | None:
    """Return samples by a program, after the first sample; None if the loop needs Python."""
    run, law = loop.run, loop.controller
    alone = run.changes is None and run.watch is None and run.default_step is None
    plain = loop.hardware is None and not run.loads.placed.contacts.body.size
    long = loop.end >= _WORTH * loop.sample_time
    if not (alone and plain and long and run.integrator.stepper in LOOPS):
        return None
    try:
        inputs = law.planned(loop.time, _reference(loop))
        program = program_of(law, law.memory, measurement, inputs)
    except Exception:  # the next sample reports the reason
        return None
    return None if program is None else ProgrammedSamples(loop, program, flat(inputs), small)
