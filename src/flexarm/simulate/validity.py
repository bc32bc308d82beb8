"""Where the theories end.

The linear one at large deflection, which it takes for small; the second-order one where its mass
matrix, positive for small bending only, loses its sign.
"""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.assemble import Piece
from flexarm.integrate.base import FloatArray
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes

#: A joint that feels less than this part of its inertia at straight links is about to feel none.
_LEFT = 0.1

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


def weakest_joint(arm: Arm, state: FloatArray) -> int | None:
    """Return the link (from 0) whose joint's inertia has all but vanished by bending, or None.

    The second-order theory truncates the kinetic energy, and what it drops keeps the mass matrix
    positive at large deflection (theory page "link"). The articulated inertia D of a joint is its
    pivot in the elimination: it passes through zero first.

    Args:
        state: (2, n, 1 + m).
    """
    if arm.spec.theory != "second_order":
        return None
    bent = _joint_inertias(arm, state[0])
    straight = state[0].copy()
    straight[:, 1:] = 0.0
    ratio = bent / _joint_inertias(arm, straight)
    ratio[arm.assembly.constants.free == 0.0] = 1.0
    lowest = int(np.argmin(ratio))
    if ratio[lowest] >= _LEFT:
        return None
    return next(piece.link for piece in arm.assembly.pieces if piece.body >= lowest)


def _joint_inertias(arm: Arm, coordinates: FloatArray) -> FloatArray:
    constants = arm.assembly.constants
    work = new_workspace(constants)
    at_rest = np.stack([coordinates, np.zeros_like(coordinates)])
    no_torque, unloaded = np.zeros(arm.assembly.bodies), no_loads(constants)
    forward_dynamics(run_time_sizes(constants), constants, at_rest, no_torque, unloaded, work)
    return work.joint[:, 2].copy()
