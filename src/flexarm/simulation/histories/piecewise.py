"""Piecewise cubics over time: torques, load factors, base and prescribed accelerations.

The kernels read this form only; `samples` and `functions` convert the other inputs to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PiecewiseCubic:
    """Columns of numbers as cubics of time between breaks.

    Attributes:
        breaks: (pieces + 1,) s, ascending.
        coefficients: (pieces, 4, columns): the value is
            ``sum_p coefficients[k, p] (t - breaks[k])^p``.
        stops: (stops,) s: times after 0, the start of runs, where a value or a slope jumps.
        shortest_feature: longest interval (s) between two instants at which a function of time
            was evaluated to create this object; 0 for samples and tables, which are exact.
    """

    breaks: FloatArray
    coefficients: FloatArray
    stops: FloatArray
    shortest_feature: float = 0.0

    @classmethod
    def constant(cls, values: FloatArray) -> PiecewiseCubic:
        """Return values (columns,) that are constant over time."""
        coefficients = np.zeros((1, 4, values.size))
        coefficients[0, 0] = values
        return cls(np.array([0.0, 1.0]), coefficients, np.zeros(0))

    @classmethod
    def table(cls, times: FloatArray, values: FloatArray) -> PiecewiseCubic:
        """Interpolate a table linearly, with the first and the last value constant beyond its ends.

        The representation is exact, with stops at every kink and jump.

        Args:
            times: (k,) s, ascending; two equal times are a jump.
            values: (k, columns).
        """
        ends = min(times[0], 0.0) - 1.0, times[-1] + abs(times[-1]) + 1.0
        edges = np.concatenate([ends[:1], times, ends[1:]])
        heights = np.concatenate([values[:1], values, values[-1:]])
        width, rise = np.diff(edges)[:, None], np.diff(heights, axis=0)
        real = width[:, 0] > 0.0
        slopes = rise[real] / width[real]
        # Slopes of one straight line differ by the rounding of its times and values.
        size = np.abs(slopes * edges[1:][real, None]) + np.abs(heights[1:][real])
        rounding = 4.0 * np.finfo(float).eps * size / width[real]
        bends = np.any(np.abs(np.diff(slopes, axis=0)) > rounding[:-1] + rounding[1:], axis=1)
        jumps = np.any(rise != 0.0, axis=1) & ~real
        starts = edges[:-1]
        coefficients = np.zeros((len(slopes), 4, values.shape[1]))
        coefficients[:, 0], coefficients[:, 1] = heights[:-1][real], slopes
        stops = np.unique(np.concatenate([starts[real][1:][bends], starts[jumps]]))
        return cls(np.append(starts[real], edges[-1]), coefficients, stops[stops > 0.0])

    @classmethod
    def joined(cls, parts: Sequence[PiecewiseCubic]) -> PiecewiseCubic:
        """Join the columns of all parts, after splitting their pieces at the breaks of all."""
        breaks = np.unique(np.concatenate([part.breaks for part in parts]))
        coefficients = np.concatenate([part._split(breaks) for part in parts], axis=2)
        stops = np.unique(np.concatenate([part.stops for part in parts]))
        shortest = max(part.shortest_feature for part in parts)
        return cls(breaks, coefficients, stops, shortest)

    def at(self, times: FloatArray) -> FloatArray:
        """Evaluate at times (T,): (T, columns); at a break the value from the right."""
        c, x = self._pieces_at(times)
        values: FloatArray = c[:, 0] + x * (c[:, 1] + x * (c[:, 2] + x * c[:, 3]))
        return values

    def rates_at(self, times: FloatArray) -> FloatArray:
        """Evaluate the derivative at times (T,): (T, columns), 1/s; at a break from the right."""
        c, x = self._pieces_at(times)
        return np.asarray(c[:, 1] + x * (2.0 * c[:, 2] + 3.0 * x * c[:, 3]))

    def means(self, edges: FloatArray) -> FloatArray:
        """Return the means (intervals, columns) between ascending times (intervals + 1,)."""
        from scipy.interpolate import PPoly

        own = self.held_to(float(edges[-1]))
        integral = PPoly(own.coefficients[:, ::-1].swapaxes(0, 1), own.breaks).antiderivative()
        return np.asarray(np.diff(integral(edges), axis=0) / np.diff(edges)[:, None])

    def shifted(self, values: FloatArray) -> PiecewiseCubic:
        """Add constant values (columns,)."""
        coefficients = self.coefficients.copy()
        coefficients[:, 0] += values
        return replace(self, coefficients=coefficients)

    def scaled(self, factors: FloatArray) -> PiecewiseCubic:
        """Multiply by constant factors (columns,)."""
        return replace(self, coefficients=self.coefficients * factors)

    def with_column(self, index: int, column: PiecewiseCubic) -> PiecewiseCubic:
        """Replace one column by the only column of another piecewise cubic."""
        joined = PiecewiseCubic.joined([self, column])
        order = np.arange(self.coefficients.shape[2])
        order[index] = order.size
        return replace(joined, coefficients=joined.coefficients.take(order, axis=2))

    def held_to(self, time: float) -> PiecewiseCubic:
        """Extend the last value, instead of the last cubic, to a time (s)."""
        end = self.breaks[-1]
        # A constant last piece needs no extension.
        if time <= end or not np.any(self.coefficients[-1, 1:]):
            return self
        held = np.zeros((1, *self.coefficients.shape[1:]))
        powers = (end - self.breaks[-2]) ** np.arange(4.0)
        held[0, 0] = powers @ self.coefficients[-1]
        return replace(
            self,
            breaks=np.append(self.breaks, time),
            coefficients=np.concatenate([self.coefficients, held]),
            stops=np.append(self.stops, end),
        )

    def _pieces_at(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the coefficients (T, 4, columns) at times (T,), and the times (T, 1) in them."""
        last = len(self.breaks) - 2
        k = np.clip(np.searchsorted(self.breaks, times, side="right") - 1, 0, last)
        return self.coefficients[k], (times - self.breaks[k])[:, None]

    def _split(self, breaks: FloatArray) -> FloatArray:
        """Return coefficients (pieces, 4, columns) of the same function over finer pieces."""
        c, x = self._pieces_at(breaks[:-1])
        c0, c1, c2, c3 = c.swapaxes(0, 1)
        shifted = [
            c0 + x * (c1 + x * (c2 + x * c3)),
            c1 + x * (2.0 * c2 + 3.0 * x * c3),
            c2 + 3.0 * x * c3,
            c3,
        ]
        return np.stack(shifted, axis=1)
