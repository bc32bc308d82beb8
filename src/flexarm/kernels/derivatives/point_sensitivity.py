"""Motion of points of an arm under constant torques, with exact derivatives by the state.

The derivatives use complex perturbation, as in ``sensitivity``. They linearise the readings of
accelerometers and cameras for filters.
"""

from __future__ import annotations

from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.observation.point_motion import point_motions
from flexarm.kernels.recursion.articulated_body import forward_dynamics


@compiled
def point_jacobian(
    sizes: Sizes,
    constants: ArmConstants,
    moved: ArmConstants,
    places: Array,
    state: Array,
    torque: Array,
    loads: Loads,
    stations: Loads,
    work: Workspace,
    acceleration: Array,
    body_poses: Array,
    tip: Array,
    motions: Array,
    found: Array,
) -> None:
    """Write the motions (k, c) of ``point_motions`` and derivatives to ``found`` (p + 2, k, c).

    Rows 0 to p - 1: derivatives by the states at ``places`` (p, 3), which are level, body and
    column; row p: derivative by the parameter with an imaginary step in ``moved``; row p + 1: the
    motions. The other arguments are complex; all but the state and the torque are scratch.
    """
    count = places.shape[0]
    for column in range(count + 1):
        if column < count:
            level = places[column, 0]
            i = places[column, 1]
            j = places[column, 2]
            state[level, i, j] += STEP * 1j
            forward_dynamics(sizes, constants, state, torque, loads, work)
        else:
            forward_dynamics(sizes, moved, state, torque, loads, work)
        for body in range(len(sizes.bodies)):
            for p in range(1 + len(sizes.modes)):
                acceleration[body, p] = work.acceleration[body, p]
        if column < count:
            point_motions(
                sizes,
                constants,
                state,
                acceleration,
                loads,
                stations,
                work,
                body_poses,
                tip,
                motions,
            )
            state[level, i, j] -= STEP * 1j
        else:
            point_motions(
                sizes, moved, state, acceleration, loads, stations, work, body_poses, tip, motions
            )
        for k in range(motions.shape[0]):
            for p in range(motions.shape[1]):
                found[column, k, p] = motions[k, p].imag / STEP
                found[count + 1, k, p] = motions[k, p].real
