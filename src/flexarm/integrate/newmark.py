"""Compiled stepping of the generalised-alpha method: one implicit acceleration a step.

Theory page "integration", (I.9) to (I.11). Coordinates and rates follow Newmark's formulas with an
averaged acceleration. Bending, springs and damping are solved for by the recursion; posture,
velocity products and mass matrix of the new point by repeating that until nothing changes.

=============  =============================================================================
symbol         meaning
=============  =============================================================================
``rule``       alpha_m, alpha_f, beta, gamma
``ends``       (2, 2, n, 1 + m) rates and accelerations at both ends of a step
``averaged``   (n, 1 + m) the acceleration that Newmark's formulas take
``smooth``     the new point as the last pass left it
``known``      the new point without its own acceleration
=============  =============================================================================
"""

from __future__ import annotations

import math

import numpy as np

from flexarm.integrate.additive import SOFTENED, shift_forces, soften_for
from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.steps import (
    COUNT,
    DONE,
    END,
    INERTIA_LOST,
    LENGTH,
    NOT_CONVERGED,
    NOT_FINITE,
    PAUSED,
    PLACE,
    RESOLVED,
    START,
    TIME,
    begin_span,
    between_ends,
    combine,
    error_norm,
    followed,
    inertia_left,
)
from flexarm.integrate.torque import drive_at, slope_at
from flexarm.kernels.articulated_body import solve_implicit
from flexarm.kernels.cache import compiled, merged
from flexarm.kernels.columns import MODE_DAMPING, W2
from flexarm.kernels.layout import ArmConstants, Array

#: Passes after which a step has failed; two or three are usual.
_PASSES = 50
#: What further passes would change, as a part of what a step may err by: little, because it is of
#: one sign over thousands of steps.
_SOLVED = 1e-3
#: Largest growth from one step to the next that the averaged acceleration is carried over.
_GROWTH = 5.0


@merged
def _carry_over(
    system: System, old_h: float, h: float, before: Array, ends: Array, averaged: Array
) -> None:
    """Carry the averaged acceleration over to steps of another length, and across a jump.

    It stands for a time that differs from the step's end by a part of the step.
    """
    ratio = 0.0
    if old_h > 0.0:
        ratio = min(h / old_h, _GROWTH)
    for i in range(len(system.sizes.bodies)):
        for j in range(1 + len(system.sizes.modes)):
            averaged[i, j] = ends[0, 1, i, j] + ratio * (averaged[i, j] - before[i, j])


@merged
def _predict(
    system: System, rule: Array, h: float, state: Array, ends: Array, averaged: Array,
    smooth: Array, known: Array,
) -> None:  # fmt: skip
    """A first ``smooth`` state of the new point, and what is ``known`` of it."""
    c = system.constants
    alpha_m, alpha_f, beta, gamma = rule[0], rule[1], rule[2], rule[3]
    for i in range(len(system.sizes.bodies)):
        for j in range(1 + len(system.sizes.modes)):
            q = state[0, i, j]
            v = state[1, i, j]
            a = ends[0, 1, i, j]
            mean = averaged[i, j]
            rest = (alpha_f * a - alpha_m * mean) / (1.0 - alpha_m)
            known[0, i, j] = q + h * (v + h * ((0.5 - beta) * mean + beta * rest))
            known[1, i, j] = v + h * ((1.0 - gamma) * mean + gamma * rest)
            stiff = False
            if j > 0:
                stiff = (
                    h * max(math.sqrt(c.mode[i, j - 1, W2]), c.mode[i, j - 1, MODE_DAMPING])
                    > RESOLVED
                )
            # The acceleration of a mode that the step does not resolve predicts nothing.
            smooth[0, i, j] = q if stiff else q + h * (v + 0.5 * h * a)
            smooth[1, i, j] = v if stiff else v + h * a


@merged
def _pass(
    system: System, softened: ArmConstants, tolerance: Tolerance, kappa: float, lag: float,
    state: Array, smooth: Array, known: Array, force: Array, torque: Array, change: Array,
    one: Array,
) -> float:  # fmt: skip
    """Solve for the new acceleration at ``smooth``, and move ``smooth`` to what follows from it.

    Returns the largest change over what a step may err by.
    """
    shift_forces(system, smooth, known[0], known[1], force, torque)
    solve_implicit(system.sizes, softened, smooth, force, torque, system.drive.loads, system.work)
    for i in range(len(system.sizes.bodies)):
        for j in range(1 + len(system.sizes.modes)):
            x = system.work.acceleration[i, j]
            q = known[0, i, j] + kappa * x
            v = known[1, i, j] + lag * x
            change[0, 0, i, j] = q - smooth[0, i, j]
            change[0, 1, i, j] = v - smooth[1, i, j]
            smooth[0, i, j] = q
            smooth[1, i, j] = v
    return error_norm(system, tolerance, state, smooth, change, one, one, 1.0)


