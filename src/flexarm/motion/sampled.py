"""Motions tabulated as piecewise polynomials, for fast evaluation in control loops."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from flexarm.base.arguments import check_number, check_times
from flexarm.base.errors import public_call
from flexarm.motion.motion import DerivedMotion, JointState, Motion

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from scipy.interpolate import PPoly

    Floats = NDArray[np.float64]

#: Largest number of samples of a table: for two joints it takes 100 MB.
_MOST_SAMPLES = 10**6
#: Fractions of an interval at which the error of the table is largest: for the acceleration the
#: first and the last, for the rate the second, for the angle the middle.
_TESTS = np.array([0.14, 0.28, 0.5, 0.86])


class TabulatedMotion(Motion):
    """A motion whose joint angles are piecewise polynomials of time.

    A subclass sets the table, whose first and last polynomial are constants, for the rest before
    and after the motion.
    """

    _table: PPoly

    @public_call
    def joint_angle(self, t: ArrayLike) -> Floats:
        """Return the relative joint angles (n,) or (T, n), rad."""
        return self._derivative(check_times("t", t), 0)

    @public_call
    def joint_rate(self, t: ArrayLike) -> Floats:
        """Return the joint rates (n,) or (T, n), rad/s."""
        return self._derivative(check_times("t", t), 1)

    @public_call
    def joint_acceleration(self, t: ArrayLike) -> Floats:
        """Return the joint accelerations (n,) or (T, n), rad/s^2."""
        return self._derivative(check_times("t", t), 2)

    @public_call
    def at(self, times: Floats) -> JointState:
        """See `Motion.at`."""
        checked = check_times("times", times)
        return JointState(*(self._derivative(checked, order) for order in range(3)))

    def _derivative(self, times: Floats, order: int) -> Floats:
        ends = self._table.x[0], self._table.x[-1]
        found: Floats = self._table(np.minimum(np.maximum(times, ends[0]), ends[1]), order)
        return found


@dataclass(frozen=True, eq=False)
class SampledMotion(TabulatedMotion, DerivedMotion):
    """A motion tabulated at a constant rate, with polynomials of degree 5 between the samples.

    At the samples angles, rates and accelerations are those of the original. In between, rates and
    accelerations are the derivatives of the tabulated angles. The breaks, and the rest before and
    after the motion, are preserved. ``tip`` is that of the original.

    Attributes:
        rate: samples per second, Hz.
        error: largest differences from the original, at four instants between neighbouring samples:
            angle (rad), rate (rad/s) and acceleration (rad/s^2) of each joint, (n,) each.
    """

    rate: float
    error: JointState
    _table: PPoly = field(repr=False)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Breaks of the original, s."""
        return self.motion.breaks

    @property
    def end_time(self) -> float:
        """End of the motion, s; the arm is at rest from then on."""
        return self.motion.end_time

    def tip(self, t: ArrayLike) -> Floats:
        """Return the tip (2,) or (T, 2) of the original, world axes, m, without tabulation."""
        return self.motion.tip(t)


def sampled_motion(motion: Motion, rate: float) -> SampledMotion:
    """Tabulate a motion at a constant rate (Hz); see ``Motion.sampled``.

    Raises:
        InputError: if the rate is not positive, or would require more than a million samples.
    """
    most = _MOST_SAMPLES / motion.duration
    rule = f"be greater than 0 and at most {most:.6g} for a motion of {motion.duration:.6g} s"
    frequency = check_number("rate", rate, lambda hertz: 0.0 < hertz <= most, rule)
    pieces = [_nodes(a, b, frequency) for a, b in pairwise(motion.breaks)]
    starts = np.concatenate([nodes[:-1] for nodes in pieces])
    ends = np.concatenate([nodes[1:] for nodes in pieces])
    # At a break the acceleration has the value after the jump; evaluate just before it instead.
    before = [np.append(nodes[1:-1], np.nextafter(nodes[-1], -np.inf)) for nodes in pieces]
    rests = motion.joint_angle([motion.start_time - 1.0, motion.end_time])
    states = motion.state(starts), motion.state(np.concatenate(before))
    table = quintic_table(np.append(starts, ends[-1]), *states, rests)
    times = (starts[:, None] + (ends - starts)[:, None] * _TESTS).reshape(-1)
    exact = motion.state(times)
    error = (np.abs(table(times, order) - part).max(axis=0) for order, part in enumerate(exact))
    return SampledMotion(motion, frequency, JointState(*error), table)


def _nodes(start: float, end: float, rate: float) -> Floats:
    """Return evenly spaced times from start to end, at least as close as the rate requires."""
    count = max(int(np.ceil((end - start) * rate * (1.0 - 1e-9))), 1)
    return np.linspace(start, end, count + 1)


def quintic_table(edges: Floats, first: JointState, last: JointState, rests: Floats) -> PPoly:
    """Return polynomials of degree 5 between rest before and rest after a motion.

    Args:
        edges: (k + 1,) s.
        first, last: (k, n) at the start and at the end of each interval.
        rests: (2, n) rad, angles before and after the motion.
    """
    from scipy.interpolate import PPoly

    constant = np.zeros((2, 6, rests.shape[1]))
    constant[:, 5] = rests
    inner = _quintic(first, last, np.diff(edges))
    coefficients = np.concatenate([constant[:1], inner, constant[1:]]).transpose(1, 0, 2)
    ends = np.concatenate([[edges[0] - 1.0], edges, [edges[-1] + 1.0]])
    return PPoly(np.ascontiguousarray(coefficients), ends)


def _quintic(first: JointState, last: JointState, width: Floats) -> Floats:
    """Return Hermite polynomials: coefficients (k, 6, n), falling powers of time since the start.

    Args:
        first, last: (k, n) at the start and at the end of each interval.
        width: (k,) s.
    """
    h = width[:, None]
    q, v, a = first.angle, h * first.rate, 0.5 * h**2 * first.acceleration
    # Values at the end minus those of the parabola given by the start.
    angle = last.angle - (q + v + a)
    rate = h * last.rate - (v + 2.0 * a)
    bend = 0.5 * h**2 * last.acceleration - a
    rows = [
        (6.0 * angle - 3.0 * rate + bend) / h**5,
        (-15.0 * angle + 7.0 * rate - 2.0 * bend) / h**4,
        (10.0 * angle - 4.0 * rate + bend) / h**3,
        0.5 * first.acceleration,
        first.rate,
        q,
    ]
    return np.stack(rows, axis=1)
