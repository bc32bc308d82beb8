"""Compiled stepping of the generalised-alpha method, with one implicit acceleration per step.

Theory page "integration", (I.9) to (I.11). Coordinates and rates follow Newmark's formulas with an
averaged acceleration. The recursion solves for bending, springs and damping. Posture, velocity
products and mass matrix of the new point are found by repeating it until the change is negligible.
``memory.new`` is the new point after the last pass.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.implicit.additive import shift_forces, soften_for
from flexarm.integrate.memory import COUNT, EVALUATIONS, LENGTH, PLACE, SOFTENED, STEP, Memory
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
from flexarm.kernels.columns import MODE_DAMPING, W2
from flexarm.kernels.compilation.cache import merged, unlocked
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import ArmConstants, Array
from flexarm.kernels.recursion.articulated_body import solve_implicit

#: Number of passes after which a step has failed, and of those that are usual.
_PASSES, _USUAL = 50, 3
#: Allowed change by further passes, relative to the allowed error of a step. It is small because
#: the remaining error has the same sign over thousands of steps. Rounding errors have no common
#: sign: a point is also accepted if its change is below the second number and decreases no more.
_SOLVED, _ROUNDED = 1e-3, 0.1
#: Smallest tolerance relative to the state, because of rounding errors.
_ROUNDING = 1e-12
#: A step does not resolve a mode whose phase changes by more than this angle (rad) in it.
_RESOLVED = 1.6
#: Largest step ratio by which the averaged acceleration is extrapolated.
_GROWTH = 5.0


class NewmarkRecord(NamedTuple):
    """Coefficients of (I.9) and (I.10), and the arrays of a run."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    known: Array  # (2, n, 1 + m) the new point without its own acceleration
    averaged: Array  # (n, 1 + m) averaged acceleration in Newmark's formulas
    ends: Array  # (2, 2, n, 1 + m) rates and accelerations at both ends of a step
    change: Array  # (1, 2, n, 1 + m) change in the last pass
    one: Array  # (2, 1) weights of ``change`` in its norm
    softened: ArmConstants  # with the diagonal for a step of length ``clock[SOFTENED]``


@merged
def _share(record: NewmarkRecord) -> float:
    """Return the coefficient of the new acceleration in the new averaged acceleration."""
    return (1.0 - record.alpha_f) / (1.0 - record.alpha_m)


@merged
def _carry_over(system: System, record: NewmarkRecord, old_h: float, h: float) -> None:
    """Update the averaged acceleration for a new step length, and across a jump, (I.11).

    It approximates the acceleration at a time that differs from the step's end by a fraction of the
    step. ``known[0]`` contains the acceleration before the jump.
    """
    sizes = system.sizes
    averaged = record.averaged
    ratio = 0.0
    if old_h > 0.0:
        ratio = min(h / old_h, _GROWTH)
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            rest = averaged[i, j] - record.known[0, i, j]
            averaged[i, j] = record.ends[0, 1, i, j] + ratio * rest


@merged
def _predict(system: System, record: NewmarkRecord, memory: Memory, h: float) -> None:
    """Predict the new point, and compute ``known``, its part without the new acceleration."""
    sizes = system.sizes
    c, state, smooth, known = system.constants, memory.state, memory.new, record.known
    alpha_m, alpha_f, beta, gamma = record.alpha_m, record.alpha_f, record.beta, record.gamma
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            q = state[0, i, j]
            v = state[1, i, j]
            a = record.ends[0, 1, i, j]
            mean = record.averaged[i, j]
            rest = (alpha_f * a - alpha_m * mean) / (1.0 - alpha_m)
            known[0, i, j] = q + h * (v + h * ((0.5 - beta) * mean + beta * rest))
            known[1, i, j] = v + h * ((1.0 - gamma) * mean + gamma * rest)
            stiff = False
            if j > 0:
                fastest = math.sqrt(real(c.mode[i, j - 1, W2]))
                stiff = h * max(fastest, real(c.mode[i, j - 1, MODE_DAMPING])) > _RESOLVED
            # The acceleration of a mode that the step does not resolve is useless for a prediction.
            smooth[0, i, j] = q if stiff else q + h * (v + 0.5 * h * a)
            smooth[1, i, j] = v if stiff else v + h * a


