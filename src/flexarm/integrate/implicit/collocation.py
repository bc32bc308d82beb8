"""Compiled stepping of Gauss collocation, with implicit stages solved to rounding errors.

Theory page "integration", (I.12) to (I.15). A sweep updates the accelerations of all stages in
turn, each by one pass of the recursion in which bending, springs and damping are implicit. The
iteration treats only smooth terms, so a few sweeps are sufficient.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.implicit.additive import soften_for
from flexarm.integrate.memory import (
    COUNT,
    EVALUATIONS,
    LENGTH,
    PLACE,
    SAMPLES,
    SOFTENED,
    STEP,
    Memory,
)
from flexarm.integrate.samples import begin_call, end_step, samples_between
from flexarm.integrate.status import (
    DONE,
    INERTIA_LOST,
    NOT_CONVERGED,
    NOT_FINITE,
    PAUSED,
)
from flexarm.integrate.steps import begin_span, error_norm, followed, inertia_left, step_of_span
from flexarm.integrate.torque import drive_at, slope_at
from flexarm.kernels.columns import FREE, JOINT_DAMPING, JOINT_STIFFNESS, MODE_DAMPING, W2
from flexarm.kernels.compilation.cache import merged, unlocked
from flexarm.kernels.layout import ArmConstants, Array
from flexarm.kernels.recursion.articulated_body import solve_implicit

#: Number of sweeps after which a step has failed; three to ten are usual.
_SWEEPS = 100
#: Change in a sweep, relative to the state, that ends the iteration: a twentieth of a unit in the
#: last place. The remaining error is similar in each step, so it accumulates over a million steps.
_ROUNDING = 0.05 * float(np.finfo(float).eps)
#: A change below this many times ``_ROUNDING`` counts as rounding noise once it has not decreased
#: for this number of sweeps. Larger changes, which only very fast modes cause, require more sweeps,
#: because changes may oscillate.
_NOISE, _STALLED = 1e3, 2
_LARGE_NOISE, _LONG_STALLED = 1e8, 10


class CollocationRecord(NamedTuple):
    """Coefficients of s stages, and the arrays of a run."""

    A: Array  # (s, s)
    AA: Array  # (s, s) A A
    b: Array  # (s,) weights of the new rates
    bA: Array  # (s,) weights of the new coordinates, with h^2
    c: Array  # (s,)
    guess: Array  # (2, s, 2 s) weights of the initial guess: from one step, from two steps
    pull: float  # factor of h^2 K on the diagonal
    drag: float  # factor of h D on the diagonal
    inner: Array  # (2, n, 1 + m) state of a stage
    lost: Array  # (2, n, 1 + m) compensation: digits lost in the sum of all steps
    stages: Array  # (s, n, 1 + m) accelerations
    earlier: Array  # (2 s, n, 1 + m) accelerations of the stages of the last two steps
    ends: Array  # (2, 2, n, 1 + m) slopes at both ends of a step, for samples
    change: Array  # (1, 2, n, 1 + m) change of a stage in a sweep
    one: Array  # (2, 1) weights of ``change`` in its norm
    softened: ArmConstants  # with the diagonal for a step of length ``clock[SOFTENED]``


@merged
def _guess(system: System, record: CollocationRecord, row: int) -> None:
    """Write the initial guess of the stages' accelerations, from those of earlier steps."""
    sizes = system.sizes
    stages, earlier = record.stages, record.earlier
    for k in range(stages.shape[0]):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                total = 0.0
                for p in range(earlier.shape[0]):
                    total += record.guess[row, k, p] * earlier[p, i, j]
                stages[k, i, j] = total


@merged
def _rounding(system: System, tolerance: Tolerance) -> Tolerance:
    """Return the tolerance on the change in a sweep that counts as solved."""
    least = tolerance.unit[0, 0, 0]
    for i in range(len(system.sizes.bodies)):
        least = min(least, tolerance.unit[0, i, 0])
    return Tolerance(_ROUNDING / least, _ROUNDING, tolerance.unit, tolerance.fastest)


@merged
def _sweep(
    system: System, rounding: Tolerance, record: CollocationRecord, memory: Memory, t: float,
    h: float,
) -> float:  # fmt: skip
    """Update the accelerations of all stages; return the largest change over its tolerance."""
    sizes, work = system.sizes, system.work
    k = system.constants
    state, torque, force = memory.state, memory.torque, work.force
    stages, inner, change = record.stages, record.inner, record.change
    pull, drag = record.pull, record.drag
    worst: float = 0.0
    for s in range(stages.shape[0]):
        drive_at(system, t + record.c[s] * h, False, torque)
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                rise = record.c[s] * state[1, i, j]
                rate = 0.0
                for p in range(stages.shape[0]):
                    rise += h * record.AA[s, p] * stages[p, i, j]
                    rate += record.A[s, p] * stages[p, i, j]
                inner[0, i, j] = state[0, i, j] + h * rise
                inner[1, i, j] = state[1, i, j] + h * rate
            added = h * drag * k.body[i, JOINT_DAMPING] + h * h * pull * k.body[i, JOINT_STIFFNESS]
            torque[i] += k.body[i, FREE] * added * stages[s, i, 0]
            for j in range(len(sizes.modes)):
                added = h * drag * k.mode[i, j, MODE_DAMPING] + h * h * pull * k.mode[i, j, W2]
                force[i, 1 + j] = added * stages[s, i, 1 + j]
        solve_implicit(sizes, record.softened, inner, force, torque, system.drive.loads, work)
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                x = work.acceleration[i, j]
                change[0, 0, i, j] = h * h * pull * (x - stages[s, i, j])
                change[0, 1, i, j] = h * drag * (x - stages[s, i, j])
                stages[s, i, j] = x
        worst = max(
            worst, error_norm(system.sizes, rounding, state, inner, change, record.one, 1.0)
        )
    return worst


