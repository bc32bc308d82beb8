"""Checks and products of gains that several controllers share."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flexarm.base.errors import Problem
from flexarm.control.hardware.measurement import FloatArray
from flexarm.model.quantities import length_of


def joint_problems(joints: int, given: Mapping[str, object]) -> list[Problem]:
    """Return a problem for each list that does not have one value for each joint."""
    rule = f"have length {joints}, one value for each joint"
    lengths = {name: length_of(value) for name, value in given.items()}
    wrong = {name: length for name, length in lengths.items() if length not in (None, joints)}
    return [Problem(name, rule, str(length)) for name, length in wrong.items()]


def applied(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return ``matrix @ vectors`` for a vector (k,), or for each of (runs, k) on its own.

    The matrix may be one for each run, (runs, j, k). A product of two matrices would be rounded
    differently for other numbers of runs.
    """
    found: FloatArray
    if vectors.ndim == 1:
        found = matrix.dot(vectors)  # half the time of ``@`` on small arrays
    else:
        found = np.matmul(matrix, vectors[..., None])[..., 0]
    return found
