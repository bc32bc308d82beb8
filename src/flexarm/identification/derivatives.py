"""Derivatives of the outputs of a record with respect to free parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexarm.errors import InputError
from flexarm.identification.runs import RecordRun
from flexarm.identification.space import Case, Space
from flexarm.integrate.base import FloatArray

#: Step of central differences, as a fraction of the scale of a parameter: the error of the
#: difference, which grows with its square, stays below that of the runs divided by it.
_STEP = 1e-4


def outputs_and_derivatives(
    run: RecordRun, space: Space, record: int, vector: FloatArray, places: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray] | str:
    """Return outputs and their derivatives, or the reason why the run at ``vector`` fails.

    Args:
        record: index of the record of ``run`` in ``space``.
        places: of the numbers to differentiate by in ``vector``.

    Returns:
        (samples, channels), and (samples, channels, places) per unit of each number. The latter
        are central differences; at a bound, or where one of both runs fails, one-sided ones, and
        zero where both fail.
    """
    lower, upper = space.bounds
    cases: list[Case] = [space.case(record, vector)]
    steps: list[tuple[int, float]] = []
    for k, place in enumerate(places):
        for sign in (1.0, -1.0):
            moved = vector.copy()
            moved[place] += sign * _STEP * space.scale[place]
            moved[place] = min(max(moved[place], lower[place]), upper[place])
            change = moved[place] - vector[place]
            if change == 0.0:
                continue
            try:
                cases.append(space.case(record, moved))
            except InputError:  # a bound that is not one of the parameter, such as a limit of sums
                continue
            steps.append((k, change))
    center, *others = run.simulate(cases)
    if isinstance(center, str):
        return center
    derivatives = np.zeros((*center.shape, len(places)))
    for k in range(len(places)):
        ends = [
            (change, outputs)
            for (j, change), outputs in zip(steps, others, strict=True)
            if j == k and not isinstance(outputs, str)
        ]
        if len(ends) == 1:
            ends.append((0.0, center))
        if not ends:
            continue  # no step in this direction, because every one would fail
        (high, after), (low, before) = ends
        derivatives[..., k] = (after - before) / (high - low)
    return center, derivatives
