"""Descent steps towards a stable equilibrium.

Newton's method solves K dx = -g whatever the signs of the eigenvalues of the stiffness K, so a
column that is bent the wrong way returns to the straight, unstable equilibrium. With the absolute
values of the eigenvalues in place of the eigenvalues every step decreases the potential, and near a
stable equilibrium it is the Newton step (Dauphin et al., Advances in Neural Information Processing
Systems 27 (2014) 2933-2941, "saddle-free Newton").
"""

from __future__ import annotations

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray

#: Largest rotation (rad) of a joint or of an end of a segment in one step: for larger rotations
#: the linearisation with the present stiffness is not accurate.
LONGEST = 0.2
#: Lower bound of the eigenvalues relative to the largest: a joint without a spring has a zero one.
_SOFTEST = 1e-12


def descent_step(
    K: FloatArray, M: FloatArray, force: FloatArray, size: float
) -> tuple[FloatArray, bool]:
    """Return the descent step (k,) under a force (k,), and whether K is positive definite.

    Args:
        size: step of a coordinate without stiffness, m kg^0.5.
    """
    from scipy.linalg import eigh

    values, vectors = eigh((K + K.T) / 2.0, M)
    pull = vectors.T @ force
    # Without a stiffness of its own, a free joint moves as on a spring of the size of the force.
    stiffness = np.abs(values)
    soft = stiffness <= _SOFTEST * stiffness.max()
    stiffness[soft] = max(float(np.linalg.norm(pull)) / size, 1e-300)
    return np.asarray(vectors @ (pull / stiffness)), bool(values.min() > 0.0)


def largest_turn(arm: Arm, step: FloatArray) -> float:
    """Return the largest rotation (rad) of a joint or of an end of a segment in a step (dof,)."""
    turns = [
        np.abs(step[[seat.angle, *([seat.twist] if seat.twist else [])]]).max()
        for seat in arm.assembly.seats
    ]
    turns += [abs(float(p.shapes.dP @ step[p.modal])) for p in arm.assembly.pieces]
    return max(turns, default=0.0)
