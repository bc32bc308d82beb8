"""Compiled stepping of explicit Runge-Kutta methods, with fixed or controlled steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.memory import BETWEEN, CHANGED, EVALUATIONS, STEP, WHOLE, Memory
from flexarm.integrate.nearness import fix_branches, step_on
from flexarm.integrate.samples import (
    begin_call,
    count_first,
    dense_weights,
    end_step,
    sample_before,
)
from flexarm.integrate.status import DONE, PAUSED
from flexarm.integrate.steps import (
    LONGEST,
    begin_springs,
    choose_step,
    combine,
    fix_springs,
    followed,
    judge_end,
    judge_step,
    step_landing,
)
from flexarm.integrate.stick_events import end_sticking, judge_sticking
from flexarm.integrate.sticking import begin_watch
from flexarm.integrate.torque import rates_of, slope_at
from flexarm.kernels.compilation.cache import unlocked
from flexarm.kernels.layout import Array


class ExplicitRecord(NamedTuple):
    """Coefficients of a ``tableau.Tableau``, and the arrays of a run."""

    A: Array  # (r, r)
    c: Array  # (r,)
    error: Array  # (2, s + 1)
    dense: Array  # (r, d)
    order: int
    adaptive: bool
    stages: Array  # (r, 2, n, 1 + m) derivatives; stage s belongs to the new point
    weights: Array  # (1, r) scratch for dense output


@unlocked
def advance_explicit(
    system: System,
    tolerance: Tolerance,
    record: ExplicitRecord,
    memory: Memory,
    until: float,
    max_steps: int,
) -> int:
    """Step to ``until``, by the rules of ``base.Integrator``."""
    sizes = system.sizes
    # Typed constants: with literals, the compiler would build each callee for every value.
    zero = int(np.int64(0))
    from_left = bool(np.bool_(True))
    from_right = bool(np.bool_(False))
    settles = from_left
    stays = from_right
    A, c, stages, adaptive = record.A, record.c, record.stages, record.adaptive
    state, new, torque = memory.state, memory.new, memory.torque
    clock, counts = memory.clock, memory.counts
    s = record.error.shape[1] - 1
    last = s
    if record.error[0, s] != 0.0 or not adaptive:
        last = s + 1
    t = begin_call(sizes, memory)
    if t >= until:
        return DONE
    begin_springs(system, memory, adaptive)
    slope_at(system, t, from_right, state, torque, stages, zero, settles)
    count_first(memory)
    step_on(system.drive.loads.contacts)
    fix_branches(system.drive.loads.contacts, clock, counts)
    for _ in range(max_steps):
        h = clock[STEP]
        if adaptive:
            h = min(h, LONGEST / tolerance.fastest)
        t_new, h, lands = step_landing(system.drive.stops, t, h, until)
        begin_watch(system)
        for k in range(1, last):
            combine(sizes, state, stages, A, k, k, h, new)
            t_stage = t + c[k] * h
            if k == s:
                t_stage = t_new
            # The dynamics is inlined only here, because its code is long.
            rates_of(system, t_stage, c[k] == 1.0, new, torque, stages, k)
        if last == s:
            combine(sizes, state, stages, A, s, s, h, new)
        counts[EVALUATIONS] += last - 1
        if adaptive:
            status = judge_step(system, tolerance, memory, stages, record.error, record.order, h)
        else:
            status = followed(sizes, tolerance, new, h)
        if status == PAUSED:
            continue
        if status != DONE:
            return status
        if last == s:
            slope_at(system, t_new, from_left, new, torque, stages, s, stays)
            counts[EVALUATIONS] += 1
        status = judge_end(system, memory, h, adaptive)
        if status == DONE:
            status = judge_sticking(system, tolerance.fastest, memory, stages, s, t, h, adaptive)
        if status == PAUSED:
            continue
        if status != DONE:
            return status
        step_on(system.drive.loads.contacts)

        rows = record.dense.shape[0]
        extra = s + 1  # number of stages computed so far for dense output
        sample = sample_before(memory, t_new)
        while sample >= 0:
            out = memory.samples[sample]
            for k in range(extra, rows):
                combine(sizes, state, stages, A, k, k, h, out)
                slope_at(system, t + c[k] * h, from_left, out, torque, stages, k, stays)
                counts[EVALUATIONS] += 1
            extra = rows
            dense_weights(record.dense, (memory.sample_times[sample] - t) / h, record.weights)
            combine(sizes, state, stages, record.weights, zero, rows, h, out)
            sample = sample_before(memory, t_new)
        if adaptive:
            choose_step(clock, h, record.order, lands)
        if clock[CHANGED] + clock[WHOLE] > 0.0:
            end_sticking(system, memory, stages, s, t_new, from_left)
        end_step(sizes, memory, new, t_new)
        for level in range(2):
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    stages[0, level, i, j] = stages[s, level, i, j]
        t = t_new
        if adaptive:
            lands = fix_springs(system, memory) or lands
        if t >= until:
            return DONE
        if lands:  # a force may change here, and the last slope is the one from the left
            counts[EVALUATIONS] += slope_at(
                system, t, from_right, state, torque, stages, zero, settles
            )
    clock[BETWEEN] = 1.0
    return PAUSED
