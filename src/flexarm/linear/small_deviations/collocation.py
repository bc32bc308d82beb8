"""Gauss collocation of linear second-order equations, for many steps at once.

The acceleration is a quadratic polynomial over a step; rate and coordinate are its integrals. The
coefficients are those of `integrate.implicit.gauss`. The method is symmetric, so it adds neither
damping nor growth, and stiff modes do not require shorter steps.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flexarm.integrate.implicit.gauss import gauss_coefficients

Floats = NDArray[np.float64]

STAGES = 3
_METHOD = gauss_coefficients(STAGES)
#: Coefficients (3, 3), rising powers, of the polynomials that are 1 at one stage.
_LAGRANGE = np.linalg.inv(np.vander(_METHOD.c, increasing=True)).T


def stage_times(edges: Floats) -> Floats:
    """Return the times (N, 3) of the stages of N steps between edges (N + 1,)."""
    times: Floats = edges[:-1, None] + np.diff(edges)[:, None] * _METHOD.c
    return times


def stage_accelerations(h: Floats, M: Floats, D: Floats, K: Floats, force: Floats) -> Floats:
    """Solve ``M qdd + D qd + K q = force`` at the stages of N steps.

    Args:
        h: (N,) s, lengths of the steps.
        M, D, K: (N, s, k, k) at the stages, or (N, 1, k, k) constant over each step.
        force: (N, s, k, p) generalised forces at the stages.

    Returns:
        Accelerations (N, s, k, 2 k + p) per unit q and qd at the start of the step, and by each
        force.
    """
    count, s, k, p = force.shape
    step = h[:, None, None, None, None]
    # A A, not the double integrals: their method is unstable for stiff modes.
    a, b = (part[:, :, None, None] for part in (_METHOD.AA, _METHOD.A))
    G = step**2 * a * K[:, :, None] + step * b * D[:, :, None]
    G[:, range(s), range(s)] += M
    G = G.transpose(0, 1, 3, 2, 4).reshape(count, s * k, s * k)
    by_rate = D + step[..., 0] * _METHOD.c[:, None, None] * K
    right = np.concatenate([np.broadcast_to(-K, by_rate.shape), -by_rate, force], axis=3)
    solved: Floats = np.linalg.solve(G, right.reshape(count, s * k, -1))
    return solved.reshape(count, s, k, 2 * k + p)


def step_maps(h: Floats, accelerations: Floats) -> Floats:
    """Return the state (N, 2 k, 2 k + p) at the end of each step, from `stage_accelerations`.

    The columns are those of ``accelerations``.
    """
    k = accelerations.shape[2]
    h = h[:, None, None]
    places = h**2 * np.tensordot(accelerations, _METHOD.bA, axes=(1, 0))
    rates = h * np.tensordot(accelerations, _METHOD.b, axes=(1, 0))
    maps: Floats = np.concatenate([places, rates], axis=1)
    maps[:, range(2 * k), range(2 * k)] += 1.0
    maps[:, range(k), range(k, 2 * k)] += h[:, 0]
    return maps


def interpolate(
    edges: Floats, q: Floats, qd: Floats, stages: Floats, times: Floats
) -> tuple[Floats, Floats]:
    """Evaluate q and qd (T, k) at times (T,) from edges (N + 1, k) and stages (N, 3, k)."""
    i = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(edges) - 2)
    h = np.diff(edges)[i, None]
    theta = (times - edges[i])[:, None] / h
    powers = np.arange(1.0, STAGES + 1.0)
    single = (theta**powers / powers) @ _LAGRANGE.T
    double = (theta ** (powers + 1.0) / (powers * (powers + 1.0))) @ _LAGRANGE.T
    rate = np.einsum("ts,tsk->tk", single, stages[i])
    place = np.einsum("ts,tsk->tk", double, stages[i])
    return q[i] + theta * h * qd[i] + h**2 * place, qd[i] + h * rate


def step_edges(breaks: Floats, longest: float) -> Floats:
    """Divide each interval between breaks evenly into steps no longer than ``longest``."""
    parts = [breaks[:1]]
    for a, b in pairwise(breaks):
        count = max(int(np.ceil((b - a) / longest * (1.0 - 1e-12))), 1)
        parts.append(np.linspace(a, b, count + 1)[1:])
    return np.concatenate(parts)
