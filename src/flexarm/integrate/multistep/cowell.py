"""Compiled stepping of Cowell's method of order 4, linearly implicit, with one evaluation per step.

Theory page "integration", (I.5) to (I.8). Positions satisfy the symmetric two-step formula that is
also Numerov's. The bending forces at the new time are implicit; posture, rates and mass matrix at
the new time are predicted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.implicit.additive import AdditiveRecord, additive_step
from flexarm.integrate.memory import COUNT, END, EVALUATIONS, LENGTH, PLACE, START, STEP, Memory
from flexarm.integrate.multistep.cowell_formulas import (
    BETA,
    GAMMA,
    PREDICTED_RATE,
    PREDICTED_RISE,
    RATE,
    RISE,
    STIFF_BETA,
    STIFF_GAMMA,
    STIFF_RATE,
    STIFF_RISE,
)
from flexarm.integrate.multistep.resolved_modes import longest_step, soften
from flexarm.integrate.samples import (
    SHORT,
    begin_call,
    coordinate_between,
    copy_state,
    end_step,
    rate_between,
    sample_before,
)
from flexarm.integrate.status import DONE, INERTIA_LOST, NOT_FOLLOWED, PAUSED
from flexarm.integrate.steps import begin_span, followed, inertia_left, step_of_span
from flexarm.integrate.torque import loads_at, piece_after, piece_of, slope_at, torque_in
from flexarm.kernels.columns import FREE, JOINT_DAMPING, JOINT_STIFFNESS, MODE_DAMPING, W2
from flexarm.kernels.compilation.cache import apart, merged, unlocked
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import ArmConstants, Array, Sizes
from flexarm.kernels.recursion.articulated_body import solve_implicit

#: Number of previous points in the formulas; a one-step method computes the first ones of a span.
_STARTED = 3
#: Difference of the weights of the new acceleration in (I.8) and in (I.5).
_SHARE = STIFF_BETA - BETA
#: A limit on the step above this fraction of it changes nothing, because ``begin_span`` rounds.
_SAME = 1.0 - 1e-8
#: Compare predicted and corrected accelerations every 32 steps, because each comparison requires an
#: evaluation: this adds three per cent of the work.
_LOOK = 32
#: Factor on the sums of earlier comparisons: about the last fifty contribute.
_KEPT = 0.98
#: Maximum prediction error relative to the joint accelerations. Of 432 runs of 48 random arms
#: without damping, with steps of 0.5 to 8 over the highest frequency, 59 stop for this reason and 6
#: for others; the tip error exceeds 5 mm in 3 of the remaining runs.
_MISSED = 0.005
#: Sum of prediction errors, relative to the arm's reach, below which the check does not apply, or
#: the absolute tolerance if that is larger: at rest, all differences are rounding errors.
_NOTICED = 1e-4


class CowellRecord(NamedTuple):
    """The arrays of a run. Points are those of the present span; k is the last accepted one."""

    start: AdditiveRecord  # of the method for the first steps of a span
    past: Array  # (4, 3, n, 1 + m) last four points: point k in place k & 3; q, v, a
    rise: Array  # (n, 1 + m) q_k - q_(k-1), summed separately so that no digits are lost
    stiff: Array  # (n, 1 + m) 1.0 for a damped mode that is too fast for the formula
    missed: Array  # (3,) sums of ``_follows``, and steps since the last comparison
    bounds: Array  # (5,) see ``resolved_modes``
    softened: ArmConstants  # with the diagonal for the steps of the span


@merged
def _predict(system: System, record: CowellRecord, memory: Memory, k: int, h: float) -> None:
    """Predict point k + 1 from points up to k, without its own acceleration.

    ``memory.new`` receives the predicted state. ``start.known`` receives the increment of q and the
    rate without the new acceleration. ``work.force`` and ``memory.torque`` receive the differences
    of bending, spring and damping forces between the two.
    """
    sizes = system.sizes
    past, rise, known = record.past, record.rise, record.start.known
    r0 = k & 3
    r1 = (k - 1) & 3
    r2 = (k - 2) & 3
    r3 = (k - 3) & 3
    per_step = 1.0 / h
    square = h * h
    c = system.constants
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            q0 = past[r0, 0, i, j]
            v0 = past[r0, 1, i, j]
            a0 = square * past[r0, 2, i, j]
            a1 = square * past[r1, 2, i, j]
            if record.stiff[i, j] == 0.0:
                a2 = square * past[r2, 2, i, j]
                a3 = square * past[r3, 2, i, j]
                step = rise[i, j] + RISE[1] * a0 + RISE[2] * a1
                rate = per_step * (step + RATE[1] * a0 + RATE[2] * a1 + RATE[3] * a2 + RATE[4] * a3)
                q = (1.0 / 12.0) * (
                    PREDICTED_RISE[0] * a0
                    + PREDICTED_RISE[1] * a1
                    + PREDICTED_RISE[2] * a2
                    + PREDICTED_RISE[3] * a3
                )
                q += q0 + rise[i, j]
                v = (1.0 / 24.0) * (
                    PREDICTED_RATE[0] * a0
                    + PREDICTED_RATE[1] * a1
                    + PREDICTED_RATE[2] * a2
                    + PREDICTED_RATE[3] * a3
                )
                v = v0 + per_step * v
            else:
                step = rise[i, j] + STIFF_RISE[1] * a0 + STIFF_RISE[2] * a1
                rate = per_step * (step + STIFF_RATE[1] * a0)
                q = 3.0 * (q0 - past[r1, 0, i, j]) + past[r2, 0, i, j]
                v = 3.0 * (v0 - past[r1, 1, i, j]) + past[r2, 1, i, j]
            memory.new[0, i, j] = q
            memory.new[1, i, j] = v
            known[0, i, j] = step
            known[1, i, j] = rate
            if j > 0:
                system.work.force[i, j] = c.mode[i, j - 1, W2] * (q - q0 - step) + c.mode[
                    i, j - 1, MODE_DAMPING
                ] * (v - rate)
            else:
                memory.torque[i] += c.body[i, FREE] * (
                    c.body[i, JOINT_STIFFNESS] * (q - q0 - step)
                    + c.body[i, JOINT_DAMPING] * (v - rate)
                )


@merged
def _correct(system: System, record: CowellRecord, k: int, h: float) -> None:
    """Compute point k + 1 from its accelerations."""
    sizes = system.sizes
    past, known = record.past, record.start.known
    old = k & 3
    new = (k + 1) & 3
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            x = system.work.acceleration[i, j]
            beta = BETA
            gamma = GAMMA
            if record.stiff[i, j] != 0.0:
                beta = STIFF_BETA
                gamma = STIFF_GAMMA
            step = known[0, i, j] + h * h * beta * x
            record.rise[i, j] = step
            past[new, 0, i, j] = past[old, 0, i, j] + step
            past[new, 1, i, j] = known[1, i, j] + h * gamma * x
            past[new, 2, i, j] = x


@apart
def _remember(
    sizes: Sizes, stiff: Array, past: Array, rise: Array, k: int, h: float, state: Array,
    stage: Array,
) -> None:  # fmt: skip
    """Store point k of a span that a one-step method has computed."""
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            rise[i, j] = state[0, i, j] - past[(k - 1) & 3, 0, i, j]
            if stiff[i, j] != 0.0:  # the momenta in both formulas must start with the same value
                change = stage[1, i, j] - past[(k - 1) & 3, 2, i, j]
                rise[i, j] += _SHARE * h * h * change
            past[k & 3, 0, i, j] = state[0, i, j]
            past[k & 3, 1, i, j] = state[1, i, j]
            past[k & 3, 2, i, j] = stage[1, i, j]


@merged
def _follows(
    system: System, tolerance: Tolerance, past: Array, k: int, h: float, slope: Array,
    missed: Array,
) -> bool:  # fmt: skip
    """Return whether the accelerations agree, so far, with the corrected posture and rates.

    ``slope`` (2, n, 1 + m) contains the accelerations evaluated at point k. ``missed`` contains
    sums over the last comparisons of the error and of the size of the joint accelerations, in rates
    per metre at the tip; see below (I.8).
    """
    missed[0] *= _KEPT
    missed[1] *= _KEPT
    miss: float = 0.0
    size: float = 0.0
    for i in range(len(system.sizes.bodies)):
        used = real(past[k & 3, 2, i, 0])
        miss = max(miss, abs(real(slope[1, i, 0]) - used) / tolerance.unit[1, i, 0])
        size = max(size, abs(used) / tolerance.unit[1, i, 0])
    missed[0] += _LOOK * h * miss
    missed[1] += _LOOK * h * size
    least = max(_NOTICED / tolerance.unit[0, 0, 0], tolerance.absolute)
    return not (missed[0] > least and missed[0] > _MISSED * missed[1])


@apart
def _between(
    sizes: Sizes, tolerance: Tolerance, stiff: Array, past: Array, k: int, h: float, x: float,
    sample: Array,
) -> None:  # fmt: skip
    """Sample at x (0 to 1) between points k - 1 and k: Hermite, or cubic Lagrange if stiff."""
    new = k & 3
    old = (k - 1) & 3
    before = (k - 2) & 3
    first = (k - 3) & 3
    y = x - 1.0
    fine = h * tolerance.fastest > SHORT
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            if stiff[i, j] != 0.0 and k >= 3:
                for level in range(2):
                    sample[level, i, j] = (
                        past[new, level, i, j] * x * (x + 1.0) * (x + 2.0) / 6.0
                        - past[old, level, i, j] * y * (x + 1.0) * (x + 2.0) / 2.0
                        + past[before, level, i, j] * x * y * (x + 2.0) / 2.0
                        - past[first, level, i, j] * x * y * (x + 1.0) / 6.0
                    )
                continue
            q0 = past[old, 0, i, j]
            v0 = past[old, 1, i, j]
            a0 = past[old, 2, i, j]
            q1 = past[new, 0, i, j]
            v1 = past[new, 1, i, j]
            a1 = past[new, 2, i, j]
            sample[0, i, j] = coordinate_between(x, h, q0, v0, a0, q1, v1, a1)
            sample[1, i, j] = rate_between(x, h, q0, v0, a0, q1, v1, a1, fine)


@unlocked
def advance_cowell(
    system: System,
    tolerance: Tolerance,
    record: CowellRecord,
    memory: Memory,
    until: float,
    max_steps: int,
) -> int:
    """Step to ``until``, by the rules of ``base.Integrator``."""
    sizes, work, drive = system.sizes, system.work, system.drive
    # Typed constants: with literals, the compiler would build each callee for every value.
    zero = int(np.int64(0))
    from_left = bool(np.bool_(True))
    from_right = bool(np.bool_(False))
    stays = from_right  # joints do not stick
    clock, counts, torque = memory.clock, memory.counts, memory.torque
    past, rise, stiff, missed = record.past, record.rise, record.stiff, record.missed
    known, stages = record.start.known, record.start.stages
    last_stage = stages.shape[0] - 1
    t = begin_call(sizes, memory)
    piece = piece_of(drive.breaks, t, from_left)
    for _ in range(max_steps):
        if t >= until:
            break
        if clock[PLACE] >= clock[COUNT]:  # a new span begins
            longest = clock[STEP]
            # A shorter step may resolve a mode that was stiff, which then limits the step.
            while True:
                begin_span(drive.stops, t, until, longest, clock)
                longest = longest_step(
                    system, memory.state, memory.new, known, torque, stiff, record.bounds,
                    clock[LENGTH], clock[END] - clock[START],
                )  # fmt: skip
                if not longest < clock[LENGTH] * _SAME:
                    break
            soften(system, record.softened, stiff, clock[LENGTH])
            slope_at(system, t, from_right, memory.state, torque, stages, zero, stays)
            counts[EVALUATIONS] += 1
            _remember(sizes, stiff, past, rise, zero, 0.0, memory.state, stages[0])
        h = clock[LENGTH]
        k = int(clock[PLACE])
        t_new, lands = step_of_span(clock)
        new = past[(k + 1) & 3]
        if k < _STARTED:
            additive_step(system, record.start, memory, t, h)
            status = followed(sizes, tolerance, memory.new, h)
            if status != DONE:
                return status
            slope_at(system, t_new, from_left, memory.new, torque, stages, zero, stays)
            counts[EVALUATIONS] += last_stage
            _remember(sizes, stiff, past, rise, k + 1, h, memory.new, stages[0])
        else:
            piece = piece_after(drive.breaks, t_new, piece)
            torque_in(system, piece, t_new, torque)
            if drive.factor_coefficients.shape[2] > 0:
                loads_at(system, t_new, lands)
            _predict(system, record, memory, k, h)
            solve_implicit(
                sizes, record.softened, memory.new, work.force, torque, drive.loads, work
            )
            counts[EVALUATIONS] += 1
            _correct(system, record, k, h)
            status = followed(sizes, tolerance, new, h)
            if status != DONE:
                return status
            missed[2] += 1.0
        if not inertia_left(system):
            return INERTIA_LOST
        if missed[2] >= _LOOK:
            missed[2] = 0.0
            copy_state(sizes, new, memory.new)
            slope_at(system, t_new, from_left, memory.new, torque, stages, last_stage, stays)
            counts[EVALUATIONS] += 1
            if not _follows(system, tolerance, past, k + 1, h, stages[last_stage], missed):
                return NOT_FOLLOWED
        sample = sample_before(memory, t_new)
        while sample >= 0:
            _between(
                sizes, tolerance, stiff, past, k + 1, h,
                (memory.sample_times[sample] - t) / h, memory.samples[sample],
            )  # fmt: skip
            sample = sample_before(memory, t_new)
        end_step(sizes, memory, new, t_new)
        t = t_new
        clock[PLACE] += 1.0
    return DONE if t >= until else PAUSED
