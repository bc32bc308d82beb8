"""Derivatives of the states at the ends of intervals by those at their starts, in dual numbers."""

from __future__ import annotations

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.explicit_runge_kutta.explicit import ExplicitRecord, advance_explicit
from flexarm.integrate.implicit.additive import AdditiveRecord, advance_additive
from flexarm.integrate.memory import Memory
from flexarm.integrate.samples import copy_state
from flexarm.integrate.status import DONE, PAUSED
from flexarm.integrate.step_sensitivity import held_torque_step
from flexarm.kernels.compilation.cache import merged, unlocked
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace


@merged
def _seed(sizes: Sizes, state: Array, seeds: Array) -> None:
    """Replace the derivatives of a state (2, n, 1 + m) by those of ``seeds``."""
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                state[level, i, j] = real(state[level, i, j]) + seeds[level, i, j]


@unlocked
def explicit_transfers(
    system: System,
    tolerance: Tolerance,
    record: ExplicitRecord,
    memory: Memory,
    ends: Array,
    seeds: Array,
    transfers: Array,
    max_steps: int,
) -> int:
    """Fill ``transfers`` (ends, 2, n, 1 + m) with the states at ``ends`` (s), explicit methods.

    The derivatives of each are those by ``seeds`` (2, n, 1 + m) at the end before it.
    """
    for k in range(ends.shape[0]):
        _seed(system.sizes, memory.state, seeds)
        status = PAUSED
        while status == PAUSED:
            status = advance_explicit(system, tolerance, record, memory, ends[k], max_steps)
        if status != DONE:
            return status
        copy_state(system.sizes, memory.state, transfers[k])
    return DONE


@unlocked
def additive_transfers(
    system: System,
    tolerance: Tolerance,
    record: AdditiveRecord,
    memory: Memory,
    ends: Array,
    seeds: Array,
    transfers: Array,
    max_steps: int,
) -> int:
    """Fill ``transfers`` as ``explicit_transfers`` does, by an additive method."""
    for k in range(ends.shape[0]):
        _seed(system.sizes, memory.state, seeds)
        status = PAUSED
        while status == PAUSED:
            status = advance_additive(system, tolerance, record, memory, ends[k], max_steps)
        if status != DONE:
            return status
        copy_state(system.sizes, memory.state, transfers[k])
    return DONE


@unlocked
def held_torque_transfers(
    sizes: Sizes,
    constants: ArmConstants,
    A: Array,
    h: float,
    steps: int,
    torques: Array,
    seeds: Array,
    torque_seeds: Array,
    state: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
    stages: Array,
    new: Array,
    transfers: Array,
) -> None:
    """Fill ``transfers`` as ``explicit_transfers`` does, by equal steps without step control.

    Each interval has ``steps`` steps h (s) of ``held_torque_step`` with its row of ``torques``
    (intervals, n). Derivatives are by ``seeds`` and by ``torque_seeds`` (n,) of the torque.
    ``state`` is the state at the start, and, as ``torque`` (n,), is overwritten.
    """
    for k in range(transfers.shape[0]):
        _seed(sizes, state, seeds)
        for i in range(len(sizes.bodies)):
            torque[i] = torque_seeds[i] + torques[k, i]
        for _ in range(steps):
            held_torque_step(sizes, constants, A, h, state, torque, loads, work, stages, new)
            copy_state(sizes, new, state)
        copy_state(sizes, state, transfers[k])
