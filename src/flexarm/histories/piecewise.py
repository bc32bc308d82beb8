"""Piecewise cubics over time: exact conversion of tables, and combination of columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexarm.histories.torques import FloatArray, TorqueHistory
from flexarm.model import AccelerationTable, FactorTable


def linear_history(times: FloatArray, values: FloatArray) -> TorqueHistory:
    """Interpolate a table linearly, with the first and the last value constant beyond its ends.

    The representation is exact, with stops at every kink and jump.

    Args:
        times: (k,) s, ascending; two equal times are a jump.
        values: (k, columns).
    """
    ends = min(times[0], 0.0) - 1.0, times[-1] + abs(times[-1]) + 1.0
    edges = np.concatenate([ends[:1], times, ends[1:]])
    heights = np.concatenate([values[:1], values, values[-1:]])
    width = np.diff(edges)
    real = width > 0.0
    coefficients = np.zeros((np.count_nonzero(real), 4, values.shape[1]))
    coefficients[:, 0] = heights[:-1][real]
    coefficients[:, 1] = np.diff(heights, axis=0)[real] / width[real, None]
    bends = np.any(np.diff(coefficients[:, 1], axis=0) != 0.0, axis=1)
    jumps = np.any(np.diff(heights, axis=0) != 0.0, axis=1) & ~real
    stops = np.concatenate([edges[:-1][real][1:][bends], edges[:-1][jumps]])
    return TorqueHistory(np.append(edges[:-1][real], edges[-1]), coefficients, np.unique(stops))


def table_history(table: FactorTable | AccelerationTable) -> TorqueHistory:
    """Interpolate a table linearly; the history has one column, or two for an acceleration."""
    times = np.array(table.times)
    return linear_history(times, np.array(table.values).reshape(times.size, -1))


def side_by_side(histories: Sequence[TorqueHistory]) -> TorqueHistory:
    """Join the columns of histories, after splitting all pieces at the breaks of all histories."""
    breaks = np.unique(np.concatenate([history.breaks for history in histories]))
    coefficients = np.concatenate([cut(history, breaks) for history in histories], axis=2)
    stops = np.unique(np.concatenate([history.stops for history in histories]))
    shortest = max(history.shortest_feature for history in histories)
    return TorqueHistory(breaks, coefficients, stops, shortest)


def cut(history: TorqueHistory, breaks: FloatArray) -> FloatArray:
    """Return coefficients (pieces, 4, columns) of the same function over finer pieces."""
    last = len(history.breaks) - 2
    starts = breaks[:-1]
    k = np.clip(np.searchsorted(history.breaks, starts, side="right") - 1, 0, last)
    x = (starts - history.breaks[k])[:, None]
    c0, c1, c2, c3 = (history.coefficients[k, p] for p in range(4))
    shifted = [
        c0 + x * (c1 + x * (c2 + x * c3)),
        c1 + x * (2.0 * c2 + 3.0 * x * c3),
        c2 + 3.0 * x * c3,
        c3,
    ]
    return np.stack(shifted, axis=1)
