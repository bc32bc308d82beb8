"""Steps towards a stable equilibrium, where Newton's method would as soon find an unstable one.

Newton's method solves K dx = -g whatever the signs of the stiffness K: from a column that is bent
the wrong way it goes back to the straight, unstable one. With the absolute values of the
eigenvalues in their place every step goes down the potential, and near a stable equilibrium it is
Newton's own (Dauphin et al., Advances in Neural Information Processing Systems 27 (2014)
2933-2941, "saddle-free Newton").
"""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.assemble import FloatArray

#: A step turns no joint and no end of a segment further than this (rad): beyond it the stiffness
#: says little.
LONGEST = 0.2
#: Eigenvalues count as this part of the largest at least: a joint without a spring has none.
_SOFTEST = 1e-12


def descent_step(K: FloatArray, M: FloatArray, force: FloatArray) -> tuple[FloatArray, bool]:
    """Return the step (k,) that the force (k,) makes, downhill, and whether K is stable there."""
    from scipy.linalg import eigh

    values, vectors = eigh((K + K.T) / 2.0, M)
    pull = vectors.T @ force
    # A free joint moves under its own weight as on a spring of the size of that weight.
    size = np.abs(values)
    soft = size <= _SOFTEST * size.max()
    size[soft] = max(float(np.linalg.norm(pull)), 1e-300)
    return np.asarray(vectors @ (pull / size)), bool(values.min() > 0.0)


def largest_turn(arm: Arm, step: FloatArray) -> float:
    """Largest rotation (rad) of a joint or of an end of a segment in a step (dof,)."""
    turns = [
        np.abs(step[[seat.angle, *([seat.twist] if seat.twist else [])]]).max()
        for seat in arm.assembly.seats
    ]
    turns += [abs(float(p.shapes.dP @ step[p.modal])) for p in arm.assembly.pieces]
    return max(turns, default=0.0)
