"""The lowest frequency of an arm with locked joints, which is its scale of time."""

from __future__ import annotations

import numpy as np

from flexarm.arm.arm import Arm


def lowest_frequency(arm: Arm) -> float:
    """Return the lowest angular frequency (rad/s) of the straight arm with locked joints.

    Without gravity and nonlinear springs. Infinite for a rigid arm.
    """
    from scipy.linalg import eigh

    elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
    if not elastic.size:
        return np.inf
    constants = arm.assembly.constants
    springs = np.concatenate([constants.joint_stiffness[:, None], constants.w2], axis=1)
    mass = arm.mass_matrix(arm.rest(np.zeros(arm.joints)))[np.ix_(elastic, elastic)]
    square = eigh(np.diag(arm.unpadded(springs)[elastic]), mass, eigvals_only=True)
    return float(np.sqrt(square[0]))
