"""Forward dynamics from the base to the tip: (R.12) to (R.14).

Symbols as in ``articulated_body``.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.compilation.cache import merged
from flexarm.kernels.layout import ArmConstants, Loads, Sizes, Workspace

# isort: off
from flexarm.kernels.columns import (
    A, ALPHA, BENT_N_WW, BENT_N_XW, BENT_N_XX, BENT_N_XY, BENT_N_YW, BENT_N_YY, BETA, COSINE,
    D0_ETA, DP, DRIFT_W, DRIFT_X, DRIFT_Y, FLEX_BIAS, FX, GAIN_WK, GAIN_WW, GAIN_WX, GAIN_WY,
    GAIN_XK, GAIN_XW, GAIN_XX, GAIN_XY, GAIN_YK, GAIN_YW, GAIN_YX, GAIN_YY, GRAVITY_X, GRAVITY_Y,
    INVERSE_MASS, JOINT_BIAS_X, JOINT_BIAS_Y, JOINT_DRIVE, JOINT_GIVEN, JOINT_INVERSE, JOINT_UW,
    JOINT_UX, JOINT_UY, MEAN_FX, MEAN_LAG, MEAN_LEFT, MEAN_W, MEAN_Y, MODE_MOBILITY, N_WW, N_YW,
    N_YY, P, ROOT_FROM_X, ROOT_FROM_Y, S, SINE, SLIDES, SLIDE_X, SLIDE_Y, TIP_ACCELERATION_W,
    TIP_ACCELERATION_X, TIP_ACCELERATION_Y, TRANSFER_WW, TRANSFER_WX, TRANSFER_WY, TRANSFER_XW,
    TRANSFER_XX, TRANSFER_XY, TRANSFER_YW, TRANSFER_YX, TRANSFER_YY,
)  # fmt: skip
# isort: on


@merged
def carrier_acceleration(
    sizes: Sizes, i: int, ground_x: Any, ground_y: Any, work: Workspace
) -> Any:
    """Return the acceleration minus gravity of the section that carries body i, in the axes of its
    body; of the ground in world axes."""
    Ax, Ay, Aw = ground_x, ground_y, 0.0
    carrier = sizes.joints[i, 0]
    if carrier >= 0:
        Ax = work.body[carrier, TIP_ACCELERATION_X]
        Ay = work.body[carrier, TIP_ACCELERATION_Y]
        Aw = work.body[carrier, TIP_ACCELERATION_W]
    return Ax, Ay, Aw


@merged
def outward(sizes: Sizes, constants: ArmConstants, loads: Loads, work: Workspace) -> None:
    """Compute the accelerations outwards; gravity is included as a base acceleration."""
    ground_x = loads.base_acceleration[0] - constants.arm[GRAVITY_X]
    ground_y = loads.base_acceleration[1] - constants.arm[GRAVITY_Y]
    spread(sizes, constants, ground_x, ground_y, work)


@merged
def spread(
    sizes: Sizes, constants: ArmConstants, ground_x: Any, ground_y: Any, work: Workspace
) -> None:
    """Compute the accelerations outwards from that of the ground minus gravity, m/s^2."""
    c = constants
    Ax = ground_x
    Ay = ground_y
    Aw = 0.0
    for i in range(len(sizes.bodies)):
        if len(sizes.tree) > 0:
            Ax, Ay, Aw = carrier_acceleration(sizes, i, ground_x, ground_y, work)
        cosine = work.body[i, COSINE]
        sine = work.body[i, SINE]
        turned = cosine * Ax + sine * Ay
        Ay = cosine * Ay - sine * Ax
        Ax = turned
        if len(sizes.tree) > 0:
            Ax = Ax - Aw * work.body[i, ROOT_FROM_Y]
            Ay = Ay + Aw * work.body[i, ROOT_FROM_X]
        pull = (
            work.body[i, JOINT_UX] * Ax + work.body[i, JOINT_UY] * Ay + work.body[i, JOINT_UW] * Aw
        )
        joint_acceleration = (work.body[i, JOINT_DRIVE] - pull) * work.body[
            i, JOINT_INVERSE
        ] + work.body[i, JOINT_GIVEN]
        work.acceleration[i, 0] = joint_acceleration
        if len(sizes.tree) > 0:
            Ax = Ax + work.body[i, JOINT_BIAS_X] + c.body[i, SLIDE_X] * joint_acceleration
            Ay = Ay + work.body[i, JOINT_BIAS_Y] + c.body[i, SLIDE_Y] * joint_acceleration
            joint_acceleration = joint_acceleration * (1.0 - c.body[i, SLIDES])
        Aw = Aw + joint_acceleration

        # Wrench of the body on the chain at its tip; then its modes, then its tip.
        fx = work.body[i, GAIN_XX] * Ax + work.body[i, GAIN_XY] * Ay + work.body[i, GAIN_XW] * Aw
        fy = work.body[i, GAIN_YX] * Ax + work.body[i, GAIN_YY] * Ay + work.body[i, GAIN_YW] * Aw
        fw = work.body[i, GAIN_WX] * Ax + work.body[i, GAIN_WY] * Ay + work.body[i, GAIN_WW] * Aw
        fx += work.body[i, GAIN_XK]
        fy += work.body[i, GAIN_YK]
        fw += work.body[i, GAIN_WK]
        rising = Ay
        turning = Aw
        if len(sizes.geometric) > 0:
            rising += work.body[i, ALPHA] * Aw
            turning += work.body[i, BETA] * Aw
        for j in range(len(sizes.modes)):
            work.acceleration[i, 1 + j] = -c.mode[i, j, MODE_MOBILITY] * (
                work.mode[i, j, FLEX_BIAS]
                + c.mode[i, j, S] * rising
                + c.mode[i, j, A] * turning
                + c.mode[i, j, P] * fy
                + c.mode[i, j, DP] * fw
            )
        along = 0.0  # mean acceleration of the body along x, (R.45)
        Nxx, Nxy, Nxw = 0.0, 0.0, 0.0
        Nyy, Nyw, Nww = c.body[i, N_YY], c.body[i, N_YW], c.body[i, N_WW]
        if len(sizes.geometric) > 0:
            along = work.body[i, MEAN_Y] * Ay + work.body[i, MEAN_W] * Aw
            along += work.body[i, MEAN_FX] * fx
            along += work.body[i, TRANSFER_YX] * fy + work.body[i, TRANSFER_WX] * fw
            along = c.body[i, INVERSE_MASS] * along + work.body[i, MEAN_LAG]
            along += work.body[i, MEAN_LEFT] * Ax
            Nxx, Nxy, Nxw = (
                work.body[i, BENT_N_XX],
                work.body[i, BENT_N_XY],
                work.body[i, BENT_N_XW],
            )
            Nyy, Nyw, Nww = (
                work.body[i, BENT_N_YY],
                work.body[i, BENT_N_YW],
                work.body[i, BENT_N_WW],
            )
        for j in range(len(sizes.geometric)):
            work.acceleration[i, 1 + j] += c.mode[i, j, MODE_MOBILITY] * (
                work.mode[i, j, D0_ETA] * along - work.mode[i, j, FX] * fx
            )
        tip_x = work.body[i, TRANSFER_XX] * Ax + work.body[i, TRANSFER_XY] * Ay
        tip_y = work.body[i, TRANSFER_YX] * Ax + work.body[i, TRANSFER_YY] * Ay
        tip_w = work.body[i, TRANSFER_WX] * Ax + work.body[i, TRANSFER_WY] * Ay
        tip_x += work.body[i, TRANSFER_XW] * Aw - (Nxx * fx + Nxy * fy + Nxw * fw)
        tip_y += work.body[i, TRANSFER_YW] * Aw - (Nxy * fx + Nyy * fy + Nyw * fw)
        tip_w += work.body[i, TRANSFER_WW] * Aw - (Nxw * fx + Nyw * fy + Nww * fw)
        Ax = tip_x + work.body[i, DRIFT_X]
        Ay = tip_y + work.body[i, DRIFT_Y]
        Aw = tip_w + work.body[i, DRIFT_W]
        if len(sizes.tree) > 0:
            work.body[i, TIP_ACCELERATION_X] = Ax
            work.body[i, TIP_ACCELERATION_Y] = Ay
            work.body[i, TIP_ACCELERATION_W] = Aw
