"""Compiled stepping of additive Runge-Kutta methods: bending and damping implicit.

Theory page "integration", (I.1) to (I.4). Each stage has two states: an explicit one for what is
smooth (posture, speeds, mass matrix, loads) and an implicit one for the forces of bending, of joint
springs and of damping, in which the equations are linear. So a stage is one pass of the recursion
with a diagonal added to the mass matrix, without iteration.

=============  =============================================================================
symbol         meaning
=============  =============================================================================
``AE, AI``     (s, s) coefficients of the explicit and of the implicit state
``gamma``      the diagonal of AI, one number; the first stage is explicit
``smooth``     explicit state of a stage
``known``      implicit state of a stage, as far as earlier stages make it
``stages``     (s + 1, 2, n, 1 + m) derivatives; stage s is that at the new point
``softened``   constants with the diagonal of a step of length ``clock[SOFTENED]``
=============  =============================================================================
"""

from __future__ import annotations

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.joint_stops import step_to_stop
from flexarm.integrate.nearness import PRESSED_THROUGH, step_allowed, step_on
from flexarm.integrate.steps import (
    CLOCK_PLACES,
    DONE,
    IMPACTS,
    INERTIA_LOST,
    PAUSED,
    accept_step,
    between_ends,
    combine,
    error_norm,
    inertia_left,
    next_stop,
    refuse_beyond,
    refuse_step,
)
from flexarm.integrate.torque import drive_at, slope_at
from flexarm.kernels.articulated_body import solve_implicit
from flexarm.kernels.cache import compiled, inner, merged
from flexarm.kernels.columns import FREE, JOINT_DAMPING, JOINT_STIFFNESS, MODE_DAMPING, W2
from flexarm.kernels.implicit_step import add_to_diagonal
from flexarm.kernels.layout import ArmConstants, Array

#: Place in ``clock`` of the step that the constants are softened for.
SOFTENED = CLOCK_PLACES


@merged
def soften_for(
    system: System, softened: ArmConstants, added: Array, damping: float, stiffness: float
) -> None:
    """Add ``damping`` (s) times D and ``stiffness`` (s^2) times K to the mass matrix."""
    c = system.constants
    for i in range(len(system.sizes.bodies)):
        added[i, 0] = damping * c.body[i, JOINT_DAMPING] + stiffness * c.body[i, JOINT_STIFFNESS]
        for j in range(len(system.sizes.modes)):
            added[i, 1 + j] = damping * c.mode[i, j, MODE_DAMPING] + stiffness * c.mode[i, j, W2]
    add_to_diagonal(system.sizes, c, added, softened)


@merged
def shift_forces(
    system: System, smooth: Array, q: Array, v: Array, force: Array, torque: Array
) -> None:
    """Move bending, springs and damping from the smooth state (2, n, 1 + m) to the one at q, v."""
    c = system.constants
    for i in range(len(system.sizes.bodies)):
        torque[i] += c.body[i, FREE] * (
            c.body[i, JOINT_STIFFNESS] * (smooth[0, i, 0] - q[i, 0])
            + c.body[i, JOINT_DAMPING] * (smooth[1, i, 0] - v[i, 0])
        )
        for j in range(len(system.sizes.modes)):
            force[i, 1 + j] = c.mode[i, j, W2] * (smooth[0, i, 1 + j] - q[i, 1 + j]) + c.mode[
                i, j, MODE_DAMPING
            ] * (smooth[1, i, 1 + j] - v[i, 1 + j])


@inner
def additive_step(
    system: System, softened: ArmConstants, AE: Array, AI: Array, c: Array, t: float, h: float,
    state: Array, smooth: Array, known: Array, added: Array, force: Array, torque: Array,
    stages: Array, clock: Array,
) -> None:  # fmt: skip
    """Fill ``stages[1:s]`` from ``stages[0]``, and ``smooth`` with the new point."""
    s = AE.shape[0] - 1
    gamma = AI[1, 1]
    if h != clock[SOFTENED]:
        soften_for(system, softened, added, h * gamma, h * gamma * h * gamma)
        clock[SOFTENED] = h
    for k in range(1, s):
        combine(system.sizes, state, stages, AE, k, k, h, smooth)
        combine(system.sizes, state, stages, AI, k, k, h, known)
        for i in range(len(system.sizes.bodies)):
            for j in range(1 + len(system.sizes.modes)):
                known[0, i, j] += h * gamma * known[1, i, j]
        drive_at(system, t + c[k] * h, c[k] == 1.0, torque)
        shift_forces(system, smooth, known[0], known[1], force, torque)
        solve_implicit(
            system.sizes, softened, smooth, force, torque, system.drive.loads, system.work
        )
        for i in range(len(system.sizes.bodies)):
            for j in range(1 + len(system.sizes.modes)):
                change = system.work.acceleration[i, j]
                stages[k, 0, i, j] = known[1, i, j] + h * gamma * change
                stages[k, 1, i, j] = change
    combine(system.sizes, state, stages, AE, s, s, h, smooth)


@compiled
def advance_additive(
    system: System,
    softened: ArmConstants,
    tolerance: Tolerance,
    AE: Array,
    AI: Array,
    c: Array,
    error: Array,
    error_low: Array,
    order: int,
    state: Array,
    smooth: Array,
    known: Array,
    added: Array,
    force: Array,
    torque: Array,
    stages: Array,
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
    controlled = from_left
    s = error.shape[0] - 1
    new = smooth
    t = clock[0]
    while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t:
        combine(system.sizes, state, stages, AE, zero, zero, 0.0, samples[counts[0]])
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
        lands = t + h * 1.000001 >= stop
        t_new = t + h
        if lands:
            t_new = stop
            h = stop - t
        additive_step(
            system, softened, AE, AI, c, t, h, state, smooth, known, added, force, torque, stages,
            clock,
        )  # fmt: skip
        counts[3] += s - 1
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
        slope_at(system, t_new, from_left, new, torque, stages, s)
        counts[3] += 1
        if touchable:
            allowed = step_allowed(contacts, h, controlled)
            if allowed == 0.0:
                return PRESSED_THROUGH
            if allowed < h:
                refuse_beyond(clock, counts, allowed)
                continue
            step_on(contacts)
        if not inertia_left(system):
            return INERTIA_LOST

        # The step stands: samples inside it, then on.
        while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t_new:
            asked = sample_times[counts[0]]
            if asked == t_new:
                combine(system.sizes, new, stages, AE, zero, zero, 0.0, samples[counts[0]])
            else:
                between_ends(
                    system.sizes, system.constants, tolerance, state, new, stages, (asked - t) / h,
                    h, samples[counts[0]],
                )  # fmt: skip
            counts[0] += 1
        for level in range(2):
            for i in range(len(system.sizes.bodies)):
                for j in range(1 + len(system.sizes.modes)):
                    state[level, i, j] = new[level, i, j]
                    stages[0, level, i, j] = stages[s, level, i, j]
        t = t_new
        clock[0] = t
        counts[1] += 1
        accept_step(clock, h, norm, order, lands)
        if t >= until:
            return DONE
        if lands:  # the torque may jump here: the slope is that from the left
            slope_at(system, t, from_right, state, torque, stages, zero)
            counts[3] += 1
    return PAUSED