@merged
def _solve(
    system: System, tolerance: Tolerance, record: CollocationRecord, memory: Memory, t: float,
    h: float,
) -> int:  # fmt: skip
    """Sweep until only rounding errors change; return ``DONE``, or another code on failure."""
    rounding = _rounding(system, tolerance)
    least: float = math.inf
    stalled = 0
    for sweep in range(_SWEEPS):
        norm = _sweep(system, rounding, record, memory, t, h)
        memory.counts[EVALUATIONS] += record.stages.shape[0]
        if not math.isfinite(norm):
            return NOT_FINITE if sweep == 0 else NOT_CONVERGED
        if norm < 0.9 * least:
            least = norm
            stalled = 0
        else:
            stalled += 1
        solved = norm <= 1.0 or stalled >= (_STALLED if norm < _NOISE else _LONG_STALLED)
        if solved and norm < _LARGE_NOISE:
            return DONE
    return NOT_CONVERGED


@merged
def _new_point(system: System, record: CollocationRecord, memory: Memory, h: float) -> None:
    """Compute the new point by compensated summation."""
    sizes = system.sizes
    stages, lost = record.stages, record.lost
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            rise = memory.state[1, i, j]
            rate = 0.0
            for p in range(stages.shape[0]):
                rise += h * record.bA[p] * stages[p, i, j]
                rate += record.b[p] * stages[p, i, j]
            for level in range(2):
                step = h * (rise if level == 0 else rate) + lost[level, i, j]
                old = memory.state[level, i, j]
                memory.new[level, i, j] = old + step
                lost[level, i, j] = step - (memory.new[level, i, j] - old)


@unlocked
def advance_collocation(
    system: System,
    tolerance: Tolerance,
    record: CollocationRecord,
    memory: Memory,
    until: float,
    max_steps: int,
) -> int:
    """Step to ``until``, by the rules of ``base.Integrator``."""
    sizes = system.sizes
    # Typed constants: with literals, the compiler would build each callee for every value.
    zero = int(np.int64(0))
    last = int(np.int64(1))
    from_left = bool(np.bool_(True))
    from_right = bool(np.bool_(False))
    stays = from_right  # joints do not stick
    damps = from_right  # vibrations remain
    clock, counts, torque = memory.clock, memory.counts, memory.torque
    stages, earlier, ends = record.stages, record.earlier, record.ends
    count = stages.shape[0]
    t = begin_call(sizes, memory)
    for _ in range(max_steps):
        if t >= until:
            break
        if clock[PLACE] >= clock[COUNT]:  # a new span begins
            begin_span(system.drive.stops, t, until, clock[STEP], clock)
            h = clock[LENGTH]
            if h != clock[SOFTENED]:
                soften_for(system, record.softened, h * record.drag, h * h * record.pull)
                clock[SOFTENED] = h
            slope_at(system, t, from_right, memory.state, torque, ends, zero, stays)
            counts[EVALUATIONS] += 1
            for p in range(2 * count):
                for i in range(len(sizes.bodies)):
                    for j in range(1 + len(sizes.modes)):
                        earlier[p, i, j] = ends[0, 1, i, j]
        h = clock[LENGTH]
        t_new, _lands = step_of_span(clock)
        _guess(system, record, 1 if clock[PLACE] > 1.0 else 0)
        status = _solve(system, tolerance, record, memory, t, h)
        if status == DONE and not inertia_left(system):
            status = INERTIA_LOST
        if status == DONE:
            _new_point(system, record, memory, h)
            status = followed(sizes, tolerance, memory.new, h)
        if status != DONE:
            return status

        next_one = counts[SAMPLES]
        if next_one < memory.sample_times.shape[0] and memory.sample_times[next_one] < t_new:
            slope_at(system, t, from_right, memory.state, torque, ends, zero, stays)
            slope_at(system, t_new, from_left, memory.new, torque, ends, last, stays)
            counts[EVALUATIONS] += 2
            samples_between(system, tolerance, memory, ends, t, h, t_new, damps)
        end_step(sizes, memory, memory.new, t_new)
        for p in range(count):
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    earlier[p, i, j] = earlier[count + p, i, j]
                    earlier[count + p, i, j] = stages[p, i, j]
        t = t_new
        clock[PLACE] += 1.0
    return DONE if t >= until else PAUSED
