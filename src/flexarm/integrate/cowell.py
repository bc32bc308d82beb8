"""Compiled stepping of Cowell's method of order 4, linearly implicit: one evaluation a step.

Theory page "integration", (I.5) to (I.8). Positions obey the symmetric two-step formula that is
also Numerov's. The bending forces at the new time are implicit; posture, speeds and mass matrix at
the new time are predicted.

=============  =============================================================================
symbol         meaning
=============  =============================================================================
``past``       (4, 3, n, 1 + m) the last four points; place ``k & 3`` holds point k of the
               span: coordinates, rates, accelerations
``rise``       (n, 1 + m) q_k - q_(k-1), kept as a sum of its own: no digits are lost
``stiff``      (n, 1 + m) 1.0 where a damped mode is too fast for the formula
``span``       the present span between two stops, see ``steps``
``missed``     (3,) sums of ``_follows``, and steps since the last look
=============  =============================================================================
"""

from __future__ import annotations

import numpy as np

from flexarm.integrate.additive import additive_step
from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.resolved_modes import BETA, GAMMA, longest_step, soften
from flexarm.integrate.steps import (
    COUNT,
    DONE,
    END,
    INERTIA_LOST,
    LENGTH,
    NOT_FOLLOWED,
    PAUSED,
    PLACE,
    SHORT,
    START,
    TIME,
    begin_span,
    combine,
    coordinate_between,
    followed,
    inertia_left,
    rate_between,
)
from flexarm.integrate.torque import loads_at, piece_after, piece_of, slope_at, torque_in
from flexarm.kernels.articulated_body import solve_implicit
from flexarm.kernels.cache import compiled, inner, merged
from flexarm.kernels.columns import FREE, JOINT_DAMPING, JOINT_STIFFNESS, MODE_DAMPING, W2
from flexarm.kernels.layout import ArmConstants, Array, Sizes

#: Points that the formulas look back on; the first ones of a span come from a one-step method.
_STARTED = 3
#: What the weight of the new acceleration has more in (I.8) than in (I.5).
_SHARE = 0.25 - BETA
#: Two lengths of a step are one if their ratio differs from 1 by less: ``begin_span`` rounds so.
_SAME = 1.0 - 1e-8
#: Every so many steps the accelerations of predicted posture and rates are compared with those of
#: the posture and the rates that came of them: three per cent of the work.
_LOOK = 32
#: How much of what was seen before is kept at a look: the last fifty count.
_KEPT = 0.98
#: Largest part of the accelerations of the joints that the predictions may miss. Of 432 runs of 48
#: random arms without damping, with steps of 0.5 to 8 over the highest frequency, 59 stop here and
#: 6 elsewhere; the tip errs by more than 5 mm in 3 of the others.
_MISSED = 0.005
#: Parts of the arm's reach that the misses must have added up to, or the absolute tolerance where
#: that is more: at rest all is rounding.
_NOTICED = 1e-4


@merged
def _predict(
    system: System, stiff: Array, past: Array, rise: Array, k: int, h: float, smooth: Array,
    known: Array, force: Array, torque: Array,
) -> None:  # fmt: skip
    """From points up to k: the smooth state of point k + 1, what is known of q and v there.

    ``known`` receives the rise of q and the rate without the new acceleration; ``force`` and
    ``torque`` move bending, springs and damping from the smooth state to it.
    """
    r0 = k & 3
    r1 = (k - 1) & 3
    r2 = (k - 2) & 3
    r3 = (k - 3) & 3
    per_step = 1.0 / h
    square = h * h
    c = system.constants
    for i in range(len(system.sizes.bodies)):
        for j in range(1 + len(system.sizes.modes)):
            q0 = past[r0, 0, i, j]
            v0 = past[r0, 1, i, j]
            a0 = square * past[r0, 2, i, j]
            a1 = square * past[r1, 2, i, j]
            if stiff[i, j] == 0.0:
                a2 = square * past[r2, 2, i, j]
                a3 = square * past[r3, 2, i, j]
                step = rise[i, j] + (10.0 / 12.0) * a0 + (1.0 / 12.0) * a1
                rate = per_step * (
                    step
                    + (3.0 / 8.0) * a0
                    - (47.0 / 240.0) * a1
                    + (29.0 / 360.0) * a2
                    - (7.0 / 480.0) * a3
                )
                q = (1.0 / 12.0) * (14.0 * a0 - 5.0 * a1 + 4.0 * a2 - a3)
                q += q0 + rise[i, j]
                v = (1.0 / 24.0) * (55.0 * a0 - 59.0 * a1 + 37.0 * a2 - 9.0 * a3)
                v = v0 + per_step * v
            else:
                step = rise[i, j] + 0.5 * a0 + 0.25 * a1
                rate = per_step * (step + 0.25 * a0)
                q = 3.0 * (q0 - past[r1, 0, i, j]) + past[r2, 0, i, j]
                v = 3.0 * (v0 - past[r1, 1, i, j]) + past[r2, 1, i, j]
            smooth[0, i, j] = q
            smooth[1, i, j] = v
            known[0, i, j] = step
            known[1, i, j] = rate
            if j > 0:
                force[i, j] = c.mode[i, j - 1, W2] * (q - q0 - step) + c.mode[
                    i, j - 1, MODE_DAMPING
                ] * (v - rate)
            else:
                torque[i] += c.body[i, FREE] * (
                    c.body[i, JOINT_STIFFNESS] * (q - q0 - step)
                    + c.body[i, JOINT_DAMPING] * (v - rate)
                )


