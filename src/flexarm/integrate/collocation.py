"""Compiled stepping of Gauss collocation: implicit stages, solved to rounding by the recursion.

Theory page "integration", (I.12) to (I.15). A sweep updates the accelerations of all stages in
turn, each by one pass of the recursion that takes bending, springs and damping as implicit. What is
left to the iteration is smooth, so few sweeps do.

=============  =============================================================================
symbol         meaning
=============  =============================================================================
``A, AA``      (s, s) coefficients of the stages, and their square
``b, bA``      (s,) weights of the new rates and, with h^2, of the new coordinates
``pull, drag`` what h^2 K and h D are multiplied by on the diagonal
``stages``     (s, n, 1 + m) accelerations; ``earlier``: those of the last two steps
``guess``      (2, s, 2 s) weights of a first guess by the last step, by the last two
``change``     (1, 2, n, 1 + m) what a sweep changed of a stage
``lost``       (2, n, 1 + m) digits that the sum of all steps has lost: summed up apart
=============  =============================================================================
"""

from __future__ import annotations

import math

import numpy as np

from flexarm.integrate.additive import SOFTENED, soften_for
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
from flexarm.kernels.columns import FREE, JOINT_DAMPING, JOINT_STIFFNESS, MODE_DAMPING, W2
from flexarm.kernels.layout import ArmConstants, Array

#: Sweeps after which a step has failed; three to ten are usual.
_SWEEPS = 100
#: A change this many times above what is asked for counts as noise of rounding once it has not
#: shrunk for some sweeps; a larger one, which only very fast modes make, after more of them:
#: changes may swing.
_NOISE, _STALLED = 1e3, 2
_LARGE_NOISE, _LONG_STALLED = 1e8, 10


@merged
def _guess(system: System, weights: Array, row: int, earlier: Array, stages: Array) -> None:
    """First guess of the accelerations of the stages, from those of earlier steps."""
    for k in range(stages.shape[0]):
        for i in range(len(system.sizes.bodies)):
            for j in range(1 + len(system.sizes.modes)):
                total = 0.0
                for p in range(earlier.shape[0]):
                    total += weights[row, k, p] * earlier[p, i, j]
                stages[k, i, j] = total


@merged
def _sweep(
    system: System, softened: ArmConstants, rounding: Tolerance, A: Array, AA: Array, c: Array,
    pull: float, drag: float, t: float, h: float, state: Array, stages: Array, inner: Array,
    force: Array, torque: Array, change: Array, one: Array,
) -> float:  # fmt: skip
    """Update the accelerations of all stages; return the largest change, rounding being one."""
    k = system.constants
    worst: float = 0.0
    for s in range(stages.shape[0]):
        drive_at(system, t + c[s] * h, False, torque)
        for i in range(len(system.sizes.bodies)):
            for j in range(1 + len(system.sizes.modes)):
                rise = c[s] * state[1, i, j]
                rate = 0.0
                for p in range(stages.shape[0]):
                    rise += h * AA[s, p] * stages[p, i, j]
                    rate += A[s, p] * stages[p, i, j]
                inner[0, i, j] = state[0, i, j] + h * rise
                inner[1, i, j] = state[1, i, j] + h * rate
            added = h * drag * k.body[i, JOINT_DAMPING] + h * h * pull * k.body[i, JOINT_STIFFNESS]
            torque[i] += k.body[i, FREE] * added * stages[s, i, 0]
            for j in range(len(system.sizes.modes)):
                added = h * drag * k.mode[i, j, MODE_DAMPING] + h * h * pull * k.mode[i, j, W2]
                force[i, 1 + j] = added * stages[s, i, 1 + j]
        solve_implicit(
            system.sizes, softened, inner, force, torque, system.drive.loads, system.work
        )
        for i in range(len(system.sizes.bodies)):
            for j in range(1 + len(system.sizes.modes)):
                x = system.work.acceleration[i, j]
                change[0, 0, i, j] = h * h * pull * (x - stages[s, i, j])
                change[0, 1, i, j] = h * drag * (x - stages[s, i, j])
                stages[s, i, j] = x
        worst = max(worst, error_norm(system, rounding, state, inner, change, one, one, 1.0))
    return worst


