"""Where the second-order theory ends: its mass matrix is positive for small bending only."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.integrate.base import FloatArray
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes

#: A joint that feels less than this part of its inertia at straight links is about to feel none.
_LEFT = 0.1


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
