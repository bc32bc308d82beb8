"""A motion over intervals of equal length: coordinates at nodes and stages, torques.

Time is a fraction s = t / T of the duration T, so that the duration is one variable of the search
among others: rates are dq/ds, accelerations d2q/ds2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.integrate.implicit.gauss import gauss_coefficients
from flexarm.simulation.histories.piecewise import PiecewiseCubic

#: Gauss collocation with three stages in each interval, order 6.
GAUSS = gauss_coefficients(3)
STAGES = len(GAUSS.c)


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion over N intervals.

    Attributes:
        duration: T, s.
        q: (N + 1, dof) coordinates at the nodes.
        slope: (N + 1, dof) dq/ds at the nodes.
        curve: (N, 3, dof) d2q/ds2 at the stages.
        torque: (N, 2, joints) N m at the start and at the end of each interval, linear in between.
    """

    duration: float
    q: FloatArray
    slope: FloatArray
    curve: FloatArray
    torque: FloatArray

    @property
    def intervals(self) -> int:
        """Number of intervals N."""
        return len(self.curve)

    @property
    def times(self) -> FloatArray:
        """Times of the nodes (N + 1,), s."""
        return np.linspace(0.0, self.duration, self.intervals + 1)

    @property
    def rate(self) -> FloatArray:
        """Rates (N + 1, dof) at the nodes."""
        return self.slope / self.duration

    def refined(self, intervals: int, continuous: bool) -> Plan:
        """Return the same motion over other intervals, by the polynomials of the collocation.

        Args:
            continuous: whether the torque is continuous; else it is constant in each interval.
        """
        nodes = np.linspace(0.0, 1.0, intervals + 1)
        stages = (nodes[:-1, None] + GAUSS.c / intervals).ravel()
        q, slope, _ = self._at(nodes)
        curve = self._at(stages)[2].reshape(intervals, STAGES, -1)
        if continuous:
            known = np.concatenate([self.torque[:, 0], self.torque[-1:, 1]])
            ends = np.array([np.interp(nodes, self.times / self.duration, u) for u in known.T]).T
            torque = np.stack([ends[:-1], ends[1:]], axis=1)
        else:
            middle = 0.5 * (nodes[1:] + nodes[:-1])
            torque = self.torque[(middle * self.intervals).astype(int)]
        return Plan(self.duration, q, slope, curve, torque)

    def _at(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, dq/ds and d2q/ds2 at fractions s (k,) of the duration, each (k, dof)."""
        h, powers = 1.0 / self.intervals, np.arange(STAGES)
        piece = np.minimum((s * self.intervals).astype(int), self.intervals - 1)
        x = (s * self.intervals - piece)[:, None]
        # Coefficients of the polynomials through the stages, by powers of x.
        c = np.linalg.inv(GAUSS.c[:, None] ** powers) @ self.curve[piece]
        once = x ** (powers + 1) / (powers + 1)
        twice = x ** (powers + 2) / ((powers + 1) * (powers + 2))
        parts = (np.einsum("kp,kpd->kd", basis, c) for basis in (x**powers, once, twice))
        curve, slope, q = parts
        first = self.slope[piece]
        return self.q[piece] + h * x * first + h * h * q, first + h * slope, curve

    def torque_history(self, before: FloatArray, after: FloatArray) -> PiecewiseCubic:
        """Return the torques over time, with constant ones (joints,) before and after, N m."""
        times, (first, last) = self.times, self.torque.swapaxes(0, 1)
        coefficients = np.zeros((self.intervals + 2, 4, first.shape[1]))
        coefficients[[0, -1], 0] = before, after
        coefficients[1:-1, 0] = first
        coefficients[1:-1, 1] = (last - first) / np.diff(times)[:, None]
        breaks = np.concatenate([[-self.duration], times, [2.0 * self.duration]])
        return PiecewiseCubic(breaks, coefficients, times[1:])
