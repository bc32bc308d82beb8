"""Compiled stepping of explicit Runge-Kutta methods, with fixed or controlled steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.closures import close_step
from flexarm.integrate.memory import BETWEEN, EVALUATIONS, KEPT, STEP, Memory
from flexarm.integrate.momentum import is_alone, keep_momentum, keep_sample
from flexarm.integrate.nearness import step_on
from flexarm.integrate.samples import begin_call, dense_weights, sample_before
from flexarm.integrate.status import DONE, PAUSED
from flexarm.integrate.step_ends import begin_steps, judge_end, next_step
from flexarm.integrate.steps import LONGEST, followed, judge_step, step_landing
from flexarm.integrate.sticking import begin_watch
from flexarm.integrate.sums import combine
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
    stays = bool(np.bool_(False))
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
    begin_steps(system, memory, stages, t, adaptive)
    alone = is_alone(system)
    if alone and clock[KEPT] == 0.0:
        keep_momentum(system, memory, state)
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
        if len(sizes.closures) > 0:
            close_step(system, system.constants, memory)
        if alone:
            keep_momentum(system, memory, new)
        seen = last > s and not alone and len(sizes.closures) == 0
        status = judge_end(system, tolerance, memory, stages, s, t, t_new, h, adaptive, seen)
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
            keep_sample(system, memory, out, alone)
            sample = sample_before(memory, t_new)
        next_step(system, memory, stages, s, t_new, h, lands, adaptive, record.order, until)
        t = t_new
        if t >= until:
            return DONE
    clock[BETWEEN] = 1.0
    return PAUSED
