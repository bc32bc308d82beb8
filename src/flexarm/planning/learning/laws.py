"""Laws of iterative learning: theory page "control-learning", (C.102) to (C.106)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.control.hardware.measurement import FloatArray

#: Order of the Butterworth filter of which the Q-filter has the squared magnitude.
_ORDER = 2


class Law(NamedTuple):
    """Linear law of learning: the torques v of the next trial are ``Q v + G e``.

    Over the torques of all joints in all intervals, (N joints,), and the errors of all outputs at
    their ends, (N p,).
    """

    Q: FloatArray
    G: FloatArray

    def contraction(self, P: FloatArray) -> FloatArray:
        """Return the matrix that multiplies the change of torques in each trial; (C.103).

        ``P`` (N p, N joints) is the lifted model.
        """
        found: FloatArray = self.Q - self.G @ P
        return found


def norm_optimal(P: FloatArray, effort: float, change: float) -> Law:
    """Return the law of least errors, torques and changes of torques; (C.104).

    Args:
        P: (N p, N joints), lifted model.
        effort, change: weights of the torques and of their changes, relative to the largest
            singular value of ``P`` squared.
    """
    from scipy.linalg import cho_factor, cho_solve

    square = P.T @ P
    # The largest eigenvalue of P^T P is the square of the largest singular value of P.
    scale = float(np.linalg.eigvalsh(square)[-1])
    eye = np.eye(len(square))
    factor = cho_factor(square + (effort + change) * scale * eye)
    return Law(cho_solve(factor, square + change * scale * eye), cho_solve(factor, P.T))


def proportional_derivative(
    inverse: FloatArray,
    proportional: FloatArray,
    derivative: FloatArray,
    lead: int,
    interval: float,
) -> Law:
    """Return the law of proportional and derivative learning; (C.105).

    Args:
        inverse: (N, joints, p), joint errors per output error.
        proportional, derivative: (joints,) N m/rad and N m s/rad.
        lead: number of intervals by which a torque precedes its error.
        interval: s.
    """
    count, m, p = inverse.shape
    later = np.eye(count)[np.minimum(np.arange(count) + lead, count - 1)]
    rate = np.gradient(later, interval, axis=0)
    weights = proportional[:, None, None] * later + derivative[:, None, None] * rate
    G = np.einsum("jik,kjo->ijko", weights, inverse)
    return Law(np.eye(count * m), G.reshape(count * m, count * p))


def filtered(law: Law, joints: int, cutoff: float, interval: float) -> Law:
    """Return a law whose torques pass through a Q-filter without phase shift; (C.106).

    The filter multiplies the cosine transform by the squared magnitude of a Butterworth filter, so
    it is symmetric, preserves constants, and enlarges nothing.
    """
    count = len(law.Q) // joints
    return Law(*(_smooth(matrix, count, cutoff, interval) for matrix in law))


def _smooth(matrix: FloatArray, count: int, cutoff: float, interval: float) -> FloatArray:
    from scipy.fft import dct, idct

    hertz = np.arange(count) / (2.0 * count * interval)
    gain = 1.0 / (1.0 + (hertz / cutoff) ** (2 * _ORDER))
    columns = matrix.reshape(count, -1)
    spectrum = gain[:, None] * dct(columns, axis=0, norm="ortho")
    found: FloatArray = idct(spectrum, axis=0, norm="ortho").reshape(matrix.shape)
    return found
