"""Jacobian of the last tip, and its acceleration at zero joint acceleration.

The Jacobian's columns are the tip's velocities at unit rates. ``J_dot qd`` is the derivative of the
velocity along the motion, computed with a complex step (see ``sensitivity``), exact to rounding.
"""

from __future__ import annotations

from flexarm.kernels.compilation.cache import apart
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants, Array, Sizes
from flexarm.kernels.observation.observables import poses


@apart
def tip_motion(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    scratch: Array,
    body_poses: Array,
    tip: Array,
    position: Array,
    velocity: Array,
    jacobian: Array,
    bias: Array,
) -> None:
    """Fill position, velocity and bias (2,) and the Jacobian (2, n), world axes.

    ``state`` (2, n, 1 + m) is real, with modes at rest; ``scratch`` of the same shape,
    ``body_poses`` (n, 16) and ``tip`` (6,) are complex.
    """
    count = len(sizes.bodies)
    for i in range(count):
        scratch[0, i, 0] = state[0, i, 0] + STEP * 1j * state[1, i, 0]
        scratch[1, i, 0] = state[1, i, 0]
    poses(sizes, constants, scratch, body_poses, tip)
    for axis in range(2):
        position[axis] = tip[axis].real
        velocity[axis] = tip[3 + axis].real
        bias[axis] = tip[3 + axis].imag / STEP
    for i in range(count):
        scratch[0, i, 0] = state[0, i, 0]
        scratch[1, i, 0] = 0.0
    for i in range(count):
        scratch[1, i, 0] = 1.0
        poses(sizes, constants, scratch, body_poses, tip)
        scratch[1, i, 0] = 0.0
        for axis in range(2):
            jacobian[axis, i] = tip[3 + axis].real
