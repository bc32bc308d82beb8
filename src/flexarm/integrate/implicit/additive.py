"""Compiled stepping of additive Runge-Kutta methods, implicit in bending and damping.

Theory page "integration", (I.1) to (I.4). Each stage has two states: an explicit one for the smooth
terms (posture, rates, mass matrix, loads) and an implicit one for the forces of bending, of joint
springs and of damping, in which the equations are linear. A stage is therefore one pass of the
recursion with a diagonal added to the mass matrix, without iteration. Friction of joints is split:
its slope at the start of a step acts as damping, the rest is a smooth term. The deflection of
bristles and the rate in its equation are implicit, the decay is that of the explicit state: with
the rate, the equation of the deflection is linear and eliminated, without iteration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.closures import close_step
from flexarm.integrate.implicit.bristles import bend_bristles, hold_bristles
from flexarm.integrate.memory import BETWEEN, EVALUATIONS, KEPT, SAMPLES, SOFTENED, STEP, Memory
from flexarm.integrate.momentum import is_alone, keep_momentum, keep_sample
from flexarm.integrate.nearness import step_on
from flexarm.integrate.samples import begin_call, samples_between
from flexarm.integrate.status import DONE, PAUSED
from flexarm.integrate.step_ends import begin_steps, judge_end, next_step
from flexarm.integrate.steps import judge_step, step_landing
from flexarm.integrate.sticking import begin_watch, sticks, watch_slips
from flexarm.integrate.sums import combine
from flexarm.integrate.torque import drive_at
from flexarm.kernels.columns import (
    FREE,
    JOINT_ADDED,
    JOINT_DAMPING,
    JOINT_DRAG,
    JOINT_STIFFNESS,
    MODE_DAMPING,
    SLIDING,
    SMOOTHING_RATE,
    W2,
)
from flexarm.kernels.compilation.cache import apart, merged, unlocked
from flexarm.kernels.forces.joint_law import friction_slope
from flexarm.kernels.layout import ArmConstants, Array
from flexarm.kernels.recursion.articulated_body import solve_implicit
from flexarm.kernels.recursion.implicit_step import add_to_diagonal


class AdditiveRecord(NamedTuple):
    """Coefficients of an ``additive_tableau.AdditiveTableau``, and the arrays of a run."""

    explicit: Array  # (s + 1, s)
    implicit: Array  # (s + 1, s), equal diagonal entries except for the explicit first stage
    c: Array  # (s + 1,)
    error: Array  # (2, s + 1)
    order: int
    known: Array  # (2, n, 1 + m) implicit state of a stage without its own acceleration
    stages: Array  # (s + 1, 2, n, 1 + m) derivatives; stage s belongs to the new point
    softened: ArmConstants  # with the diagonal for a step of length ``clock[SOFTENED]``


@merged
def drag_at(system: System, softened: ArmConstants, state: Array) -> None:
    """Write the slopes of the friction of joints at a state (2, n, 1 + m) to ``softened``."""
    if len(system.sizes.joint_laws) > 0:
        for i in range(len(system.sizes.bodies)):
            slope = friction_slope(system.sizes, system.constants, i, state[1, i, 0])
            softened.body[i, JOINT_DRAG] = slope


@merged
def soften_for(system: System, softened: ArmConstants, damping: float, stiffness: float) -> None:
    """Add ``damping`` (s) times D and ``stiffness`` (s^2) times K to the mass matrix.

    D contains the slopes of ``drag_at``, which are zero without a call of it.
    """
    sizes = system.sizes
    c = system.constants
    added = system.work.force  # scratch
    for i in range(len(sizes.bodies)):
        drag = c.body[i, JOINT_DAMPING] + softened.body[i, JOINT_DRAG]
        added[i, 0] = damping * drag + stiffness * c.body[i, JOINT_STIFFNESS]
        added[i, 0] += c.body[i, JOINT_ADDED]  # of a sticking joint
        for j in range(len(sizes.modes)):
            added[i, 1 + j] = damping * c.mode[i, j, MODE_DAMPING] + stiffness * c.mode[i, j, W2]
    add_to_diagonal(sizes, c, added, softened)


@merged
def shift_forces(
    system: System, softened: ArmConstants, smooth: Array, known: Array, torque: Array
) -> None:
    """Replace bending, spring and damping forces at the smooth state by those at ``known``.

    Both states have shape (2, n, 1 + m). Forces on joints are added to ``torque``, forces on modes
    are written to ``work.force``. ``softened`` is that of ``soften_for``.
    """
    sizes = system.sizes
    c = system.constants
    for i in range(len(sizes.bodies)):
        torque[i] += c.body[i, FREE] * (
            c.body[i, JOINT_STIFFNESS] * (smooth[0, i, 0] - known[0, i, 0])
            + (c.body[i, JOINT_DAMPING] + softened.body[i, JOINT_DRAG])
            * (smooth[1, i, 0] - known[1, i, 0])
        )
        for j in range(len(sizes.modes)):
            system.work.force[i, 1 + j] = c.mode[i, j, W2] * (
                smooth[0, i, 1 + j] - known[0, i, 1 + j]
            ) + c.mode[i, j, MODE_DAMPING] * (smooth[1, i, 1 + j] - known[1, i, 1 + j])


@apart
def additive_step(
    system: System, record: AdditiveRecord, memory: Memory, t: float, h: float
) -> None:
    """Fill ``stages[1:s]`` from ``stages[0]``, and write the new point to ``memory.new``."""
    sizes, work = system.sizes, system.work
    AE, AI, c, known, stages = (
        record.explicit, record.implicit, record.c, record.known, record.stages,
    )  # fmt: skip
    state, smooth, torque = memory.state, memory.new, memory.torque
    s = AE.shape[0] - 1
    gamma = AI[1, 1]
    if h != memory.clock[SOFTENED] or len(sizes.joint_laws) > 0:
        drag_at(system, record.softened, state)
        soften_for(system, record.softened, h * gamma, h * gamma * h * gamma)
        memory.clock[SOFTENED] = h
        for i in range(len(sizes.bodies)):  # which joints stick or slide
            record.softened.body[i, SLIDING] = system.constants.body[i, SLIDING]
            record.softened.body[i, SMOOTHING_RATE] = system.constants.body[i, SMOOTHING_RATE]
    begin_watch(system)
    for k in range(1, s):
        combine(sizes, state, stages, AE, k, k, h, smooth)
        combine(sizes, state, stages, AI, k, k, h, known)
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                known[0, i, j] += h * gamma * known[1, i, j]
        drive_at(system, t + c[k] * h, c[k] == 1.0, torque)
        if len(sizes.bristles) > 0:
            hold_bristles(system, record.softened, state, smooth, known, torque, h * gamma)
        shift_forces(system, record.softened, smooth, known, torque)
        solve_implicit(sizes, record.softened, smooth, work.force, torque, system.drive.loads, work)
        if len(sizes.bristles) > 0:
            bend_bristles(system, smooth, known, h * gamma)
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                change = work.acceleration[i, j]
                stages[k, 0, i, j] = known[1, i, j] + h * gamma * change
                stages[k, 1, i, j] = change
        if len(sizes.joint_laws) > 0:
            watch_slips(system, t + c[k] * h)
            for i in range(len(sizes.bodies)):
                if sticks(system, i):
                    stages[k, 0, i, 0] = 0.0
                    stages[k, 1, i, 0] = 0.0
    combine(sizes, state, stages, AE, s, s, h, smooth)


@unlocked
def advance_additive(
    system: System,
    tolerance: Tolerance,
    record: AdditiveRecord,
    memory: Memory,
    until: float,
    max_steps: int,
) -> int:
    """Step to ``until``, by the rules of ``base.Integrator``."""
    sizes = system.sizes
    controlled = bool(np.bool_(True))  # a typed constant, see ``step_ends``
    known = not controlled
    damps = controlled  # vibrations that a step does not resolve
    stages, clock, counts = record.stages, memory.clock, memory.counts
    s = record.error.shape[1] - 1
    t = begin_call(sizes, memory)
    if t >= until:
        return DONE
    begin_steps(system, memory, stages, t, controlled)
    alone = is_alone(system)
    if alone and clock[KEPT] == 0.0:
        keep_momentum(system, memory, memory.state)
    for _ in range(max_steps):
        t_new, h, lands = step_landing(system.drive.stops, t, clock[STEP], until)
        additive_step(system, record, memory, t, h)
        counts[EVALUATIONS] += s - 1
        status = judge_step(system, tolerance, memory, stages, record.error, record.order, h)
        if status == PAUSED:
            continue
        if status != DONE:
            return status
        if len(sizes.closures) > 0:
            close_step(system, record.softened, memory)
        if alone:
            keep_momentum(system, memory, memory.new)
        status = judge_end(system, tolerance, memory, stages, s, t, t_new, h, controlled, known)
        if status == PAUSED:
            continue
        if status != DONE:
            return status
        step_on(system.drive.loads.contacts)
        first = int(counts[SAMPLES])
        samples_between(system, tolerance, memory, stages, t, h, t_new, damps)
        for sample in range(first, int(counts[SAMPLES])):
            keep_sample(system, memory, memory.samples[sample], alone)
        next_step(system, memory, stages, s, t_new, h, lands, controlled, record.order, until)
        t = t_new
        if t >= until:
            return DONE
    clock[BETWEEN] = 1.0
    return PAUSED
