"""Where the theories end in a run: at large deflection."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.bending import LARGEST_ERROR, BendingErrors, too_far_bent
from flexarm.integrate.base import FloatArray

#: Deflection over length that no link ever had.
_ABSURD = 10.0


def runs_away(arm: Arm, state: FloatArray) -> str:
    """Say which link bends by many times its length, as only an unstable loop makes it; or nothing.

    The linear theory would follow it for as long as numbers last.
    """
    bent = np.abs(np.einsum("nm,nm->n", arm.assembly.constants.P, state[0, :, 1:]))
    for piece in arm.assembly.pieces:
        times = bent[piece.body] / piece.shapes.length
        if times > _ABSURD:
            return f"link {piece.link + 1} has bent by {times:.3g} times its length"
    return ""


class BendingWatch:
    """``too_far_bent`` of one state after another, fast enough for every sample time."""

    def __init__(self, arm: Arm) -> None:
        self._arm, self._errors = arm, BendingErrors(arm)
        self._allowed = LARGEST_ERROR * arm.lengths

    def __call__(self, state: FloatArray) -> str:
        """Describe the error of the theory at a state (2, n, 1 + m); empty where it is small."""
        if not (self._errors.of_links(state[None])[0][0] > self._allowed).any():
            return ""
        return too_far_bent(self._arm, state[None])
