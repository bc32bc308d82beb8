"""Torques over time as piecewise cubics, from samples or from a function of time.

The kernels read this form only; this module converts every input to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arguments import check_choice
from flexarm.errors import InputError, Problem, check_array
from flexarm.user_functions import FunctionError, call, first_failure

FloatArray = NDArray[np.float64]

INTERPOLATIONS = ("cubic", "linear", "hold")
#: Ratio of a second difference to both neighbours above which a sample is a kink: if the samples
#: are close enough for a cubic, curvature changes by far less.
_KINK = 10.0
#: Distance, in sample intervals, within which a break coincides with a sample.
_ON_SAMPLE = 1e-6
#: Limit on the pieces being halved at once. A few jumps keep a few pieces open, noise keeps all.
_MOST_PIECES = 50_000
#: Initial number of pieces of a function of time.
_FIRST_PIECES = 64
#: Limit on the instants of the comparison, whose calls then take a fraction of a second.
_MOST_INSTANTS = 20_000


@dataclass(frozen=True, eq=False)
class TorqueHistory:
    """Joint torques as a piecewise cubic.

    Attributes:
        breaks: (pieces + 1,) s, ascending.
        coefficients: (pieces, 4, joints): ``sum_p coefficients[k, p] (t - breaks[k])^p`` N m.
        stops: (stops,) s: times where a value or a slope jumps.
        shortest_feature: longest interval (s) between two instants at which a function of time
            was evaluated to make this history; 0 for samples and tables, which are exact.
    """

    breaks: FloatArray
    coefficients: FloatArray
    stops: FloatArray
    shortest_feature: float = 0.0

    def at(self, times: FloatArray) -> FloatArray:
        """Evaluate at times (T,): (T, joints) N m; at a break the value from the right."""
        last = len(self.breaks) - 2
        k = np.clip(np.searchsorted(self.breaks, times, side="right") - 1, 0, last)
        x = (times - self.breaks[k])[:, None]
        c = self.coefficients[k]
        values: FloatArray = c[:, 0] + x * (c[:, 1] + x * (c[:, 2] + x * c[:, 3]))
        return values

    def shifted(self, torque: FloatArray) -> TorqueHistory:
        """Add a constant torque (joints,)."""
        coefficients = self.coefficients.copy()
        coefficients[:, 0] += torque
        return replace(self, coefficients=coefficients)

    def held_to(self, time: float) -> TorqueHistory:
        """Extend the history to a time (s) by its last value, instead of its last cubic."""
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


def constant_torque(torque: FloatArray) -> TorqueHistory:
    """Return a torque (joints,) that is constant over time."""
    coefficients = np.zeros((1, 4, torque.size))
    coefficients[0, 0] = torque
    return TorqueHistory(np.array([0.0, 1.0]), coefficients, np.zeros(0))


def sampled_torque(
    values: ArrayLike,
    rate: float,
    duration: float,
    joints: int,
    interpolation: str,
    breaks: ArrayLike = (),
) -> TorqueHistory:
    """Interpolate samples (samples, joints) taken at ``rate`` (Hz) from time zero.

    Args:
        values: N m; at least duration times rate samples. After the last sample its value is
            constant to the end of the run, for every interpolation.
        interpolation: "hold" is a zero-order hold, "linear" connects the samples, and "cubic" is
            the spline with continuous curvature, split where the samples have a kink. The spline
            overshoots samples that alternate in sign.
        breaks: times (s) at which the spline is split; a split between two samples makes it linear
            there.

    Raises:
        InputError: if there are too few samples, the shape is wrong, a value is not finite, or the
            interpolation is unknown.
    """
    where = "simulate"
    check_choice(where, "torque_interpolation", interpolation, INTERPOLATIONS)
    samples = check_array(where, "torque", values, (-1, joints))
    needed = int(np.floor(duration * rate * (1 + 1e-12) + 1e-9))
    if len(samples) < max(needed, 1):
        rule = f"have at least {max(needed, 1)} samples (duration times rate)"
        raise InputError(Problem(where, "torque", rule, str(len(samples))))
    if interpolation == "hold" or len(samples) == 1:
        breaks = np.arange(len(samples) + 1) / rate
        coefficients = np.zeros((len(samples), 4, joints))
        coefficients[:, 0] = samples
        jumps = np.any(np.diff(samples, axis=0) != 0.0, axis=1)
        return TorqueHistory(breaks, coefficients, breaks[1:-1][jumps])
    times = np.arange(len(samples)) / rate
    if interpolation == "linear":
        coefficients = np.zeros((len(samples) - 1, 4, joints))
        coefficients[:, 0] = samples[:-1]
        coefficients[:, 1] = np.diff(samples, axis=0) * rate
        bends = np.any(np.diff(samples, n=2, axis=0) != 0.0, axis=1)
        history = TorqueHistory(times, coefficients, times[1:-1][bends])
    else:
        places = np.asarray(breaks, dtype=np.float64) * rate
        places = places[(places > 0.0) & (places < len(samples) - 1.0)]
        beside = np.concatenate([np.floor(places + _ON_SAMPLE), np.ceil(places - _ON_SAMPLE)])
        history = _spline(times, samples, beside.astype(np.intp))
    return history.held_to(duration)


def _spline(times: FloatArray, samples: FloatArray, parted: NDArray[np.intp]) -> TorqueHistory:
    from scipy.interpolate import CubicSpline

    kinks = np.union1d(find_kinks(samples), parted)
    edges = np.unique(np.concatenate([[0], kinks, [len(times) - 1]]))
    coefficients = np.zeros((len(times) - 1, 4, samples.shape[1]))
    for first, last in pairwise(edges):
        piece = slice(first, last + 1)
        # SciPy orders (power falling, piece, joint); not-a-knot ends need four samples.
        spline = CubicSpline(times[piece], samples[piece], bc_type="not-a-knot")
        c = np.zeros((4, last - first, samples.shape[1]))
        c[4 - len(spline.c) :] = spline.c
        coefficients[first:last] = c[::-1].transpose(1, 0, 2)
    return TorqueHistory(times, coefficients, times[edges[1:-1]])


def find_kinks(samples: FloatArray) -> NDArray[np.intp]:
    """Return the samples at which the slope jumps, because a spline across them would ring.

    At such a sample the second difference is large compared with both neighbours.
    """
    bend = np.abs(np.diff(samples, n=2, axis=0))
    if len(bend) < 3:
        return np.zeros(0, dtype=np.intp)
    floor = 1e-9 * np.max(np.abs(samples), axis=0, initial=0.0)
    beside = np.maximum(bend[:-2], bend[2:])
    stands_out = np.any(bend[1:-1] > _KINK * beside + floor, axis=1)
    return np.flatnonzero(stands_out) + 2


class Row:
    """Wrapper of a scalar function of time that returns rows of one number."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function = function
        self.vectorized = getattr(function, "vectorized", False)
        self.breaks = getattr(function, "breaks", ())

    def __call__(self, t: Any) -> FloatArray:
        return np.asarray(self._function(t))[..., None]


