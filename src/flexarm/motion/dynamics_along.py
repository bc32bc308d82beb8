"""What a motion in all coordinates takes and does at the tip, with exact derivatives."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm.kernels.inverse_sensitivity import inverse_jacobian_many
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes
from flexarm.kernels.observables import POSE_COLUMNS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm.arm import Arm

    Floats = NDArray[np.float64]


class DynamicsAlong(NamedTuple):
    """Forces and tip motions at T instants, and their derivatives, exact to rounding.

    The axis of length 3 holds derivatives by q, qd and qdd.
    """

    force: Floats  # (T, dof) M qdd + bias
    tip: Floats  # (T, 6) x, y m, their rates m/s and accelerations m/s^2, world axes
    force_by: Floats  # (T, dof, 3, dof)
    tip_by: Floats  # (T, 6, 3, dof)


def dynamics_along(arm: Arm, q: Floats, qd: Floats, qdd: Floats) -> DynamicsAlong:
    """Evaluate inverse dynamics and tip along motions q, qd, qdd, each (T, dof)."""
    constants, kept = arm.assembly.constants, arm.assembly.coordinates
    count, (n, m) = len(q), constants.S.shape
    width = n * (1 + m)
    forces, tips = np.zeros((count, n, 1 + m)), np.zeros((count, 6))
    force_by = np.zeros((count, 3, n, 1 + m, n, 1 + m))
    tip_by = np.zeros((count, 3, n, 1 + m, 6))
    inverse_jacobian_many(
        run_time_sizes(constants),
        constants,
        arm.padded(np.stack([q, qd], axis=1)).astype(complex),
        arm.padded(qdd).astype(complex),
        no_loads(constants),
        new_workspace(constants, complex),
        np.zeros((n, POSE_COLUMNS), dtype=complex),
        np.zeros(6, dtype=complex),
        np.zeros(6, dtype=complex),
        forces,
        tips,
        force_by,
        tip_by,
    )
    by_force = force_by.reshape(count, 3, width, width)[:, :, kept][..., kept]
    by_tip = tip_by.reshape(count, 3, width, 6)[:, :, kept]
    return DynamicsAlong(
        force=arm.unpadded(forces),
        tip=tips,
        force_by=by_force.transpose(0, 3, 1, 2),
        tip_by=by_tip.transpose(0, 3, 1, 2),
    )
