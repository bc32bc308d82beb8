"""Position, velocity and acceleration of points of the deformed axis.

Theory page "link", (L.31), applied to a station instead of the tip.

=================  ===========================================================
symbol             meaning
=================  ===========================================================
``u``, ``v``       shortening and deflection at the station, body axes
``w``, ``w_dot``   angular rate and acceleration of the body axes
=================  ===========================================================
"""

from __future__ import annotations

from flexarm.kernels.columns import (
    GRAVITY_X,
    GRAVITY_Y,
    RATE,
    ROOT_ACCELERATION_W,
    ROOT_ACCELERATION_X,
    ROOT_ACCELERATION_Y,
)
from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.compilation.numbers import cos, sin
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.observation.observables import poses
from flexarm.kernels.recursion.newton_euler import inverse_dynamics

#: Columns of the motion of a point; ``Sensor.columns`` selects the two of an output.
MOTION_COLUMNS = 8


@compiled
def point_motions(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    acceleration: Array,
    loads: Loads,
    stations: Loads,
    work: Workspace,
    body_poses: Array,
    tip: Array,
    motions: Array,
) -> None:
    """Fill ``motions`` (k, MOTION_COLUMNS) for the points at ``stations``.

    Columns: position from the base (m), velocity relative to it (m/s), and acceleration in space
    (m/s^2), x and y in world axes; then the reading of an accelerometer along and across the body's
    root tangent, which is acceleration minus gravity. ``acceleration`` (n, 1 + m) must be the one
    under ``loads``. Only the positions of ``stations`` are used.
    """
    inverse_dynamics(sizes, constants, state, acceleration, loads, work)
    poses(sizes, constants, state, body_poses, tip)
    for k in range(stations.body.shape[0]):
        i = stations.body[k]
        v = 0.0
        v_dot = 0.0
        v_dot_dot = 0.0
        for j in range(len(sizes.modes)):
            v += stations.rows[k, j] * state[0, i, 1 + j]
            v_dot += stations.rows[k, j] * state[1, i, 1 + j]
            v_dot_dot += stations.rows[k, j] * acceleration[i, 1 + j]
        x = stations.lever[k]
        u_dot = 0.0
        u_dot_dot = 0.0
        for j in range(len(sizes.geometric)):
            drawn = 0.0
            drawn_dot = 0.0
            for p in range(len(sizes.geometric)):
                drawn += stations.shortening[k, j, p] * state[0, i, 1 + p]
                drawn_dot += stations.shortening[k, j, p] * state[1, i, 1 + p]
            x -= 0.5 * state[0, i, 1 + j] * drawn
            u_dot -= state[1, i, 1 + j] * drawn
            u_dot_dot -= acceleration[i, 1 + j] * drawn + state[1, i, 1 + j] * drawn_dot
        w = work.body[i, RATE]
        w_dot = work.body[i, ROOT_ACCELERATION_W]
        along = (
            work.body[i, ROOT_ACCELERATION_X] - w_dot * v - w * w * x - 2.0 * w * v_dot + u_dot_dot
        )
        across = (
            work.body[i, ROOT_ACCELERATION_Y] + w_dot * x - w * w * v + 2.0 * w * u_dot + v_dot_dot
        )
        vx = u_dot - w * v
        vy = v_dot + w * x
        cosine = cos(body_poses[i, 2])
        sine = sin(body_poses[i, 2])
        motions[k, 0] = body_poses[i, 0] + cosine * x - sine * v
        motions[k, 1] = body_poses[i, 1] + sine * x + cosine * v
        motions[k, 2] = body_poses[i, 3] + cosine * vx - sine * vy
        motions[k, 3] = body_poses[i, 4] + sine * vx + cosine * vy
        motions[k, 4] = cosine * along - sine * across + constants.arm[GRAVITY_X]
        motions[k, 5] = sine * along + cosine * across + constants.arm[GRAVITY_Y]
        motions[k, 6] = along
        motions[k, 7] = across
