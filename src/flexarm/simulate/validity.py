"""Where the linear theory ends: at large deflection, which it takes for small."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.assemble import Piece
from flexarm.integrate.base import FloatArray

#: Deflection over length beyond which the linear theory is off by whole per cents.
_FAR = 0.1
#: Deflection over length that no link ever had.
_ABSURD = 10.0
#: Samples looked at in one go: bounds the scratch memory of long runs.
_CHUNK = 4096


def too_far_bent(arm: Arm, states: FloatArray) -> str:
    """Say which link has bent too far for the linear theory; nothing where none has.

    A segment is judged by the deflection from its own root tangent: only that is taken for small.

    Args:
        states: (samples, 2, n, 1 + m).
    """
    found = _furthest_bent(arm, states) if arm.spec.theory == "linear" else None
    if found is None:
        return ""
    fact, piece = found
    more = "or more segments" if arm.spec.links[piece.link].segments > 1 else "and segments=2 to 4"
    return (
        f"{fact}: the linear theory takes that for small. Use "
        f"theory='second_order' {more} on that link; see docs/how-to/large-deflection.md."
    )


def too_far_deviated(arm: Arm, states: FloatArray) -> str:
    """Say which link has bent too far for linear deviations, which know no other theory.

    Args:
        states: (samples, 2, n, 1 + m).
    """
    found = _furthest_bent(arm, states)
    if found is None:
        return ""
    return (
        f"{found[0]}: linear deviations take that for small. fa.simulate follows the whole motion, "
        "with theory='second_order' where links bend that far; see docs/how-to/large-deflection.md."
    )


def _furthest_bent(arm: Arm, states: FloatArray) -> tuple[str, Piece] | None:
    """Tell the piece that bends furthest for its length, if that is beyond what is small."""
    if not len(states):
        return None
    P = arm.assembly.constants.P
    most = np.zeros(len(P))
    for k in range(0, len(states), _CHUNK):
        bent = np.einsum("nm,tnm->tn", P, states[k : k + _CHUNK, 0, :, 1:])
        most = np.maximum(most, np.abs(bent).max(axis=0))
    pieces = arm.assembly.pieces
    far = [most[piece.body] / piece.shapes.length for piece in pieces]
    worst = pieces[int(np.argmax(far))]
    if not max(far) > _FAR:
        return None
    name = f"link {worst.link + 1}"
    if arm.spec.links[worst.link].segments > 1:
        name = f"a segment of {name}"
    fact = (
        f"{name} deflects by up to {most[worst.body]:.3g} m, {max(far):.0%} of its length of "
        f"{worst.shapes.length:.4g} m"
    )
    return fact, worst


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
    """``too_far_bent`` of one state after another, quick enough to ask at every sample time."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        lengths = np.ones(arm.assembly.bodies)
        for piece in arm.assembly.pieces:
            lengths[piece.body] = piece.shapes.length
        linear = arm.spec.theory == "linear"
        self._per_length = arm.assembly.constants.P / lengths[:, None] if linear else None

    def __call__(self, state: FloatArray) -> str:
        """Say which link has bent too far at a state (2, n, 1 + m), or nothing."""
        if self._per_length is None:
            return ""
        bent = (self._per_length * state[0, :, 1:]).sum(axis=1)
        if not np.abs(bent).max() > _FAR:
            return ""
        return too_far_bent(self._arm, state[None])