@compiled
def advance_newmark(
    system: System,
    softened: ArmConstants,
    tolerance: Tolerance,
    rule: Array,
    state: Array,
    smooth: Array,
    known: Array,
    averaged: Array,
    ends: Array,
    added: Array,
    force: Array,
    torque: Array,
    change: Array,
    one: Array,
    clock: Array,
    span: Array,
    counts: Array,
    step: float,
    until: float,
    sample_times: Array,
    samples: Array,
    max_steps: int,
) -> int:
    """Step from ``clock[0]`` to ``until``; see ``base.Integrator`` for the rules kept."""
    # Typed constants: literals would make the compiler build a copy of each callee for each value.
    zero = int(np.int64(0))
    from_right = bool(np.bool_(False))
    new = smooth
    # Part of the new averaged acceleration that is the new true one.
    part = (1.0 - rule[1]) / (1.0 - rule[0])
    t = clock[TIME]
    while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t:
        combine(system.sizes, state, ends, added, zero, zero, 0.0, samples[counts[0]])
        counts[0] += 1
    for _ in range(max_steps):
        if t >= until:
            break
        if span[PLACE] >= span[COUNT]:  # a new span begins
            old_h = span[LENGTH]
            begin_span(system.drive.stops, t, until, step, span)
            h = span[LENGTH]
            if h != clock[SOFTENED]:
                soften_for(system, softened, added, h * rule[3] * part, h * rule[2] * part * h)
                clock[SOFTENED] = h
            for i in range(len(system.sizes.bodies)):
                for j in range(1 + len(system.sizes.modes)):
                    known[0, i, j] = ends[0, 1, i, j]
            slope_at(system, t, from_right, state, torque, ends, zero)
            counts[3] += 1
            _carry_over(system, old_h, h, known[0], ends, averaged)
        h = span[LENGTH]
        lands = span[PLACE] + 1.0 >= span[COUNT]
        t_new = span[START] + (span[PLACE] + 1.0) * h
        if lands:
            t_new = span[END]
        _predict(system, rule, h, state, ends, averaged, smooth, known)
        norm: float = math.inf
        solved = False
        for trial in range(_PASSES):
            before = norm
            drive_at(system, t_new, lands, torque)
            norm = _pass(
                system, softened, tolerance, h * h * rule[2] * part, h * rule[3] * part, state,
                smooth, known, force, torque, change, one,
            )  # fmt: skip
            counts[3] += 1
            if not math.isfinite(norm):
                return NOT_FINITE if trial == 0 else NOT_CONVERGED
            # What further passes would change, if they shrink as this one did.
            solved = trial > 0 and norm * norm <= _SOLVED * (before - norm)
            if solved or norm == 0.0:
                break
        if not (solved or norm == 0.0):
            return NOT_CONVERGED
        status = followed(system.sizes, tolerance, new, h)
        if status != DONE:
            return status
        if not inertia_left(system):
            return INERTIA_LOST
        for i in range(len(system.sizes.bodies)):
            for j in range(1 + len(system.sizes.modes)):
                ends[0, 0, i, j] = state[1, i, j]
                ends[1, 0, i, j] = new[1, i, j]
                ends[1, 1, i, j] = system.work.acceleration[i, j]

        while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t_new:
            asked = sample_times[counts[0]]
            if asked == t_new:
                combine(system.sizes, new, ends, added, zero, zero, 0.0, samples[counts[0]])
            else:
                between_ends(
                    system.sizes, system.constants, tolerance, state, new, ends, (asked - t) / h,
                    h, samples[counts[0]],
                )  # fmt: skip
            counts[0] += 1
        for i in range(len(system.sizes.bodies)):
            for j in range(1 + len(system.sizes.modes)):
                rest = rule[1] * ends[0, 1, i, j] - rule[0] * averaged[i, j]
                averaged[i, j] = part * ends[1, 1, i, j] + rest / (1.0 - rule[0])
                ends[0, 1, i, j] = ends[1, 1, i, j]
                for level in range(2):
                    state[level, i, j] = new[level, i, j]
        t = t_new
        clock[TIME] = t
        span[PLACE] += 1.0
        counts[1] += 1
    return DONE if t >= until else PAUSED
