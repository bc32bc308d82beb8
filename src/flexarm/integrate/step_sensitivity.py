"""One step of a Runge-Kutta method, exact in its derivatives by complex perturbation.

Every number may be complex: the state, the torque, the constants of the arm. A perturbation of
1e-30 i in one of them carries its derivative through all stages in the imaginary part.
"""

from __future__ import annotations

import numpy as np

from flexarm.integrate.additive import SOFTENED, additive_step
from flexarm.integrate.base import System
from flexarm.integrate.torque import slope_at
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.cache import compiled
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace


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
    """Carry ``state`` (2, n, 1 + m) over a step h (s) into ``new``, the torque (n,) held.

    ``A`` (s + 1, s + 1): a tableau's rows of the s stages, and that of the new point; ``stages``
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
    system: System, softened: ArmConstants, AE: Array, AI: Array, c: Array, h: float,
    state: Array, new: Array, known: Array, added: Array, force: Array, torque: Array,
    stages: Array, clock: Array,
) -> None:  # fmt: skip
    """The same with a method that is implicit in bending: ``additive_step`` after the first slope.

    ``system.drive`` holds the torque; the other arguments are those of ``additive_step``, whose
    ``smooth`` is the new state.
    """
    clock[SOFTENED] = -1.0  # the constants may have changed since the last call
    slope_at(system, 0.0, bool(np.bool_(False)), state, torque, stages, int(np.int64(0)))
    additive_step(
        system, softened, AE, AI, c, 0.0, h, state, new, known, added, force, torque, stages, clock
    )
