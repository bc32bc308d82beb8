"""Functions of time as splines between the breaks of a motion, as fine as the function needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import SimulationError
from flexarm.base.late import interpolate

#: Limits of the number of intervals between two breaks, and number of values computed in one batch.
_FEWEST, _MOST, _BATCH = 64, 65536, 1024
#: Error of a table before the last halving, relative to the largest value, or to a value of
#: ``_LITTLE`` units if that is larger: smaller ones have rounding errors of this size.
_MISSED, _LITTLE = 1e-8, 1e-5


def tabulated(
    breaks: Sequence[float], values: Callable[[FloatArray], FloatArray], sizes: FloatArray
) -> list[interpolate.BSpline]:
    """Return splines of values (T, k) at times, constant before the first and after the last break.

    Between two breaks, intervals are halved until the spline of the longer ones errs by less than
    ``_MISSED`` at the new instants; the error of the result is a sixtieth of it. ``sizes`` (k,) are
    the units in which the values are compared.
    """

    def computed(times: FloatArray) -> FloatArray:
        parts = range(0, len(times), _BATCH)
        return np.concatenate([values(times[k : k + _BATCH]) for k in parts])

    pieces, span = [], breaks[-1] - breaks[0]
    for a, b in pairwise(breaks):
        count, missed = _FEWEST, np.inf
        known = computed(_instants(a, b, count))
        while missed > _MISSED:
            coarse = interpolate.make_interp_spline(_instants(a, b, count), known, k=5)
            count, known = 2 * count, np.repeat(known, 2, axis=0)[:-1]
            if count > _MOST:
                reason = "the motion that begins here is too long and fast for a table."
                raise SimulationError(a, reason, "Divide it, or move more slowly.")
            times = _instants(a, b, count)
            known[1::2] = computed(times[1::2])
            largest = np.abs(known / sizes).max()
            error = np.abs((known[1::2] - coarse(times[1::2])) / sizes).max()
            missed = float(error / max(largest, _LITTLE))
        pieces.append(interpolate.make_interp_spline(times, known, k=5))
    ends = (np.array([t]) for t in (breaks[0] - span, breaks[-1] + span))
    before, after = (interpolate.BSpline(np.append(t, t + 1.0), values(t), 0) for t in ends)
    return [before, *pieces, after]


def _instants(a: float, b: float, count: int) -> FloatArray:
    """Return ends of ``count`` intervals from a to just before b, those of fewer among them."""
    # Chebyshev-Lobatto spacing is dense at the ends, where the bending changes abruptly.
    times = a + (b - a) * 0.5 * (1.0 - np.cos(np.pi * np.arange(count + 1) / count))
    times[0], times[-1] = a, np.nextafter(b, -np.inf)
    return times


def evaluated(
    splines: Sequence[interpolate.BSpline], breaks: FloatArray, times: FloatArray
) -> FloatArray:
    """Return values (*times.shape, k) of splines of `tabulated`; at a break those after it."""
    inside = np.clip(times, breaks[0], breaks[-1])
    piece = np.searchsorted(breaks, times, side="right")
    values = np.empty((*times.shape, splines[0].c.shape[-1]))
    for k in np.unique(piece):
        values[piece == k] = splines[k](inside[piece == k])
    return values
