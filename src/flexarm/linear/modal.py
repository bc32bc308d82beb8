"""Natural frequencies, damping ratios and mode shapes of an arm at a posture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, cholesky, eigh

from flexarm.arm import Arm
from flexarm.assemble import FloatArray
from flexarm.errors import InputError, Problem, shown

JOINTS = ("locked", "free")
#: Squared frequencies below this part of the shift are rounding about a rigid-body mode.
_ZERO = 1e-10


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of small vibration, frequencies ascending.

    Attributes:
        frequency_hz: (k,) undamped natural frequencies; zero for rigid-body modes, and for modes
            that gravity makes unstable (``squared_frequency`` is negative there).
        damping_ratio: (k,) of each mode, from the damping that acts on its own shape; NaN where
            the frequency is zero.
        squared_frequency: (k,) eigenvalues, rad^2/s^2.
        shapes: (k, dof) shapes in the arm's coordinates, unit modal mass.
    """

    frequency_hz: FloatArray
    damping_ratio: FloatArray
    squared_frequency: FloatArray
    shapes: FloatArray


def modes(arm: Arm, joint_angles: ArrayLike | None = None, joints: str = "locked") -> Modes:
    """Compute the modes about straight links at rest.

    Args:
        arm: the arm.
        joint_angles: (joints,) relative, rad; all zero by default.
        joints: "locked" clamps every joint, "free" lets every joint turn.

    Raises:
        InputError: unknown ``joints``, or angles of the wrong shape.

    The stiffness is the Hessian of strain and gravity energy at that posture, which is the
    tangent stiffness where the posture is held there.
    """
    if joints not in JOINTS:
        rule = "be one of " + ", ".join(map(repr, JOINTS))
        raise InputError(Problem("modes", "joints", rule, shown(joints)))
    q = arm.rest(np.zeros(arm.joints) if joint_angles is None else joint_angles)
    M, K, C = arm.mass_matrix(q), arm.stiffness_matrix(q), arm.damping_matrix()
    kept = np.arange(arm.dof)
    if joints == "locked":
        kept = np.setdiff1d(kept, arm.joint_index)
    part = np.ix_(kept, kept)
    squared, vectors = _eigen(M[part], K[part])
    frequency = np.sqrt(np.maximum(squared, 0.0))
    damping = np.einsum("ik,ij,jk->k", vectors, C[part], vectors)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(frequency > 0.0, damping / (2.0 * frequency), np.nan)
    shapes = np.zeros((kept.size, arm.dof))
    shapes[:, kept] = vectors.T
    return Modes(frequency / (2.0 * np.pi), ratio, squared, shapes)


def _eigen(M: FloatArray, K: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve K x = lambda M x for all pairs, the low ones accurately.

    The stiffest modes of a fine mesh are 1e10 times stiffer than the lowest, whose digits a direct
    solution would lose. Solving ``M x = mu (K + s M) x`` puts the low modes at the accurate end.
    """
    if M.size == 0:
        return np.zeros(0), np.zeros((0, 0))
    shift = _positive_shift(M, K)
    mu, vectors = eigh(M, K + shift * M)
    squared = 1.0 / mu[::-1] - shift
    vectors = vectors[:, ::-1] / np.sqrt(mu[::-1])
    squared[np.abs(squared) < _ZERO * shift] = 0.0
    largest = np.argmax(np.abs(vectors), axis=0)
    signs = np.sign(vectors[largest, np.arange(vectors.shape[1])])
    return squared, vectors * signs


def _positive_shift(M: FloatArray, K: FloatArray) -> float:
    """Find a shift that makes K + shift M positive definite, near the lowest stiffness."""
    diagonal = np.abs(np.diag(K)) / np.diag(M)
    positive = diagonal[diagonal > 0.0]
    shift = float(positive.min()) if positive.size else 1.0
    while True:
        try:
            cholesky(K + shift * M)
        except LinAlgError:
            shift *= 4.0
        else:
            return shift
