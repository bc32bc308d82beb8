"""One step of a Runge-Kutta method, with exact derivatives by complex perturbation.

The state, the torque and the constants of the arm may be complex. A perturbation of 1e-30 i in one
of them carries its derivative through all stages in the imaginary part.
"""

from __future__ import annotations

import math

import numpy as np

from flexarm.integrate.base import System
from flexarm.integrate.implicit.additive import AdditiveRecord, additive_step
from flexarm.integrate.memory import SOFTENED, Memory
from flexarm.integrate.torque import slope_at
from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.articulated_body import forward_dynamics


@compiled
def held_torque_step(
    sizes: Sizes,
    constants: ArmConstants,
    A: Array,
    h: float,
    state: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
    stages: Array,
    new: Array,
) -> None:
    """Carry ``state`` (2, n, 1 + m) over a step h (s) into ``new``, at constant torque (n,).

    ``A`` (s + 1, s + 1): rows of a tableau for the s stages and for the new point; ``stages``
    (s, 2, n, 1 + m) is scratch.
    """
    count = stages.shape[0]
    for k in range(count + 1):
        for level in range(2):
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    total = state[level, i, j]
                    for p in range(k):
                        total += h * A[k, p] * stages[p, level, i, j]
                    new[level, i, j] = total
        if k < count:
            forward_dynamics(sizes, constants, new, torque, loads, work)
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    stages[k, 0, i, j] = new[1, i, j]
                    stages[k, 1, i, j] = work.acceleration[i, j]


@compiled
def held_torque_additive_step(
    system: System, record: AdditiveRecord, memory: Memory, h: float
) -> None:
    """Carry ``memory.state`` over a step h (s) into ``memory.new`` with a method of ``additive``.

    The torque is that of ``system.drive``; all arrays of the motion are complex.
    """
    memory.clock[SOFTENED] = math.nan  # the constants may have changed since the last call
    slope_at(
        system, 0.0, bool(np.bool_(False)), memory.state, memory.torque, record.stages,
        int(np.int64(0)), bool(np.bool_(False)),
    )  # fmt: skip
    additive_step(system, record, memory, 0.0, h)


@compiled
def held_torque_jacobian(
    sizes: Sizes,
    constants: ArmConstants,
    moved: ArmConstants,
    A: Array,
    h: float,
    steps: int,
    places: Array,
    bodies: Array,
    state: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
    stages: Array,
    before: Array,
    new: Array,
    slopes: Array,
) -> None:
    """Compute the state after equal steps, and its derivatives by states, torques, one parameter.

    ``places`` (p, 3): level, body and column of each state; ``bodies`` (j,) of the torques;
    ``moved``: the constants with the parameter's imaginary step. The derivatives are written to
    ``slopes`` (p + j + 1, 2, n, 1 + m), and the real part of ``new`` is the final state. All arrays
    except ``slopes`` and indices are complex; ``before`` (2, n, 1 + m) is scratch.
    """
    count = places.shape[0]
    for column in range(count + bodies.shape[0] + 1):
        for level in range(2):
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    before[level, i, j] = state[level, i, j]
        if column < count:
            before[places[column, 0], places[column, 1], places[column, 2]] += STEP * 1j
        elif column < count + bodies.shape[0]:
            torque[bodies[column - count]] += STEP * 1j
        for _ in range(steps):
            if column < count + bodies.shape[0]:
                held_torque_step(sizes, constants, A, h, before, torque, loads, work, stages, new)
            else:
                held_torque_step(sizes, moved, A, h, before, torque, loads, work, stages, new)
            for level in range(2):
                for i in range(len(sizes.bodies)):
                    for j in range(1 + len(sizes.modes)):
                        before[level, i, j] = new[level, i, j]
        if count <= column < count + bodies.shape[0]:
            torque[bodies[column - count]] -= STEP * 1j
        for level in range(2):
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    slopes[column, level, i, j] = new[level, i, j].imag / STEP
