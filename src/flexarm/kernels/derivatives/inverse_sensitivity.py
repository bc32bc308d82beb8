"""Inverse dynamics and the motion of the tip, with exact derivatives by q, qd and qdd.

The derivatives use complex perturbation, as in ``sensitivity``. The given motion need not satisfy
the equations of motion: the result is the generalised force that it requires, and its derivatives.
"""

from __future__ import annotations

from flexarm.kernels.columns import (
    COSINE,
    GRAVITY_X,
    GRAVITY_Y,
    SINE,
    TIP_ACCELERATION_X,
    TIP_ACCELERATION_Y,
)
from flexarm.kernels.compilation.cache import apart, compiled
from flexarm.kernels.compilation.numbers import cos, sin
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.observation.observables import poses
from flexarm.kernels.recursion.newton_euler import inverse_dynamics


@apart
def tip_motion(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    loads: Loads,
    work: Workspace,
    body_poses: Array,
    pose: Array,
    tip: Array,
) -> None:
    """Fill ``tip`` (6,): position, velocity, acceleration (x, y each), world axes, from the base.

    Call it directly after ``inverse_dynamics`` of the same state, which leaves the acceleration of
    the tip in ``work``, in the axes of the last body and minus gravity. ``body_poses`` (n, 16) and
    ``pose`` (6,) are scratch.
    """
    poses(sizes, constants, state, body_poses, pose)
    last = len(sizes.bodies) - 1
    cosine = 1.0 + 0.0 * work.body[last, COSINE]
    sine = 0.0 * work.body[last, COSINE]
    for i in range(len(sizes.bodies)):
        if len(sizes.tree) > 0:
            cosine = cos(body_poses[last, 2])
            sine = sin(body_poses[last, 2])
            break
        turned = cosine * work.body[i, COSINE] - sine * work.body[i, SINE]
        sine = sine * work.body[i, COSINE] + cosine * work.body[i, SINE]
        cosine = turned
    Ax = work.body[last, TIP_ACCELERATION_X]
    Ay = work.body[last, TIP_ACCELERATION_Y]
    tip[0] = pose[0]
    tip[1] = pose[1]
    tip[2] = pose[3]
    tip[3] = pose[4]
    tip[4] = cosine * Ax - sine * Ay + constants.arm[GRAVITY_X] - loads.base_acceleration[0]
    tip[5] = sine * Ax + cosine * Ay + constants.arm[GRAVITY_Y] - loads.base_acceleration[1]


@compiled
def inverse_jacobian_many(
    sizes: Sizes,
    constants: ArmConstants,
    states: Array,
    accelerations: Array,
    loads: Loads,
    work: Workspace,
    body_poses: Array,
    pose: Array,
    tip: Array,
    forces: Array,
    tips: Array,
    force_by: Array,
    tip_by: Array,
) -> None:
    """Compute generalised forces and tip motions of many motions, and their derivatives.

    Complex: ``states`` (k, 2, n, 1 + m), ``accelerations`` (k, n, 1 + m), ``work``, and the scratch
    ``body_poses`` (n, 16), ``pose`` (6,), ``tip`` (6,). Results: ``forces`` (k, n, 1 + m) and
    ``tips`` (k, 6) as in ``tip_motion``; ``force_by`` (k, 3, n, 1 + m, n, 1 + m) and ``tip_by``
    (k, 3, n, 1 + m, 6), the derivatives by coordinates (0), rates (1) and accelerations (2). The
    indices of the variable precede those of the function. Derivatives by padded and fixed
    coordinates are meaningless.
    """
    for k in range(states.shape[0]):
        for level in range(3):
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    if level < 2:
                        kept = states[k, level, i, j]
                        states[k, level, i, j] = kept + STEP * 1j
                    else:
                        kept = accelerations[k, i, j]
                        accelerations[k, i, j] = kept + STEP * 1j
                    inverse_dynamics(sizes, constants, states[k], accelerations[k], loads, work)
                    tip_motion(sizes, constants, states[k], loads, work, body_poses, pose, tip)
                    if level < 2:
                        states[k, level, i, j] = kept
                    else:
                        accelerations[k, i, j] = kept
                    for a in range(len(sizes.bodies)):
                        for p in range(1 + len(sizes.modes)):
                            force_by[k, level, i, j, a, p] = work.force[a, p].imag / STEP
                    for p in range(6):
                        tip_by[k, level, i, j, p] = tip[p].imag / STEP
        # The perturbation does not change the real parts.
        for a in range(len(sizes.bodies)):
            for p in range(1 + len(sizes.modes)):
                forces[k, a, p] = work.force[a, p].real
        for p in range(6):
            tips[k, p] = tip[p].real
