"""Limits of the theories in a run: deflection, and the mass matrix of the second-order theory."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.bending import LARGEST_ERROR, BendingErrors, too_far_bent
from flexarm.integrate.base import FloatArray
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes

#: A joint that feels less than this part of its inertia at straight links is about to feel none.
_LEFT = 0.1

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
