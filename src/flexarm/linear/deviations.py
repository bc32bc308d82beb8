"""Deviations from a rigid reference over time, by Gauss collocation.

The equations are linear, so each step is a linear map from its start to its end, computed for many
steps at once. Stiff modes do not require shorter steps; unresolved modes conserve their energy:
(D.6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.assemble import FloatArray
from flexarm.linear.smooth import SmoothMatrices
from flexarm.motion import Motion, gauss

#: Number of steps whose equations are solved in one batch: limits the memory.
_CHUNK = 256


@dataclass(frozen=True, eq=False)
class DeviationPath:
    """Deviations over N steps as piecewise polynomials.

    Attributes:
        edges: (N + 1,) s. dq, dqd: (N + 1, k) at the edges. stages: (N, 3, k) accelerations.
    """

    edges: FloatArray
    dq: FloatArray
    dqd: FloatArray
    stages: FloatArray

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return dq and dqd (T, k) at times (T,) within the edges."""
        return gauss.interpolate(self.edges, self.dq, self.dqd, self.stages, times)


def solve_deviations(
    matrices: SmoothMatrices,
    edges: FloatArray,
    dq: FloatArray,
    dqd: FloatArray,
    added: FloatArray | None = None,
) -> DeviationPath:
    """Integrate the deviations over the steps between the edges (N + 1,), s.

    Args:
        dq, dqd: (k,) at the first edge.
        added: (N, 3, k) generalised forces at the stages, in addition to ``r``.
    """
    k, parts = dq.size, []
    for first in range(0, len(edges) - 1, _CHUNK):
        chunk = edges[first : first + _CHUNK + 1]
        force = None if added is None else added[first : first + _CHUNK]
        parts.append(_march(chunk, _accelerations(matrices, chunk, force, k), dq, dqd))
        dq, dqd = parts[-1].dq[-1], parts[-1].dqd[-1]
    return DeviationPath(
        edges,
        np.concatenate([parts[0].dq[:1], *(part.dq[1:] for part in parts)]),
        np.concatenate([parts[0].dqd[:1], *(part.dqd[1:] for part in parts)]),
        np.concatenate([part.stages for part in parts]),
    )


def _accelerations(
    matrices: SmoothMatrices, edges: FloatArray, added: FloatArray | None, k: int
) -> FloatArray:
    """Return stage accelerations (N, 3, k, 2 k + 1) per unit dq and dqd, and by forces (last)."""
    times = gauss.stage_times(edges)
    count, s = times.shape
    M, D, K, r = (part.reshape(count, s, *part.shape[1:]) for part in matrices.at(times.ravel()))
    h = np.diff(edges)[:, None, None, None, None]
    a, b = gauss.PLACE_AT_STAGES[:, :, None, None], gauss.RATE_AT_STAGES[:, :, None, None]
    G = h**2 * a * K[:, :, None] + h * b * D[:, :, None]
    G[:, range(s), range(s)] += M
    G = G.transpose(0, 1, 3, 2, 4).reshape(count, s * k, s * k)
    by_rate = D + h[..., 0] * gauss.PLACES[:, None, None] * K
    force = r if added is None else r + added
    right = np.concatenate([-K, -by_rate, force[..., None]], axis=3)
    solved = np.linalg.solve(G, right.reshape(count, s * k, 2 * k + 1))
    return np.asarray(solved.reshape(count, s, k, 2 * k + 1))


def _march(edges: FloatArray, solved: FloatArray, dq: FloatArray, dqd: FloatArray) -> DeviationPath:
    """Advance from edge to edge with the accelerations of ``_accelerations``."""
    count, _, k = solved.shape[:3]
    h = np.diff(edges)[:, None, None]
    maps = np.empty((count, 2 * k, 2 * k + 1))
    maps[:, :k] = h**2 * np.tensordot(solved, gauss.PLACE_AT_END, axes=(1, 0))
    maps[:, k:] = h * np.tensordot(solved, gauss.RATE_AT_END, axes=(1, 0))
    maps[:, range(2 * k), range(2 * k)] += 1.0
    maps[:, range(k), range(k, 2 * k)] += h[:, 0]
    states = np.empty((count + 1, 2 * k))
    states[0] = np.concatenate([dq, dqd])
    for i in range(count):
        states[i + 1] = maps[i, :, :-1] @ states[i] + maps[i, :, -1]
    stages = solved[..., -1] + np.einsum("nskj,nj->nsk", solved[..., :-1], states[:-1])
    return DeviationPath(edges, states[:, :k], states[:, k:], stages)


def break_times(motion: Motion, until: float) -> FloatArray:
    """Return zero, the breaks of a motion before ``until``, and ``until``, s."""
    inner = np.array([t for t in motion.breaks if 0.0 < t < until])
    return np.concatenate([[0.0], inner, [until]])
