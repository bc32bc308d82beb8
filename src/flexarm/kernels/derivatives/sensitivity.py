"""Exact derivatives of the kernels by complex perturbation.

A perturbation of 1e-30 i does not change the real part, and its imaginary part is the derivative
without a subtraction, so the result is exact to rounding (Squire and Trapp, SIAM Review 40 (1998)
110-112).
"""

from __future__ import annotations

from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.articulated_body import forward_dynamics
from flexarm.kernels.recursion.newton_euler import inverse_dynamics

#: Small enough that its square is lost in rounding, but far above the smallest double.
STEP = 1e-30


@compiled
def forward_jacobian(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
    by_state: Array,
    by_torque: Array,
) -> None:
    """Compute derivatives of the accelerations; ``state``, ``torque``, ``work`` are complex.

    ``by_state`` (n, 1 + m, 2, n, 1 + m): derivatives by coordinates (0) and rates (1);
    ``by_torque`` (n, 1 + m, n). Derivatives by padded and fixed coordinates are meaningless.
    """
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                kept = state[level, i, j]
                state[level, i, j] = kept + STEP * 1j
                forward_dynamics(sizes, constants, state, torque, loads, work)
                state[level, i, j] = kept
                for k in range(len(sizes.bodies)):
                    for p in range(1 + len(sizes.modes)):
                        by_state[k, p, level, i, j] = work.acceleration[k, p].imag / STEP
    for i in range(len(sizes.bodies)):
        kept = torque[i]
        torque[i] = kept + STEP * 1j
        forward_dynamics(sizes, constants, state, torque, loads, work)
        torque[i] = kept
        for k in range(len(sizes.bodies)):
            for p in range(1 + len(sizes.modes)):
                by_torque[k, p, i] = work.acceleration[k, p].imag / STEP


@compiled
def potential_hessian(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    acceleration: Array,
    loads: Loads,
    work: Workspace,
    K: Array,
) -> None:
    """Compute the Hessian ``K`` (n, 1 + m, n, 1 + m) of strain and gravity energy.

    ``state`` and ``work`` are complex; rates and ``acceleration`` (n, 1 + m) must be zero, because
    the inverse dynamics is then the gradient.
    """
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            kept = state[0, i, j]
            state[0, i, j] = kept + STEP * 1j
            inverse_dynamics(sizes, constants, state, acceleration, loads, work)
            state[0, i, j] = kept
            for k in range(len(sizes.bodies)):
                for p in range(1 + len(sizes.modes)):
                    K[k, p, i, j] = work.force[k, p].imag / STEP
