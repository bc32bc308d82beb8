"""Transfer functions of a linear model: frequency responses and transmission zeros.

Both use the state-space matrices directly, because the coefficients of the polynomials of a
transfer function lose all digits with twenty states.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.assembly.assemble import FloatArray

#: A matrix counts as singular if its solution exceeds that of a regular one by this factor.
_SINGULAR = 1e13


def slowest_first(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return eigenvalues by ascending magnitude, then stable before unstable, then by sign.

    Magnitudes are compared to nine digits, because the last digits differ between machines and
    would change the order of a conjugate pair.
    """
    size = np.abs(values)
    direction = np.round(values / np.maximum(size, np.finfo(float).tiny), 9)
    digits = np.array([float(f"{one:.8e}") for one in size])
    return values[np.lexsort((values.imag, direction.real, np.abs(direction.imag), digits))]


def frequency_response(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, omega: FloatArray
) -> NDArray[np.complex128]:
    """Return C (i omega - A)^-1 B + D, (frequencies, outputs, inputs); NaN at undamped poles."""
    from scipy.linalg import matrix_balance

    A, (scale, _) = matrix_balance(A, permute=False, separate=True)
    B, C = B / scale[:, None], C * scale
    dynamic = np.asarray(1j * omega[:, None, None] * np.eye(len(A)) - A, dtype=np.complex128)
    states = _solved(dynamic, B)
    # Norms of the scaled matrices, because squares of huge frequencies overflow.
    least = np.finfo(float).tiny
    size = np.abs(dynamic).max(axis=(1, 2), keepdims=True, initial=least)
    growth = np.linalg.norm(dynamic / size, axis=(1, 2))
    growth *= np.linalg.norm(states * size, axis=(1, 2))
    states[~(growth < _SINGULAR * np.linalg.norm(B))] = np.nan
    response: NDArray[np.complex128] = C @ states + D
    return response


def _solved(matrices: NDArray[np.complex128], B: FloatArray) -> NDArray[np.complex128]:
    """Solve with many matrices; return NaN for those that are exactly singular."""
    right = np.broadcast_to(B, (len(matrices), *B.shape))
    try:
        return np.asarray(np.linalg.solve(matrices, right), dtype=complex)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full(right.shape, complex(np.nan, np.nan))
    return np.concatenate([_solved(matrices[k : k + 1], B) for k in range(len(matrices))])


def transmission_zeros(A: FloatArray, b: FloatArray, c: FloatArray, d: float) -> Any:
    """Return the transmission zeros of one input and one output (zeros,), complex, 1/s.

    In ascending magnitude. A zero is an s for which a state x and an input u other than zero exist
    with s x = A x + b u and c x + d u = 0. Without feedthrough the pencil of these equations has
    eigenvalues at infinity whose rounding errors affect the finite ones, so they are removed
    beforehand. For a velocity (c b not zero), x is in the null space of c; for a position, it is in
    that of c and c A. Only the equations orthogonal to b, and for a position to c, are independent
    of these constraints. The states are scaled first, because coordinates and their rates differ by
    a factor of the highest frequency, 1e5 on a fine mesh.

    Source: A. Emami-Naeini and P. Van Dooren, Computation of zeros of linear multivariable systems,
    Automatica 18 (1982) 415-430, for the pencil and for the deflation of infinite zeros.
    """
    from scipy.linalg import eigvals, matrix_balance, null_space

    if not ((np.any(b) and np.any(c)) or d != 0.0):
        return np.zeros(0, dtype=complex)  # no effect at any frequency
    A, (scale, _) = matrix_balance(A, permute=False, separate=True)
    b, c = b / scale, c * scale
    if d != 0.0:
        found = eigvals(A - np.outer(b, c) / d)
    else:
        # Scales are powers of two, so that the product of a position and a force is exactly zero.
        constraints = np.array([c] if c @ b != 0.0 else [c, c @ A])
        constraints /= np.linalg.norm(constraints, axis=1, keepdims=True)
        orthogonal = np.vstack([b / np.linalg.norm(b), constraints[:-1]])
        allowed, equations = null_space(constraints), null_space(orthogonal)
        # The direct effect of a torque on a distant point decreases with each element, so on a fine
        # mesh the magnitude of a zero may exceed the range of floating-point numbers.
        if allowed.shape[1] == 0:
            return np.zeros(0, dtype=complex)
        found = eigvals(equations.T @ A @ allowed, equations.T @ allowed)
        found = found[np.isfinite(found)]
    return slowest_first(found)