@merged
def _correct(
    system: System, stiff: Array, past: Array, rise: Array, k: int, h: float, known: Array
) -> None:  # fmt: skip
    """Make point k + 1 from its accelerations."""
    old = k & 3
    new = (k + 1) & 3
    for i in range(len(system.sizes.bodies)):
        for j in range(1 + len(system.sizes.modes)):
            x = system.work.acceleration[i, j]
            beta = BETA
            gamma = BETA + GAMMA
            if stiff[i, j] != 0.0:
                beta = 0.25
                gamma = 0.5
            step = known[0, i, j] + h * h * beta * x
            rise[i, j] = step
            past[new, 0, i, j] = past[old, 0, i, j] + step
            past[new, 1, i, j] = known[1, i, j] + h * gamma * x
            past[new, 2, i, j] = x


@inner
def _remember(
    sizes: Sizes, stiff: Array, past: Array, rise: Array, k: int, h: float, state: Array,
    stage: Array,
) -> None:  # fmt: skip
    """Store point k of a span that a one-step method has made."""
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            rise[i, j] = state[0, i, j] - past[(k - 1) & 3, 0, i, j]
            if stiff[i, j] != 0.0:  # both formulas start with the same momentum
                change = stage[1, i, j] - past[(k - 1) & 3, 2, i, j]
                rise[i, j] += _SHARE * h * h * change
            past[k & 3, 0, i, j] = state[0, i, j]
            past[k & 3, 1, i, j] = state[1, i, j]
            past[k & 3, 2, i, j] = stage[1, i, j]


@inner
def _restore(sizes: Sizes, past: Array, k: int, state: Array) -> None:
    """Write point k of the span into the state."""
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                state[level, i, j] = past[k & 3, level, i, j]


@merged
def _follows(
    system: System, tolerance: Tolerance, past: Array, k: int, h: float, slope: Array,
    missed: Array,
) -> bool:  # fmt: skip
    """Whether the accelerations at point k are, so far, those of the posture and rates there.

    ``slope`` (2, n, 1 + m) holds the latter; ``missed`` the sums over the last looks of what the
    joints miss and of what they feel, in rates per metre at the tip, below (I.8).
    """
    missed[0] *= _KEPT
    missed[1] *= _KEPT
    miss: float = 0.0
    size: float = 0.0
    for i in range(len(system.sizes.bodies)):
        used = past[k & 3, 2, i, 0]
        miss = max(miss, abs(slope[1, i, 0] - used) / tolerance.unit[1, i, 0])
        size = max(size, abs(used) / tolerance.unit[1, i, 0])
    missed[0] += _LOOK * h * miss
    missed[1] += _LOOK * h * size
    least = max(_NOTICED / tolerance.unit[0, 0, 0], tolerance.absolute)
    return not (missed[0] > least and missed[0] > _MISSED * missed[1])


@inner
def _between(
    sizes: Sizes, tolerance: Tolerance, stiff: Array, past: Array, k: int, h: float, x: float,
    sample: Array,
) -> None:  # fmt: skip
    """Sample at x (0 to 1) between points k - 1 and k: Hermite; cubic Lagrange of stiff modes."""
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


