"""Deviations from a rigid reference over time, by Gauss collocation.

The equations are linear, so each step is a linear map from its start to its end, computed for many
steps at once. Stiff modes do not require shorter steps; unresolved modes conserve their energy:
(D.6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.linear.small_deviations.collocation import (
    interpolate,
    stage_accelerations,
    stage_times,
    step_maps,
)
from flexarm.linear.small_deviations.smooth import SmoothMatrices
from flexarm.motion import Motion

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
        return interpolate(self.edges, self.dq, self.dqd, self.stages, times)


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
    times = stage_times(edges)
    count, s = times.shape
    M, D, K, r = (part.reshape(count, s, *part.shape[1:]) for part in matrices.at(times.ravel()))
    force = r if added is None else r + added
    return stage_accelerations(np.diff(edges), M, D, K, force[..., None])


def _march(edges: FloatArray, solved: FloatArray, dq: FloatArray, dqd: FloatArray) -> DeviationPath:
    """Advance from edge to edge with the accelerations of ``_accelerations``."""
    count, _, k = solved.shape[:3]
    maps = step_maps(np.diff(edges), solved)
    states = np.empty((count + 1, 2 * k))
    states[0] = np.concatenate([dq, dqd])
    for i in range(count):
        states[i + 1] = maps[i, :, :-1] @ states[i] + maps[i, :, -1]
    stages = solved[..., -1] + np.einsum("nskj,nj->nsk", solved[..., :-1], states[:-1])
    return DeviationPath(edges, states[:, :k], states[:, k:], stages)


def break_times(motion: Motion, until: float) -> FloatArray:
    """Return zero, the breaks of a motion before ``until``, and ``until``, s."""
    return np.unique(np.clip([0.0, *motion.breaks, until], 0.0, until))
