"""Gauss collocation with three stages for second-order equations: polynomials over one step.

The acceleration is a quadratic polynomial over a step; rate and coordinate are its integrals. The
method has order 6 at the ends of steps. It is symmetric, so it adds neither damping nor growth.

Reference:
    E. Hairer and G. Wanner, Solving Ordinary Differential Equations II (1996), section IV.5.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STAGES = 3
#: Stages as fractions of a step, 0 to 1.
PLACES: Floats = 0.5 + np.polynomial.legendre.leggauss(STAGES)[0] / 2.0


def _lagrange() -> Floats:
    """Return coefficients (3, 3), rising powers, of the polynomials that are 1 at one stage."""
    return np.asarray(np.linalg.inv(np.vander(PLACES, increasing=True)).T, dtype=np.float64)


def rate_weights(theta: Floats) -> Floats:
    """Return integrals (..., 3) of the stage polynomials up to theta: the rate is v + h w.a."""
    powers = theta[..., None] ** np.arange(1.0, STAGES + 1.0)
    weights: Floats = (powers / np.arange(1.0, STAGES + 1.0)) @ _lagrange().T
    return weights


def place_weights(theta: Floats) -> Floats:
    """Return double integrals (..., 3): the coordinate is q + theta h v + h^2 w.a."""
    p = np.arange(2.0, STAGES + 2.0)
    weights: Floats = (theta[..., None] ** p / (p * (p - 1.0))) @ _lagrange().T
    return weights


#: Weights (3, 3) at the stages (rows), and (3,) at the end of a step.
RATE_AT_STAGES = rate_weights(PLACES)
#: Not the double integrals, which would give a Nystrom method that is unstable for stiff modes.
PLACE_AT_STAGES = RATE_AT_STAGES @ RATE_AT_STAGES
RATE_AT_END = rate_weights(np.array(1.0))
PLACE_AT_END = place_weights(np.array(1.0))


def stage_times(edges: Floats) -> Floats:
    """Return the times (N, 3) of the stages of N steps between edges (N + 1,)."""
    times: Floats = edges[:-1, None] + np.diff(edges)[:, None] * PLACES
    return times


def interpolate(
    edges: Floats, q: Floats, qd: Floats, stages: Floats, times: Floats
) -> tuple[Floats, Floats]:
    """Evaluate q and qd (T, k) at times (T,) from edges (N + 1, k) and stages (N, 3, k)."""
    i = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(edges) - 2)
    h = np.diff(edges)[i, None]
    theta = (times - edges[i])[:, None] / h
    rate = np.einsum("ts,tsk->tk", rate_weights(theta[:, 0]), stages[i])
    place = np.einsum("ts,tsk->tk", place_weights(theta[:, 0]), stages[i])
    return q[i] + theta * h * qd[i] + h**2 * place, qd[i] + h * rate


def step_edges(breaks: Floats, longest: float) -> Floats:
    """Divide each interval between breaks evenly into steps no longer than ``longest``."""
    parts = [breaks[:1]]
    for a, b in pairwise(breaks):
        count = max(int(np.ceil((b - a) / longest * (1.0 - 1e-12))), 1)
        parts.append(np.linspace(a, b, count + 1)[1:])
    return np.concatenate(parts)
