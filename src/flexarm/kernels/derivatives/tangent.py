"""Exact tangent of the inverse dynamics: stiffness and damping of small motion about any motion.

Computed by complex perturbation, as in ``sensitivity``. Theory page "small motion", (S.2).
"""

from __future__ import annotations

from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.newton_euler import inverse_dynamics


@compiled
def inverse_jacobian(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    acceleration: Array,
    loads: Loads,
    work: Workspace,
    by_state: Array,
) -> None:
    """Compute derivatives of the generalised forces; ``state`` and ``work`` are complex.

    ``acceleration`` (n, 1 + m) is constant; ``by_state`` (n, 1 + m, 2, n, 1 + m): derivatives by
    coordinates (0) and rates (1). Derivatives by padded and fixed coordinates are meaningless.
    """
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                kept = state[level, i, j]
                state[level, i, j] = kept + STEP * 1j
                inverse_dynamics(sizes, constants, state, acceleration, loads, work)
                state[level, i, j] = kept
                for k in range(len(sizes.bodies)):
                    for p in range(1 + len(sizes.modes)):
                        by_state[k, p, level, i, j] = work.force[k, p].imag / STEP
