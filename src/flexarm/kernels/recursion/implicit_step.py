"""Diagonal additions to the mass matrix for implicit steps, (R.27), (R.28).

=============  =================================================================================
symbol         meaning
=============  =================================================================================
``Delta``      1 + the addition to the diagonal entry of a mode
``share``      1 - 1 / Delta: fraction of a mode that no longer follows the root
=============  =================================================================================

The residual inertia ``H - C' C`` of (R.7) is known to full precision and almost zero on a fine
mesh. That of the implicit step is ``H - C' C / Delta = (H - C' C) + C' share C``, a sum of
positive terms, which is equally accurate for all Delta.
"""

from __future__ import annotations

from flexarm.kernels.columns import (
    DP,
    JOINT_ADDED,
    MODE_MOBILITY,
    N_WW,
    N_YW,
    N_YY,
    RESIDUAL_TIP_WW,
    RESIDUAL_TIP_WY,
    RESIDUAL_TIP_YW,
    RESIDUAL_TIP_YY,
    RESIDUAL_WW,
    RESIDUAL_YW,
    RESIDUAL_YY,
    A,
    P,
    S,
)
from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.layout import ArmConstants, Array, Sizes


def constants_to_soften(constants: ArmConstants) -> ArmConstants:
    """Return the constants with copies of the arrays that ``add_to_diagonal`` writes."""
    return constants._replace(body=constants.body.copy(), mode=constants.mode.copy())


@compiled
def add_to_diagonal(
    sizes: Sizes, constants: ArmConstants, added: Array, softened: ArmConstants
) -> None:
    """Write the constants of ``M + added`` to ``softened``; ``added`` (n, 1 + m) is >= 0."""
    c = constants
    for i in range(len(sizes.bodies)):
        softened.body[i, JOINT_ADDED] = added[i, 0]
        yy = c.body[i, RESIDUAL_YY]
        yw = c.body[i, RESIDUAL_YW]
        ww = c.body[i, RESIDUAL_WW]
        tip_yy = c.body[i, RESIDUAL_TIP_YY]
        tip_yw = c.body[i, RESIDUAL_TIP_YW]
        tip_wy = c.body[i, RESIDUAL_TIP_WY]
        tip_ww = c.body[i, RESIDUAL_TIP_WW]
        Nyy = 0.0
        Nyw = 0.0
        Nww = 0.0
        for j in range(len(sizes.modes)):
            mobility = 1.0 / (1.0 + added[i, 1 + j])
            share = added[i, 1 + j] * mobility
            softened.mode[i, j, MODE_MOBILITY] = mobility
            yy += share * c.mode[i, j, S] * c.mode[i, j, S]
            yw += share * c.mode[i, j, S] * c.mode[i, j, A]
            ww += share * c.mode[i, j, A] * c.mode[i, j, A]
            tip_yy += share * c.mode[i, j, P] * c.mode[i, j, S]
            tip_yw += share * c.mode[i, j, P] * c.mode[i, j, A]
            tip_wy += share * c.mode[i, j, DP] * c.mode[i, j, S]
            tip_ww += share * c.mode[i, j, DP] * c.mode[i, j, A]
            Nyy += mobility * c.mode[i, j, P] * c.mode[i, j, P]
            Nyw += mobility * c.mode[i, j, P] * c.mode[i, j, DP]
            Nww += mobility * c.mode[i, j, DP] * c.mode[i, j, DP]
        softened.body[i, RESIDUAL_YY] = yy
        softened.body[i, RESIDUAL_YW] = yw
        softened.body[i, RESIDUAL_WW] = ww
        softened.body[i, RESIDUAL_TIP_YY] = tip_yy
        softened.body[i, RESIDUAL_TIP_YW] = tip_yw
        softened.body[i, RESIDUAL_TIP_WY] = tip_wy
        softened.body[i, RESIDUAL_TIP_WW] = tip_ww
        softened.body[i, N_YY] = Nyy
        softened.body[i, N_YW] = Nyw
        softened.body[i, N_WW] = Nww