def function_torque(
    function: Callable[[float], ArrayLike],
    duration: float,
    joints: int,
    relative: float,
    breaks: ArrayLike = (),
    name: str = "torque",
    where: str = "simulate",
    spacing: float | None = None,
) -> TorqueHistory:
    """Approximate a function ``t -> (joints,)`` by cubics, as accurately as the run requires.

    Each piece is halved until the cubic through four of its points agrees with three more to
    ``relative`` of the largest torque. Where halving does not reach this, the function jumps or
    has a kink, and the integrator stops there. Then the function is compared with the cubics every
    ``spacing``, and approximated again around each instant at which they differ. A feature that is
    shorter than ``shortest_feature`` of the result, and away from ``breaks``, may be missed.

    Args:
        breaks: times (s) of kinks or jumps, in addition to ``function.breaks`` if it exists.
        name: name of the function, for messages.
        where: name of the calling function, for messages.
        spacing: interval (s) of the comparison, increased to limit it to 20 000 instants; None
            for no comparison.

    Raises:
        InputError: if the function does not return ``joints`` finite numbers or is rough
            everywhere, or the breaks are not a list of numbers.
    """
    follower = _Follower(function, duration, joints, relative, name, where)
    given = breaks, getattr(function, "breaks", ())
    known = np.concatenate([check_array(where, "breaks", part, (-1,)) for part in given])
    known = known[(known > 0.0) & (known < duration)]
    edges = np.union1d(np.linspace(0.0, duration, _FIRST_PIECES + 1), known)
    starts, pieces, stops = follower.follow(edges[:-1], edges[1:])
    instants = np.zeros(0)
    if spacing is not None:
        count = min(int(np.ceil(duration / spacing)), _MOST_INSTANTS)
        instants = duration * np.arange(1, count) / count
        ends = np.append(starts, duration)
        missed = follower.missed(TorqueHistory(ends, pieces, stops), instants)
        anew = np.unique(np.searchsorted(starts, missed, side="right") - 1)
        cuts = np.unique(np.concatenate([starts[anew], missed]))
        ends = ends[np.searchsorted(ends, cuts, side="right")]
        more = follower.follow(cuts, np.minimum(ends, np.append(cuts[1:], duration)))
        starts = np.concatenate([np.delete(starts, anew), more[0]])
        order = np.argsort(starts)
        pieces = np.concatenate([np.delete(pieces, anew, axis=0), more[1]])[order]
        starts, stops = starts[order], np.concatenate([stops, more[2]])
    times = np.append(starts, duration)
    stops = np.unique(np.concatenate([known, stops, _jumps(times, pieces, follower.allowed)]))
    inner = stops[(stops > 0.0) & (stops < duration)]
    points = starts[:, None] + np.diff(times)[:, None] * follower.points
    gap = float(np.max(np.diff(np.union1d(points, instants))))
    return TorqueHistory(times, pieces, inner, gap)


