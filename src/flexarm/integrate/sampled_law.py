"""Compiled sampled loops: a recorded law between steps, without Python from sample to sample.

Each stepper that ``integrator="auto"`` chooses has a loop. A call ends where only Python can go on:
before a sample whose torques are not finite, after one at which a link may have bent by many times
its length, and within one that takes too many steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import Drive, System, Tolerance
from flexarm.integrate.explicit_runge_kutta.explicit import ExplicitRecord, advance_explicit
from flexarm.integrate.implicit.additive import AdditiveRecord, advance_additive
from flexarm.integrate.memory import Memory
from flexarm.integrate.status import DONE
from flexarm.kernels.compilation.cache import inner, unlocked
from flexarm.kernels.controller_terms.law_program import LawProgram, law_step, remember
from flexarm.kernels.layout import Array, Sizes
from flexarm.kernels.observation.shapes import strains_at

#: Indices of ``SampledLaw.counts``: number of the next sample, that of the sample at which the call
#: ends, number of the first sample of ``inputs`` and ``commands``, and where the call has ended
#: (`REFUSED` before it).
TICK, LAST, FIRST, END = range(4)
#: Ends of a call: at the last sample, within one, after one at which links have bent far, or before
#: one whose torques are not finite.
COMPLETE, WITHIN, BENT, REFUSED = range(4)


class SampledLaw(NamedTuple):
    """A law with its devices, the signals of its arm, and the samples of one call."""

    program: LawProgram
    bodies: Array  # (joints,) of the joints
    gauge_bodies: Array  # (gauges,)
    gauge_rows: Array  # (gauges, m) strain per modal coordinate
    strains: Array  # (gauges,) scratch
    inputs: Array  # (samples, r) planned inputs
    breaks: Array  # (samples, pieces + 1) s, of the torques of the motors; or (samples, 0)
    commands: Array  # (samples, joints) N m, filled
    noted: Array  # (samples, q), filled
    counts: Array  # (4,)
    small: float  # modal coordinates below which no link has bent far
    times: Array  # (2,) sample time and end of the run, s


@inner
def _commanded(sizes: Sizes, state: Array, drive: Drive, law: SampledLaw) -> bool:
    """Hold the torques of a sample; return whether they are finite."""
    program, count = law.program, law.counts
    x, joints = program.numbers, law.bodies.shape[0]
    row = count[TICK] - count[FIRST]
    for k in range(joints):
        x[program.readings[k]] = state[0, law.bodies[k], 0]
        x[program.readings[joints + k]] = state[1, law.bodies[k], 0]
    strains_at(sizes, state, law.gauge_bodies, law.gauge_rows, law.strains)
    for k in range(law.strains.shape[0]):
        x[program.readings[2 * joints + k]] = law.strains[k]
    for k in range(program.inputs.shape[0]):
        x[program.inputs[k]] = law.inputs[row, k]
    law_step(program)
    for k in range(joints):
        torque = x[program.torque[k]]
        if not np.isfinite(torque):
            count[END] = REFUSED
            return False
        law.commands[row, k] = torque
    for piece in range(program.held.shape[0]):
        for power in range(program.held.shape[1]):
            for k in range(joints):
                torque = x[program.held[piece, power, k]]
                drive.coefficients[piece, power, law.bodies[k]] = torque
    for k in range(law.breaks.shape[1]):
        drive.breaks[k] = law.breaks[row, k]
    for k in range(program.noted.shape[0]):
        law.noted[row, k] = x[program.noted[k]]
    remember(program)
    return True


@inner
def _is_small(sizes: Sizes, state: Array, limit: float) -> bool:
    """Return whether all modal coordinates are below ``limit``."""
    for i in range(len(sizes.bodies)):
        for j in range(len(sizes.modes)):
            if not abs(state[0, i, 1 + j]) < limit:
                return False
    return True


@inner
def _held_until(system: System, state: Array, law: SampledLaw) -> float:
    """Hold the torques of the next sample; return the time (s) of its end, or -1 if the call ends.

    The sample before has ended.
    """
    counts = law.counts
    if counts[END] == WITHIN:
        counts[END] = COMPLETE
        if not _is_small(system.sizes, state, law.small):
            counts[END] = BENT
            return -1.0
    if counts[TICK] == counts[LAST]:
        return -1.0
    if not _commanded(system.sizes, state, system.drive, law):
        return -1.0
    counts[TICK] += 1
    counts[END] = WITHIN
    until: float = min(counts[TICK] * law.times[0], law.times[1])
    return until


@unlocked
def sampled_explicit(
    system: System,
    tolerance: Tolerance,
    record: ExplicitRecord,
    memory: Memory,
    end: float,
    max_steps: int,
    law: SampledLaw,
) -> int:
    """Advance from sample to sample by ``advance_explicit``; see the module."""
    status, until = DONE, _held_until(system, memory.state, law)
    while status == DONE and until > 0.0:
        status = advance_explicit(system, tolerance, record, memory, until, max_steps)
        if status == DONE:
            until = _held_until(system, memory.state, law)
    return status


@unlocked
def sampled_additive(
    system: System,
    tolerance: Tolerance,
    record: AdditiveRecord,
    memory: Memory,
    end: float,
    max_steps: int,
    law: SampledLaw,
) -> int:
    """Advance from sample to sample by ``advance_additive``; see the module."""
    status, until = DONE, _held_until(system, memory.state, law)
    while status == DONE and until > 0.0:
        status = advance_additive(system, tolerance, record, memory, until, max_steps)
        if status == DONE:
            until = _held_until(system, memory.state, law)
    return status


#: Loops by the stepper that they call.
LOOPS: dict[Callable[..., int], Callable[..., int]] = {
    advance_explicit: sampled_explicit,
    advance_additive: sampled_additive,
}
