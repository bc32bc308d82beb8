"""World coordinates of the deformed axis, and strain at gauges.

Theory page "recursion", (R.22) and (R.23). ``rows`` contains the shapes at stations: Phi for points
of the axis, -distance * Phi'' for gauges.
"""

from __future__ import annotations

from flexarm.kernels.compilation.cache import compiled, merged
from flexarm.kernels.compilation.numbers import cos, sin
from flexarm.kernels.layout import Array, Sizes


@compiled
def axis_points(
    sizes: Sizes,
    state: Array,
    body_poses: Array,
    bodies: Array,
    stations: Array,
    rows: Array,
    shortening: Array,
    points: Array,
) -> None:
    """Fill ``points`` (k, 2): world coordinates of the neutral axis, m.

    ``body_poses`` come from ``observables.poses``; ``bodies`` (k,) are integers; ``stations`` (k,)
    in m from the body's root; ``rows`` (k, m); ``shortening`` (k, g, g), the matrices g(x).
    """
    for k in range(stations.shape[0]):
        i = bodies[k]
        v = 0.0
        for j in range(len(sizes.modes)):
            v += rows[k, j] * state[0, i, 1 + j]
        x = stations[k]
        for j in range(len(sizes.geometric)):
            for p in range(len(sizes.geometric)):
                x -= 0.5 * state[0, i, 1 + j] * shortening[k, j, p] * state[0, i, 1 + p]
        cosine = cos(body_poses[i, 2])
        sine = sin(body_poses[i, 2])
        points[k, 0] = body_poses[i, 0] + cosine * x - sine * v
        points[k, 1] = body_poses[i, 1] + sine * x + cosine * v


@merged
def strains_at(sizes: Sizes, state: Array, bodies: Array, rows: Array, strains: Array) -> None:
    """Fill ``strains`` (gauges,) from a state (2, n, 1 + m), as ``gauge_strains`` does."""
    for gauge in range(bodies.shape[0]):
        strain = 0.0
        for j in range(len(sizes.modes)):
            strain += rows[gauge, j] * state[0, bodies[gauge], 1 + j]
        strains[gauge] = strain


@compiled
def gauge_strains(
    sizes: Sizes, states: Array, bodies: Array, rows: Array, strains: Array
) -> None:  # fmt: skip
    """Fill ``strains`` (samples, gauges) from states (samples, 2, n, 1 + m).

    ``bodies`` (gauges,) integers; ``rows`` (gauges, m): strain per modal coordinate.
    """
    for sample in range(states.shape[0]):
        strains_at(sizes, states[sample], bodies, rows, strains[sample])