@compiled
def advance_cowell(
    system: System,
    softened: ArmConstants,
    starter: ArmConstants,
    tolerance: Tolerance,
    AE: Array,
    AI: Array,
    c: Array,
    state: Array,
    smooth: Array,
    known: Array,
    past: Array,
    rise: Array,
    stiff: Array,
    added: Array,
    force: Array,
    torque: Array,
    stages: Array,
    clock: Array,
    span: Array,
    missed: Array,
    bounds: Array,
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
    from_left = bool(np.bool_(True))
    from_right = bool(np.bool_(False))
    last_stage = AE.shape[0] - 1
    t = clock[TIME]
    while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t:
        combine(system.sizes, state, stages, AE, zero, zero, 0.0, samples[counts[0]])
        counts[0] += 1
    piece = piece_of(system.drive.breaks, t, from_left)
    for _ in range(max_steps):
        if t >= until:
            break
        if span[PLACE] >= span[COUNT]:  # a new span begins
            longest = step
            # A shorter step may resolve a mode that was stiff, and so ask for a shorter one again.
            while True:
                begin_span(system.drive.stops, t, until, longest, span)
                longest = longest_step(
                    system, state, smooth, known, force, torque, stiff, bounds, span[LENGTH],
                    span[END] - span[START],
                )  # fmt: skip
                if not longest < span[LENGTH] * _SAME:
                    break
            soften(system, softened, stiff, added, span[LENGTH])
            slope_at(system, t, from_right, state, torque, stages, zero)
            counts[3] += 1
            _remember(system.sizes, stiff, past, rise, zero, 0.0, state, stages[0])
        h = span[LENGTH]
        k = int(span[PLACE])
        lands = span[PLACE] + 1.0 >= span[COUNT]
        t_new = span[START] + (k + 1) * h
        if lands:
            t_new = span[END]
        if k < _STARTED:
            additive_step(
                system, starter, AE, AI, c, t, h, state, smooth, known, added, force, torque,
                stages, clock,
            )  # fmt: skip
            status = followed(system.sizes, tolerance, smooth, h)
            if status != DONE:
                return status
            slope_at(system, t_new, from_left, smooth, torque, stages, zero)
            combine(system.sizes, smooth, stages, AE, zero, zero, 0.0, state)
            _remember(system.sizes, stiff, past, rise, k + 1, h, state, stages[0])
            counts[3] += last_stage
        else:
            piece = piece_after(system.drive.breaks, t_new, piece)
            torque_in(system, piece, t_new, torque)
            if system.drive.factor_coefficients.shape[2] > 0:
                loads_at(system, t_new, lands)
            _predict(system, stiff, past, rise, k, h, smooth, known, force, torque)
            solve_implicit(
                system.sizes, softened, smooth, force, torque, system.drive.loads, system.work
            )
            counts[3] += 1
            _correct(system, stiff, past, rise, k, h, known)
            status = followed(system.sizes, tolerance, past[(k + 1) & 3], h)
            if status != DONE:
                _restore(system.sizes, past, k, state)
                return status
        if not inertia_left(system):
            _restore(system.sizes, past, k, state)
            return INERTIA_LOST
        if lands:
            _restore(system.sizes, past, k + 1, state)
        if k >= _STARTED:
            missed[2] += 1.0
        if missed[2] >= _LOOK:
            missed[2] = 0.0
            _restore(system.sizes, past, k + 1, smooth)
            slope_at(system, t_new, from_left, smooth, torque, stages, last_stage)
            counts[3] += 1
            if not _follows(system, tolerance, past, k + 1, h, stages[last_stage], missed):
                _restore(system.sizes, past, k, state)
                return NOT_FOLLOWED
        while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t_new:
            asked = sample_times[counts[0]]
            if asked == t_new:
                _restore(system.sizes, past, k + 1, samples[counts[0]])
            else:
                _between(
                    system.sizes, tolerance, stiff, past, k + 1, h, (asked - t) / h,
                    samples[counts[0]],
                )  # fmt: skip
            counts[0] += 1
        t = t_new
        clock[TIME] = t
        span[PLACE] += 1.0
        counts[1] += 1
    if span[PLACE] < span[COUNT]:
        _restore(system.sizes, past, int(span[PLACE]), state)
    return DONE if t >= until else PAUSED
