"""Highest frequency of an arm at a posture, by power iteration on its accelerations.

A small displacement ``d`` from rest changes the accelerations by ``-M^-1 K d``, so that repeated
evaluations turn ``d`` towards the fastest vibration.
"""

from __future__ import annotations

import math

from flexarm.kernels.columns import FREE, JOINT_STIFFNESS, LENGTH, MASS, TIP_MASS, W2
from flexarm.kernels.compilation.cache import merged, unlocked
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.articulated_body import forward_dynamics

_ITERATIONS = 40
#: Norm of the displacements, with modes relative to ``modal_size``: small enough to stay linear,
#: large compared with rounding.
_SMALL = 1e-6


@unlocked
def fastest_vibrations(
    sizes: Sizes,
    constants: ArmConstants,
    states: Array,
    loads: Loads,
    work: Workspace,
    moved: Array,
    change: Array,
    torque: Array,
    found: Array,
) -> None:
    """Write the highest frequencies (k,) rad/s at the postures of ``states`` to ``found``.

    They are estimates from below, within a few per cent.

    Args:
        states: (k, 2, n, 1 + m). loads: none. moved, change: (2, n, 1 + m) scratch. torque: (n,)
            zeros.
    """
    c = constants
    size = modal_size(sizes, c)
    for k in range(states.shape[0]):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                moved[0, i, j] = states[k, 0, i, j]
                moved[1, i, j] = 0.0
        forward_dynamics(sizes, c, moved, torque, loads, work)
        for i in range(len(sizes.bodies)):
            change[0, i, 0] = math.sqrt(c.body[i, JOINT_STIFFNESS]) / size
            change[1, i, 0] = work.acceleration[i, 0]  # at the posture itself
            for j in range(len(sizes.modes)):
                change[0, i, 1 + j] = math.sqrt(c.mode[i, j, W2]) * size
                change[1, i, 1 + j] = work.acceleration[i, 1 + j]
        for _ in range(_ITERATIONS):
            scale = _SMALL / _length(sizes, size, change)
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    moved[0, i, j] = states[k, 0, i, j] + scale * change[0, i, j]
            forward_dynamics(sizes, c, moved, torque, loads, work)
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    value = work.acceleration[i, j] - change[1, i, j]
                    if j == 0 and c.body[i, FREE] == 0.0:
                        value = 0.0
                    change[0, i, j] = value
        found[k] = math.sqrt(_length(sizes, size, change) / _SMALL)


@merged
def modal_size(sizes: Sizes, constants: ArmConstants) -> float:
    """Return the modal coordinate (m kg^0.5) that counts as much as an angle of one radian.

    It is the reach of the arm times the square root of its mass, so that norms of coordinates do
    not depend on the units.
    """
    reach: float = 0.0
    mass: float = 0.0
    for i in range(len(sizes.bodies)):
        reach += real(constants.body[i, LENGTH])
        mass += real(constants.body[i, MASS] + constants.body[i, TIP_MASS])
    size = reach * math.sqrt(mass)
    return size if size > 0.0 else 1.0  # an arm without mass has no modes


@merged
def _length(sizes: Sizes, size: float, change: Array) -> float:
    squares = 0.0
    for i in range(len(sizes.bodies)):
        squares += change[0, i, 0] * change[0, i, 0]
        for j in range(len(sizes.modes)):
            squares += (change[0, i, 1 + j] / size) ** 2
    return math.sqrt(squares)