@merged
def _pass(
    system: System, tolerance: Tolerance, record: NewmarkRecord, memory: Memory, kappa: float,
    lag: float,
) -> float:  # fmt: skip
    """Solve for the new acceleration at ``new``, and update ``new`` with it.

    Returns the largest change over the allowed error.
    """
    sizes, work = system.sizes, system.work
    smooth, known, change = memory.new, record.known, record.change
    shift_forces(system, record.softened, smooth, known, memory.torque)
    solve_implicit(
        sizes, record.softened, smooth, work.force, memory.torque,
        system.drive.loads, work,
    )  # fmt: skip
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            x = work.acceleration[i, j]
            q = known[0, i, j] + kappa * x
            v = known[1, i, j] + lag * x
            change[0, 0, i, j] = q - smooth[0, i, j]
            change[0, 1, i, j] = v - smooth[1, i, j]
            smooth[0, i, j] = q
            smooth[1, i, j] = v
    return error_norm(system.sizes, tolerance, memory.state, smooth, change, record.one, 1.0)


@merged
def _solve(
    system: System, tolerance: Tolerance, record: NewmarkRecord, memory: Memory, t_new: float,
    lands: bool, h: float,
) -> int:  # fmt: skip
    """Repeat passes until the change is negligible; return ``DONE``, or another code on failure."""
    share = _share(record)
    allowed = Tolerance(
        max(tolerance.absolute, _ROUNDING),
        max(tolerance.relative, _ROUNDING),
        tolerance.unit,
        tolerance.fastest,
    )
    norm: float = math.inf
    for trial in range(_PASSES):
        before = norm
        drive_at(system, t_new, lands, memory.torque)
        norm = _pass(
            system, allowed, record, memory, h * h * record.beta * share, h * record.gamma * share
        )
        memory.counts[EVALUATIONS] += 1
        if not math.isfinite(norm):
            return NOT_FINITE if trial == 0 else NOT_CONVERGED
        # Estimated change by all further passes, if they decrease at the present ratio.
        if norm == 0.0 or (trial > 0 and norm * norm <= _SOLVED * (before - norm)):
            return DONE
        if trial > _USUAL and before <= norm <= _ROUNDED:
            return DONE
    return NOT_CONVERGED


@unlocked
def advance_newmark(
    system: System,
    tolerance: Tolerance,
    record: NewmarkRecord,
    memory: Memory,
    until: float,
    max_steps: int,
) -> int:
    """Step to ``until``, by the rules of ``base.Integrator``."""
    sizes = system.sizes
    # Typed constants: with literals, the compiler would build each callee for every value.
    zero = int(np.int64(0))
    from_right = bool(np.bool_(False))
    stays = from_right  # joints do not stick
    damps = from_right  # vibrations remain for some steps
    clock, counts, new = memory.clock, memory.counts, memory.new
    averaged, ends = record.averaged, record.ends
    share = _share(record)
    t = begin_call(sizes, memory)
    for _ in range(max_steps):
        if t >= until:
            break
        if clock[PLACE] >= clock[COUNT]:  # a new span begins
            old_h = clock[LENGTH]
            begin_span(system.drive.stops, t, until, clock[STEP], clock)
            h = clock[LENGTH]
            if h != clock[SOFTENED]:
                soften_for(
                    system, record.softened, h * record.gamma * share, h * record.beta * share * h
                )
                clock[SOFTENED] = h
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    record.known[0, i, j] = ends[0, 1, i, j]
            slope_at(system, t, from_right, memory.state, memory.torque, ends, zero, stays)
            counts[EVALUATIONS] += 1
            _carry_over(system, record, old_h, h)
        h = clock[LENGTH]
        t_new, lands = step_of_span(clock)
        _predict(system, record, memory, h)
        status = _solve(system, tolerance, record, memory, t_new, lands, h)
        if status == DONE:
            status = followed(sizes, tolerance, new, h)
        if status == DONE and not inertia_left(system):
            status = INERTIA_LOST
        if status != DONE:
            return status
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                ends[0, 0, i, j] = memory.state[1, i, j]
                ends[1, 0, i, j] = new[1, i, j]
                ends[1, 1, i, j] = system.work.acceleration[i, j]
        samples_between(system, tolerance, memory, ends, t, h, t_new, damps)
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                rest = record.alpha_f * ends[0, 1, i, j] - record.alpha_m * averaged[i, j]
                averaged[i, j] = share * ends[1, 1, i, j] + rest / (1.0 - record.alpha_m)
                ends[0, 1, i, j] = ends[1, 1, i, j]
        end_step(sizes, memory, new, t_new)
        t = t_new
        clock[PLACE] += 1.0
    return DONE if t >= until else PAUSED
