"""Inverse dynamics and tip motion along a motion of all coordinates, with exact derivatives."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.kernels.derivatives.inverse_sensitivity import inverse_jacobian_many

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm.arm.arm import Arm

    Floats = NDArray[np.float64]


class DynamicsAlong(NamedTuple):
    """Forces and tip motions at T instants, with their derivatives, exact to rounding.

    The axis of length 3 holds derivatives by q, qd and qdd.
    """

    force: Floats  # (T, dof) M qdd + bias
    tip: Floats  # (T, 6) x, y m, their rates m/s and accelerations m/s^2, world axes
    force_by: Floats  # (T, dof, 3, dof)
    tip_by: Floats  # (T, 6, 3, dof)


def dynamics_along(arm: Arm, q: Floats, qd: Floats, qdd: Floats) -> DynamicsAlong:
    """Evaluate inverse dynamics and tip motion along q, qd, qdd, each (T, dof)."""
    kernels, kept = KernelView(arm.assembly.constants, complex), arm.assembly.coordinates
    count, (n, width) = len(q), kernels.shape
    forces, tips = np.zeros((count, n, width)), np.zeros((count, 6))
    force_by = np.zeros((count, 3, n, width, n, width))
    tip_by = np.zeros((count, 3, n, width, 6))
    kernels.call(
        inverse_jacobian_many,
        arm.padded(np.stack([q, qd], axis=1)).astype(complex),
        arm.padded(qdd).astype(complex),
        kernels.loads,
        kernels.work,
        *kernels.pose_arrays(),
        np.zeros(6, dtype=complex),
        forces,
        tips,
        force_by,
        tip_by,
    )
    by_force = force_by.reshape(count, 3, n * width, n * width)[:, :, kept][..., kept]
    by_tip = tip_by.reshape(count, 3, n * width, 6)[:, :, kept]
    return DynamicsAlong(
        force=arm.unpadded(forces),
        tip=tips,
        force_by=by_force.transpose(0, 3, 1, 2),
        tip_by=by_tip.transpose(0, 3, 1, 2),
    )
