"""Add a diagonal to the mass matrix: forward dynamics then solves implicit steps, (R.27), (R.28).

=============  =================================================================================
symbol         meaning
=============  =================================================================================
``Delta``      1 + what is added to a mode
``share``      1 - 1 / Delta: how much of a mode no longer follows the root
=============  =================================================================================

The residual inertia ``H - C' C`` of (R.7) is known to full precision and nearly nothing on a fine
mesh; that of the implicit step is ``H - C' C / Delta = (H - C' C) + C' share C``: a sum of positive
terms, as accurate for Delta = 1 as for large ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.kernels.cache import compiled
from flexarm.kernels.layout import ArmConstants, Array, Sizes

#: What an implicit step changes of an arm's constants.
_CHANGED = ("mobility", "joint_added", "residual_inertia", "residual_tip", "N")


def constants_to_soften(constants: ArmConstants) -> ArmConstants:
    """Return the constants with arrays of their own where ``add_to_diagonal`` writes."""
    own: dict[str, Any] = {name: np.array(getattr(constants, name)) for name in _CHANGED}
    return constants._replace(**own)


@compiled
def add_to_diagonal(
    sizes: Sizes, constants: ArmConstants, added: Array, softened: ArmConstants
) -> None:
    """Make ``softened`` the constants of ``M + added``; ``added`` (n, 1 + m) is not negative."""
    c = constants
    for i in range(len(sizes.bodies)):
        softened.joint_added[i] = added[i, 0]
        yy = c.residual_inertia[i, 0]
        yw = c.residual_inertia[i, 1]
        ww = c.residual_inertia[i, 2]
        tip_yy = c.residual_tip[i, 0]
        tip_yw = c.residual_tip[i, 1]
        tip_wy = c.residual_tip[i, 2]
        tip_ww = c.residual_tip[i, 3]
        Nyy = 0.0
        Nyw = 0.0
        Nww = 0.0
        for j in range(len(sizes.modes)):
            mobility = 1.0 / (1.0 + added[i, 1 + j])
            share = added[i, 1 + j] * mobility
            softened.mobility[i, j] = mobility
            yy += share * c.S[i, j] * c.S[i, j]
            yw += share * c.S[i, j] * c.a[i, j]
            ww += share * c.a[i, j] * c.a[i, j]
            tip_yy += share * c.P[i, j] * c.S[i, j]
            tip_yw += share * c.P[i, j] * c.a[i, j]
            tip_wy += share * c.dP[i, j] * c.S[i, j]
            tip_ww += share * c.dP[i, j] * c.a[i, j]
            Nyy += mobility * c.P[i, j] * c.P[i, j]
            Nyw += mobility * c.P[i, j] * c.dP[i, j]
            Nww += mobility * c.dP[i, j] * c.dP[i, j]
        softened.residual_inertia[i, 0] = yy
        softened.residual_inertia[i, 1] = yw
        softened.residual_inertia[i, 2] = ww
        softened.residual_tip[i, 0] = tip_yy
        softened.residual_tip[i, 1] = tip_yw
        softened.residual_tip[i, 2] = tip_wy
        softened.residual_tip[i, 3] = tip_ww
        softened.N[i, 0] = Nyy
        softened.N[i, 1] = Nyw
        softened.N[i, 2] = Nww
