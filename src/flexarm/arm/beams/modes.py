"""Mass-normalised shapes of a flexible link, complete or reduced, as its coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.arm.beams.assembly import BeamMatrices
from flexarm.arm.beams.hermite import FloatArray
from flexarm.base.errors import InputError, Problem

# Rounding errors are 1e-13 on meshes of 256 elements; if the matrix is not positive definite, the
# error is far larger than this limit.
_ORTHONORMALITY = 1e-10
# The shapes must diagonalise the stiffness up to the rounding error of the product itself plus this
# relative tolerance. The check detects wrong algebra, not lost digits.
_DIAGONALITY = 1e-7


@dataclass(frozen=True, eq=False)
class BeamBasis:
    """Mass-normalised shapes Phi of one link: nodal coordinates are `basis @ eta`.

    Attributes:
        basis: (n, m) with n = 2 * elements: column j contains shape j at the nodes (m and rad per
            unit of eta_j, which is in sqrt(kg) m).
        projector: (m, n) `basis^T M`: eta of a nodal deflection; for one outside the span of the
            shapes, eta of its mass-orthogonal projection.
        w2: (m,) stiffness over the shapes (rad^2/s^2), increasing: squared frequencies of the
            clamped link.

    Raises:
        InputError: if `projector @ basis` is not the identity.
    """

    basis: FloatArray
    projector: FloatArray
    w2: FloatArray

    def __post_init__(self) -> None:
        shapes = self.basis.shape[1]
        error = np.abs(self.projector @ self.basis - np.eye(shapes)).max(initial=0.0)
        if not error < _ORTHONORMALITY:
            raise InputError(
                Problem(
                    "projector @ basis",
                    f"be the identity to {_ORTHONORMALITY:g}",
                    f"an error of {error:.2g}",
                    "The mass matrix may not be positive definite.",
                )
            )


def beam_basis(
    matrices: BeamMatrices, strain_to_nodal: FloatArray, element_length: float, modes: int | None
) -> BeamBasis:
    """Compute the shapes of a link.

    The complete set consists of the eigenvectors of stiffness and mass of the clamped link: the
    finite element model itself in other coordinates. The reduced set is that of Craig and Bampton:
    the static shapes of a unit force and a unit moment at the tip, where the rest of the arm acts,
    then the lowest modes with the tip also clamped, all diagonalised again within their span.

    Args:
        matrices: matrices of the link.
        strain_to_nodal: (n, n) F of `flexibility.strain_to_nodal`.
        element_length: h (m), the unit of its rotation rows.
        modes: m, or None for all n. 1 keeps the tip force shape, 2 also the tip moment shape.

    Raises:
        InputError: if the mass matrix is not positive definite.

    Reference:
        R. R. Craig and M. C. C. Bampton, "Coupling of substructures for dynamic analyses",
        AIAA Journal 6(7), 1968, 1313-1319.
    """
    from scipy.linalg import solve_triangular

    # Rotations times the element length keep the mass matrix well conditioned on any mesh.
    units = np.tile([1.0, element_length], len(strain_to_nodal) // 2)
    root_mass = _mass_factor(matrices.mass / np.outer(units, units))
    # With M = G G^T and K^-1 = F F^T the modes are the left singular vectors of G^T F, and the
    # singular values 1/w. No squares are formed, so low frequencies have full precision.
    motion = root_mass.T @ strain_to_nodal
    if modes is not None:
        motion = motion @ _craig_bampton(motion, strain_to_nodal, modes)
    vectors, periods, _ = np.linalg.svd(motion, full_matrices=False)
    basis = solve_triangular(root_mass, vectors, lower=True, trans="T") / units[:, None]
    basis = basis * _signs(basis * units[:, None])
    found = BeamBasis(basis=basis, projector=basis.T @ matrices.mass, w2=1.0 / periods**2)
    _check_stiffness(found, matrices.stiffness)
    return found


def _mass_factor(mass: FloatArray) -> FloatArray:
    """Return the lower triangular G with M = G G^T."""
    try:
        return np.asarray(np.linalg.cholesky(mass), np.float64)
    except np.linalg.LinAlgError:
        lowest = float(np.linalg.eigvalsh(mass)[0])
        problem = Problem(
            "the mass matrix",
            "be positive definite",
            f"one with lowest eigenvalue {lowest:.3g}",
            "Give every element of the link some mass.",
        )
        raise InputError(problem) from None


def _craig_bampton(motion: FloatArray, strain_to_nodal: FloatArray, modes: int) -> FloatArray:
    """Return orthonormal strain coordinates z (n, m) of the reduced shapes.

    The strain of a tip force is the transposed tip row of F, and shapes with a clamped tip are
    orthogonal to it, so that one orthogonal matrix contains both.
    """
    split, _ = np.linalg.qr(strain_to_nodal[-2:].T, mode="complete")
    static, clamped = split[:, : min(modes, 2)], split[:, 2:]
    if modes <= 2:
        return static
    _, _, shapes = np.linalg.svd(motion @ clamped, full_matrices=False)
    return np.hstack([static, clamped @ shapes[: modes - 2].T])


def _signs(shapes: FloatArray) -> FloatArray:
    """Return signs (m,) that make the tip deflection positive, or else the largest entry."""
    tip, largest = shapes[-2], np.abs(shapes).max(axis=0)
    peak = shapes[np.abs(shapes).argmax(axis=0), np.arange(shapes.shape[1])]
    # Below this limit, rounding errors could determine the sign of the tip deflection.
    return np.where(np.where(np.abs(tip) > 1e-6 * largest, tip, peak) < 0.0, -1.0, 1.0)


def _check_stiffness(found: BeamBasis, stiffness: FloatArray) -> None:
    """Raise InputError unless the shapes diagonalise the stiffness to w2."""
    error = np.abs(found.basis.T @ stiffness @ found.basis - np.diag(found.w2))
    rounding = np.abs(found.basis).T @ np.abs(stiffness) @ np.abs(found.basis)
    frequency = np.sqrt(found.w2)
    allowed = _DIAGONALITY * np.outer(frequency, frequency)
    allowed += 10 * len(stiffness) * np.finfo(float).eps * rounding
    if not np.all(error <= allowed):
        worst = float((error / allowed).max())
        problem = Problem(
            "the stiffness over the shapes",
            "be diagonal",
            f"errors of {worst:.2g} times the tolerance",
            "Flexural rigidity or mass may vary by too many orders of magnitude along the link.",
        )
        raise InputError(problem)