@merged
def _new_point(
    system: System, b: Array, bA: Array, h: float, state: Array, stages: Array, lost: Array,
    new: Array,
) -> None:  # fmt: skip
    """Make the new point, summing up apart what each addition rounds away."""
    for i in range(len(system.sizes.bodies)):
        for j in range(1 + len(system.sizes.modes)):
            rise = state[1, i, j]
            rate = 0.0
            for p in range(stages.shape[0]):
                rise += h * bA[p] * stages[p, i, j]
                rate += b[p] * stages[p, i, j]
            for level in range(2):
                step = h * (rise if level == 0 else rate) + lost[level, i, j]
                old = state[level, i, j]
                new[level, i, j] = old + step
                lost[level, i, j] = step - (new[level, i, j] - old)


@compiled
def advance_collocation(
    system: System,
    softened: ArmConstants,
    tolerance: Tolerance,
    rounding: Tolerance,
    A: Array,
    AA: Array,
    b: Array,
    bA: Array,
    c: Array,
    pull: float,
    drag: float,
    guess: Array,
    state: Array,
    new: Array,
    inner: Array,
    lost: Array,
    stages: Array,
    earlier: Array,
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
    last = int(np.int64(1))
    from_left = bool(np.bool_(True))
    from_right = bool(np.bool_(False))
    count = stages.shape[0]
    t = clock[TIME]
    while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t:
        combine(system.sizes, state, ends, A, zero, zero, 0.0, samples[counts[0]])
        counts[0] += 1
    for _ in range(max_steps):
        if t >= until:
            break
        if span[PLACE] >= span[COUNT]:  # a new span begins
            begin_span(system.drive.stops, t, until, step, span)
            if span[LENGTH] != clock[SOFTENED]:
                h = span[LENGTH]
                soften_for(system, softened, added, h * drag, h * h * pull)
                clock[SOFTENED] = h
            slope_at(system, t, from_right, state, torque, ends, zero)
            counts[3] += 1
            for p in range(2 * count):
                for i in range(len(system.sizes.bodies)):
                    for j in range(1 + len(system.sizes.modes)):
                        earlier[p, i, j] = ends[0, 1, i, j]
        h = span[LENGTH]
        lands = span[PLACE] + 1.0 >= span[COUNT]
        t_new = span[START] + (span[PLACE] + 1.0) * h
        if lands:
            t_new = span[END]
        row = 1 if span[PLACE] > 1.0 else 0
        _guess(system, guess, row, earlier, stages)
        least: float = math.inf
        stalled = 0
        solved = False
        for sweep in range(_SWEEPS):
            norm = _sweep(
                system, softened, rounding, A, AA, c, pull, drag, t, h, state, stages, inner,
                force, torque, change, one,
            )  # fmt: skip
            counts[3] += count
            if not math.isfinite(norm):
                return NOT_FINITE if sweep == 0 else NOT_CONVERGED
            if norm < 0.9 * least:
                least = norm
                stalled = 0
            else:
                stalled += 1
            solved = norm <= 1.0 or stalled >= (_STALLED if norm < _NOISE else _LONG_STALLED)
            solved = solved and norm < _LARGE_NOISE
            if solved:
                break
        if not solved:
            return NOT_CONVERGED
        if not inertia_left(system):
            return INERTIA_LOST
        _new_point(system, b, bA, h, state, stages, lost, new)
        status = followed(system.sizes, tolerance, new, h)
        if status != DONE:
            return status

        between = False
        while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t_new:
            asked = sample_times[counts[0]]
            if asked == t_new:
                combine(system.sizes, new, ends, A, zero, zero, 0.0, samples[counts[0]])
            else:
                if not between:
                    slope_at(system, t, from_right, state, torque, ends, zero)
                    slope_at(system, t_new, from_left, new, torque, ends, last)
                    counts[3] += 2
                    between = True
                between_ends(
                    system.sizes, system.constants, tolerance, state, new, ends, (asked - t) / h,
                    h, samples[counts[0]],
                )  # fmt: skip
            counts[0] += 1
        for i in range(len(system.sizes.bodies)):
            for j in range(1 + len(system.sizes.modes)):
                for level in range(2):
                    state[level, i, j] = new[level, i, j]
                for p in range(count):
                    earlier[p, i, j] = earlier[count + p, i, j]
                    earlier[count + p, i, j] = stages[p, i, j]
        t = t_new
        clock[TIME] = t
        span[PLACE] += 1.0
        counts[1] += 1
    return DONE if t >= until else PAUSED
