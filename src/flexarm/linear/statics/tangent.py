"""Mass, damping and stiffness matrices of small deviations; theory "small motion", (S.2)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.arm.actions.environment import EMPTY, Environment
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.kernels.derivatives.tangent import inverse_jacobian


class Tangent(NamedTuple):
    """Matrices M, D, K of M qdd + D qd + K q for small deviations, each (dof, dof)."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray


def tangent(
    arm: Arm,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    environment: Environment = EMPTY,
) -> Tangent:
    """Linearise the inverse dynamics about a motion q, qd, qdd, each (dof,); exact to rounding.

    If qd is not zero, ``damping`` includes gyroscopic terms and ``stiffness`` centrifugal terms.
    """
    kernels = KernelView(arm.assembly.constants, complex)
    n, width = kernels.shape
    jacobian = np.zeros((n, width, 2, n, width))
    kernels.call(
        inverse_jacobian,
        arm.padded(np.stack([q, qd])).astype(complex),
        arm.padded(qdd),
        environment.placed(arm),
        kernels.work,
        jacobian,
    )
    kept = arm.assembly.coordinates
    by_state = jacobian.reshape(n * width, 2, n * width)[kept]
    return Tangent(arm.mass_matrix(q), by_state[:, 1, kept], by_state[:, 0, kept])