def _jumps(breaks: FloatArray, coefficients: FloatArray, allowed: float) -> FloatArray:
    """Return the breaks at which value or slope jump by far more than the approximation error."""
    width = np.diff(breaks)[:-1, None]
    left, right = coefficients[:-1], coefficients[1:]
    value = left[:, 0] + width * (left[:, 1] + width * (left[:, 2] + width * left[:, 3]))
    slope = left[:, 1] + width * (2.0 * left[:, 2] + 3.0 * width * left[:, 3])
    narrower = np.minimum(width, np.diff(breaks)[1:, None])
    jump = np.abs(value - right[:, 0]) > 100.0 * allowed
    bend = np.abs(slope - right[:, 1]) * narrower > 1000.0 * allowed
    return breaks[1:-1][np.any(jump | bend, axis=1)]


class _Follower:
    """Adaptive approximation of a user function by cubics, with validation of its values."""

    #: Four points that the cubic interpolates (ends shared), and three that test it.
    _NODES = np.array([0.0, 0.25, 0.75, 1.0])
    _TESTS = np.array([0.1, 0.5, 0.9])
    #: All of them, as fractions of a piece.
    points = np.union1d(_NODES, _TESTS)

    def __init__(
        self,
        function: Callable[[float], ArrayLike],
        duration: float,
        joints: int,
        relative: float,
        name: str,
        where: str,
    ) -> None:
        self._function = function
        self._where, self._name = where, name
        self._joints, self._relative = joints, relative
        self._powers = np.vander(self._TESTS, 4, increasing=True)
        # Evaluate just inside each end, because the function may jump exactly on an edge and each
        # piece needs the value of its own side.
        self._inside = 1e-12 * duration
        self._shortest = duration * 2.0**-40
        self._scale = 0.0  # largest value so far

    @property
    def allowed(self) -> float:
        """Allowed error of a cubic."""
        return self._relative * self._scale

    def follow(
        self, starts: FloatArray, ends: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Halve pieces, given by their starts and ends, until cubics approximate the function.

        Returns:
            Starts of the pieces (k,) and coefficients (k, 4, joints), in order; both ends of the
            pieces for which halving did not help.

        Raises:
            InputError: if the function is rough everywhere.
        """
        stops = [np.zeros(0)]
        kept = [(np.zeros(0), np.zeros((0, 4, self._joints)))]
        while starts.size:
            coefficients, errors = self._cubics(starts, ends)
            good = errors <= self.allowed
            hopeless = ~good & (ends - starts <= self._shortest)
            stops += [starts[hopeless], ends[hopeless]]
            done = good | hopeless
            kept.append((starts[done], coefficients[done]))
            a, b = starts[~done], ends[~done]
            if a.size > _MOST_PIECES:
                rule = "be a function of time that is smooth except for a few jumps"
                value = f"errors above the tolerance with steps of {(b - a).min():.2g} s"
                hint = "It must be deterministic: give noise as samples at a rate."
                raise InputError(Problem(self._where, self._name, rule, value, hint))
            middle = 0.5 * (a + b)
            starts, ends = np.concatenate([a, middle]), np.concatenate([middle, b])
        times = np.concatenate([start for start, _ in kept])
        order = np.argsort(times)
        pieces = np.concatenate([piece for _, piece in kept])[order]
        return times[order], pieces, np.concatenate(stops)

    def missed(self, history: TorqueHistory, times: FloatArray) -> FloatArray:
        """Return the times at which the function differs from its cubics."""
        values = self._values(times)
        self._grow(values)
        # The error between the interpolated points is larger than at them, but never by this much.
        far = np.any(np.abs(values - history.at(times)) > 100.0 * self.allowed, axis=1)
        times = times[far]
        # Within the shortest pieces there is a jump, which is already in the stops.
        piece = np.searchsorted(history.breaks, times, side="right") - 1
        return times[np.diff(history.breaks)[piece] > self._shortest]

    def _values(self, times: FloatArray) -> FloatArray:
        """Evaluate the function, with one call for all times if it is vectorized.

        Raises:
            InputError: if it does not return one number for each joint.
            FunctionError: if it raises; its time is the last one at which the function returned.
        """
        if getattr(self._function, "vectorized", False):
            try:
                all_at_once = call(self._name, self._function, times)
            except FunctionError:
                many: Any = self._function
                return self._one_by_one(times, lambda t: many(np.array([t]))[0])
            return check_array(self._where, self._name, all_at_once, (times.size, self._joints))
        return self._one_by_one(times, self._function)

    def _one_by_one(self, times: FloatArray, function: Callable[[float], Any]) -> FloatArray:
        rows = np.empty((times.size, self._joints))
        before = 0.0  # last time with a result; zero if the first call fails
        for k in np.argsort(times):
            t = float(times[k])
            try:
                row = call(self._name, function, t)
            except FunctionError as failed:
                raise first_failure(self._name, function, before, failed) from failed.__cause__
            rows[k] = check_array(self._where, f"{self._name}({t:g})", row, (self._joints,))
            before = t
        return rows

    def _grow(self, values: FloatArray) -> None:
        self._scale = max(self._scale, float(np.max(np.abs(values), initial=0.0)))

    def _cubics(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fit pieces from a (k,) to b (k,): coefficients (k, 4, joints) and errors (k,)."""
        width = (b - a)[:, None]
        inside = np.minimum(self._inside / width, 1e-3)
        nodes = np.tile(self._NODES, (a.size, 1))
        nodes[:, :1] += inside
        nodes[:, -1:] -= inside
        tests = np.tile(self._TESTS, (a.size, 1))
        times = a[:, None] + np.concatenate([nodes, tests], axis=1) * width
        values = self._values(times.ravel()).reshape(*times.shape, self._joints)
        self._grow(values)
        powers = nodes[:, :, None] ** np.arange(4.0)
        scaled = np.linalg.solve(powers, values[:, :4])
        errors = np.max(np.abs(self._powers @ scaled - values[:, 4:]), axis=(1, 2))
        return scaled / width[:, :, None] ** np.arange(4.0)[:, None], errors
