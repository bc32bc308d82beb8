"""Compiled stepping of explicit Runge-Kutta methods, with fixed or controlled steps.

=============  =============================================================================
symbol         meaning
=============  =============================================================================
``clock``      time, next step and memory of the step control, see ``steps``
``counts``     (4,) samples filled, steps, rejected steps, evaluations of the dynamics
``stages``     (r, 2, n, 1 + m) derivatives; stage s belongs to the new point
``weights``    (1, r) scratch for dense output
=============  =============================================================================
"""

from __future__ import annotations

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.joint_stops import step_to_stop
from flexarm.integrate.nearness import PRESSED_THROUGH, UNSEEN, step_allowed, step_on
from flexarm.integrate.steps import (
    DONE,
    IMPACTS,
    INERTIA_LOST,
    LONGEST,
    PAUSED,
    accept_step,
    combine,
    dense_weights,
    error_norm,
    followed,
    inertia_left,
    next_stop,
    refuse_beyond,
    refuse_step,
)
from flexarm.integrate.torque import rates_of, slope_at
from flexarm.kernels.cache import compiled
from flexarm.kernels.layout import Array


@compiled
def advance_explicit(
    system: System,
    tolerance: Tolerance,
    A: Array,
    c: Array,
    error: Array,
    error_low: Array,
    dense: Array,
    order: int,
    adaptive: bool,
    state: Array,
    new: Array,
    torque: Array,
    stages: Array,
    weights: Array,
    clock: Array,
    counts: Array,
    until: float,
    sample_times: Array,
    samples: Array,
    max_steps: int,
) -> int:
    """Step from ``clock[0]`` to ``until``; see ``base.Integrator`` for the rules kept."""
    # Typed constants: literals would make the compiler build a copy of each callee for each value.
    zero = int(np.int64(0))
    from_left = bool(np.bool_(True))
    from_right = bool(np.bool_(False))
    s = error.shape[0] - 1
    last = s
    if error[s] != 0.0 or not adaptive:
        last = s + 1
    t = clock[0]
    while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t:
        combine(system.sizes, state, stages, dense, zero, zero, 0.0, samples[counts[0]])
        counts[0] += 1
    if t >= until:
        return DONE
    slope_at(system, t, from_right, state, torque, stages, zero)
    counts[3] += 1
    contacts = system.drive.loads.contacts
    touchable = contacts.body.shape[0] > 0
    step_on(contacts)
    for _ in range(max_steps):
        stop = next_stop(system.drive.stops, t, until)
        h = clock[1]
        if adaptive:
            h = min(h, LONGEST / tolerance.fastest)
        lands = t + h * 1.000001 >= stop
        t_new = t + h
        if lands:
            t_new = stop
            h = stop - t
        for k in range(1, last):
            combine(system.sizes, state, stages, A, k, k, h, new)
            t_stage = t + c[k] * h
            if k == s:
                t_stage = t_new
            # The only place where the dynamics is merged in: the code is long.
            rates_of(system, t_stage, c[k] == 1.0, new, torque, stages, k)
        if last == s:
            combine(system.sizes, state, stages, A, s, s, h, new)
        counts[3] += last - 1
        norm = 0.0
        if adaptive:
            reached = step_to_stop(system, t, state, new, h)
            if reached < h:
                refuse_beyond(clock, counts, reached)
                clock[IMPACTS] += 1.0
                continue
            norm = error_norm(system, tolerance, state, new, stages, error, error_low, h)
            if not norm <= 1.0:
                counts[2] += 1
                status = refuse_step(tolerance, clock, h, norm, order)
                if status != DONE:
                    return status
                continue
        else:
            status = followed(system.sizes, tolerance, new, h)
            if status != DONE:
                return status
        if last == s:
            slope_at(system, t_new, from_left, new, torque, stages, s)
            counts[3] += 1

        if touchable:
            allowed = step_allowed(contacts, h, adaptive)
            if allowed == 0.0:
                return PRESSED_THROUGH
            if allowed < h:
                if not adaptive:
                    return UNSEEN
                refuse_beyond(clock, counts, allowed)
                continue
            step_on(contacts)

        # The last evaluation was at the new point: do not step past a singular mass matrix.
        if not inertia_left(system):
            return INERTIA_LOST

        # The step stands: samples inside it, then on.
        extra = False
        while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t_new:
            asked = sample_times[counts[0]]
            if asked == t_new:
                combine(system.sizes, new, stages, dense, zero, zero, 0.0, samples[counts[0]])
            else:
                if not extra:
                    for k in range(s + 1, dense.shape[0]):
                        out = samples[counts[0]]
                        combine(system.sizes, state, stages, A, k, k, h, out)
                        slope_at(system, t + c[k] * h, from_left, out, torque, stages, k)
                        counts[3] += 1
                    extra = True
                dense_weights(dense, (asked - t) / h, weights)
                rows = dense.shape[0]
                combine(system.sizes, state, stages, weights, zero, rows, h, samples[counts[0]])
            counts[0] += 1
        for level in range(2):
            for i in range(len(system.sizes.bodies)):
                for j in range(1 + len(system.sizes.modes)):
                    state[level, i, j] = new[level, i, j]
                    stages[0, level, i, j] = stages[s, level, i, j]
        t = t_new
        clock[0] = t
        counts[1] += 1
        if adaptive:
            accept_step(clock, h, norm, order, lands)
        if t >= until:
            return DONE
        if lands and t_new < until:  # the torque may jump here: the slope is that from the left
            slope_at(system, t, from_right, state, torque, stages, zero)
            counts[3] += 1
    return PAUSED
