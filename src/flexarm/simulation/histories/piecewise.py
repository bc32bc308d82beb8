"""Piecewise cubics over time: torques, load factors, base and prescribed accelerations.

The kernels read this form only. Torque samples become zero-order holds, lines or splines; functions
of time are approximated as accurately as a run requires."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.base.arguments import check_choice
from flexarm.base.errors import InputError, Problem, check_array
from flexarm.base.late import interpolate, linalg
from flexarm.base.user_functions import FunctionError, call, call_many, first_failure

#: Allowed error of the cubics, as a fraction of the integrator's tolerance, and its lower limit.
_SHARE, _LEAST = 1e-2, 1e-12
#: Maximum number of pieces that are halved at once: a few for a function with a few jumps, all of
#: them for noise. More are for a fast vibration: halving divides the errors of cubics of a smooth
#: function by 16, and those of noise by one.
_MOST_PIECES, _MOST_OF_SMOOTH, _CONVERGING = 50_000, 150_000, 0.5
#: Initial number of pieces of a function of time.
_FIRST_PIECES = 64
#: Slope over the largest one below which a function rests; share of the time in which one acts that
#: rests otherwise; times at which steps end then; and the shortest piece that is no jump, relative.
_STILL, _PULSE, _STOPS, _JUMP = 0.05, 0.1, 9, 1e-9
#: Least difference of cubic terms, at the ends of their pieces and over the largest value, that is
#: rough, over the relative tolerance. At the default, 1e-7, it is that of noise of 1e-5 of this
#: value, or of a sine at 35 samples a period. Least such value, over that of all columns.
_ROUGH, _FAINT = 3e2, 1e-6
#: Types of rows that can be checked together.
_PLAIN = {tuple, list, np.ndarray}
#: Maximum number of instants of the comparison, so that it takes a fraction of a second.
_MOST_INSTANTS = 20_000


class Row:
    """Wrapper of a scalar function of time that returns rows of one number."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function = function
        self.vectorized = getattr(function, "vectorized", False)
        self.breaks = getattr(function, "breaks", ())

    def __call__(self, t: Any) -> FloatArray:
        return np.asarray(self._function(t))[..., None]


def function_history(
    function: Callable[[float], ArrayLike],
    duration: float,
    columns: int,
    relative: float,
    breaks: ArrayLike = (),
    name: str = "torque",
    spacing: float | None = None,
) -> PiecewiseCubic:
    """Approximate a function ``t -> (columns,)`` by cubics, as accurately as the run requires.

    Each piece is halved until the cubic through four of its points agrees with three more to a
    hundredth of ``relative`` times the largest value. Where halving does not reach this, the
    function jumps or has a kink, and the integrator stops there. Then the function is compared with
    the cubics every ``spacing``, and approximated again around each instant at which they differ. A
    feature that is shorter than ``shortest_feature`` of the result, and away from ``breaks``, may
    be missed.
    """
    allowed = max(relative * _SHARE, _LEAST)
    follower = _Follower(function, duration, columns, allowed, name)
    given = breaks, getattr(function, "breaks", ())
    known = np.concatenate([check_array("breaks", part, (-1,)) for part in given])
    known = known[(known > 0.0) & (known < duration)]
    edges = np.union1d(np.linspace(0.0, duration, _FIRST_PIECES + 1), known)
    starts, pieces, stops = follower.follow(edges[:-1], edges[1:])
    instants = np.zeros(0)
    if spacing is not None:
        count = min(int(np.ceil(duration / spacing)), _MOST_INSTANTS)
        instants = duration * np.arange(1, count) / count
        ends = np.append(starts, duration)
        missed = follower.missed(PiecewiseCubic(ends, pieces, stops), instants)
        anew = np.unique(np.searchsorted(starts, missed, side="right") - 1)
        cuts = np.unique(np.concatenate([starts[anew], missed]))
        ends = ends[np.searchsorted(ends, cuts, side="right")]
        more = follower.follow(cuts, np.minimum(ends, np.append(cuts[1:], duration)))
        starts = np.concatenate([np.delete(starts, anew), more[0]])
        order = np.argsort(starts)
        pieces = np.concatenate([np.delete(pieces, anew, axis=0), more[1]])[order]
        starts, stops = starts[order], np.concatenate([stops, more[2]])
    times = np.append(starts, duration)
    width = np.diff(times)[:-1, None]
    left, right = pieces[:-1], pieces[1:]
    value = left[:, 0] + width * (left[:, 1] + width * (left[:, 2] + width * left[:, 3]))
    slope = left[:, 1] + width * (2.0 * left[:, 2] + 3.0 * width * left[:, 3])
    narrower = np.minimum(width, np.diff(times)[1:, None])
    jump = np.abs(value - right[:, 0]) > 100.0 * follower.allowed
    bend = np.abs(slope - right[:, 1]) * narrower > 1000.0 * follower.allowed
    stops = np.unique(np.concatenate([known, stops, times[1:-1][np.any(jump | bend, axis=1)]]))
    stops = np.union1d(stops, pulses(times, pieces))
    inner = stops[(stops > 0.0) & (stops < duration)]
    points = starts[:, None] + np.diff(times)[:, None] * follower.points
    gap = float(np.max(np.diff(np.union1d(points, instants))))
    return PiecewiseCubic(times, pieces, inner, gap)


class _Follower:
    """Adaptive approximation of a user function by cubics, with validation of its values."""

    #: Four points that the cubic interpolates (ends shared), and three that test it.
    _NODES = np.array([0.0, 0.25, 0.75, 1.0])
    _TESTS = np.array([0.1, 0.5, 0.9])
    #: All seven points, as fractions of a piece.
    points = np.union1d(_NODES, _TESTS)

    def __init__(
        self,
        function: Callable[[float], ArrayLike],
        duration: float,
        columns: int,
        relative: float,
        name: str,
    ) -> None:
        self._function, self._name = function, name
        self._columns, self._relative = columns, relative
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
            Starts of the pieces (k,) and coefficients (k, 4, columns), in order; both ends of the
            pieces for which halving did not help.
        """
        stops = [np.zeros(0)]
        kept = [(np.zeros(0), np.zeros((0, 4, self._columns)))]
        before = np.full(starts.size, np.inf)  # errors of the pieces that were halved
        while starts.size:
            coefficients, errors = self._cubics(starts, ends)
            good = errors <= self.allowed
            hopeless = ~good & (ends - starts <= self._shortest)
            stops += [starts[hopeless], ends[hopeless]]
            done = good | hopeless
            kept.append((starts[done], coefficients[done]))
            a, b = starts[~done], ends[~done]
            if a.size > _MOST_PIECES:
                converging = float(np.median((errors / before)[~good])) < _CONVERGING
                self._check_count(a.size, float((b - a).min()), converging)
            before = np.tile(errors[~done], 2)
            middle = 0.5 * (a + b)
            starts, ends = np.concatenate([a, middle]), np.concatenate([middle, b])
        times = np.concatenate([start for start, _ in kept])
        order = np.argsort(times)
        pieces = np.concatenate([piece for _, piece in kept])[order]
        return times[order], pieces, np.concatenate(stops)

    def _check_count(self, count: int, shortest: float, converging: bool) -> None:
        """Raise if ``count`` pieces, the shortest of this length (s), are not to be halved."""
        if not converging:
            rule = "be a function of time that is smooth except for a few jumps"
            value = f"errors above the tolerance with steps of {shortest:.2g} s"
            hint = "It must be deterministic: give noise as samples at a rate."
        elif count > _MOST_OF_SMOOTH:
            rule = "vary less over the run"
            value = f"a function that requires more than {count} cubics at the tolerance"
            hint = "Shorten the run, increase rtol, or give samples at a rate."
        else:
            return
        raise InputError(Problem(self._name, rule, value, hint))

    def missed(self, history: PiecewiseCubic, times: FloatArray) -> FloatArray:
        """Return the times at which the function differs from its cubics."""
        values = self._values(times)
        self._grow(values)
        # Between the tested points the error may be larger than at them, but never by this factor.
        far = np.any(np.abs(values - history.at(times)) > 100.0 * self.allowed, axis=1)
        times = times[far]
        # The shortest pieces contain a jump, which is already among the stops.
        piece = np.searchsorted(history.breaks, times, side="right") - 1
        return times[np.diff(history.breaks)[piece] > self._shortest]

    def _values(self, times: FloatArray) -> FloatArray:
        """Evaluate the function, with one call for all times if it is vectorized."""
        if getattr(self._function, "vectorized", False):
            try:
                all_at_once = call(self._name, self._function, times)
            except FunctionError:
                many: Any = self._function
                return self._one_by_one(times, lambda t: many(np.array([t]))[0])
            return check_array(self._name, all_at_once, (times.size, self._columns))
        return self._one_by_one(times, self._function)

    def _one_by_one(self, times: FloatArray, function: Callable[[float], Any]) -> FloatArray:
        order = np.argsort(times)
        in_order = times[order].tolist()
        rows: list[Any] = []
        try:
            call_many(self._name, function, in_order, rows)
        except FunctionError as failed:
            self._rows(in_order, rows)  # a wrong value before the failure is reported first
            before = in_order[len(rows) - 1] if rows else 0.0
            raise first_failure(self._name, function, before, failed) from failed.__cause__
        values = np.empty((times.size, self._columns))
        values[order] = self._rows(in_order, rows)
        return values

    def _rows(self, times: list[float], rows: list[Any]) -> FloatArray:
        """Return the function's values at `times`, checked together where that is safe.

        One check for all rows saves most of the time of a short run. NumPy would convert rows of
        other types, such as masked arrays, without an error, so they are checked one by one.
        """
        if set(map(type, rows)) <= _PLAIN:
            try:
                return check_array(self._name, rows, (len(rows), self._columns))
            except InputError:
                pass  # find the first wrong row
        checked = [
            check_array(f"{self._name}({t:g})", row, (self._columns,))
            for t, row in zip(times, rows, strict=False)
        ]
        return np.reshape(checked, (len(rows), self._columns))

    def _grow(self, values: FloatArray) -> None:
        self._scale = max(self._scale, float(np.max(np.abs(values), initial=0.0)))

    def _cubics(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fit pieces from a (k,) to b (k,): coefficients (k, 4, columns) and errors (k,)."""
        width = (b - a)[:, None]
        inside = np.minimum(self._inside / width, 1e-3)
        nodes = np.tile(self._NODES, (a.size, 1))
        nodes[:, :1] += inside
        nodes[:, -1:] -= inside
        tests = np.tile(self._TESTS, (a.size, 1))
        times = a[:, None] + np.concatenate([nodes, tests], axis=1) * width
        values = self._values(times.ravel()).reshape(*times.shape, self._columns)
        self._grow(values)
        powers = nodes[:, :, None] ** np.arange(4.0)
        scaled = np.linalg.solve(powers, values[:, :4])
        errors = np.max(np.abs(self._powers @ scaled - values[:, 4:]), axis=(1, 2))
        return scaled / width[:, :, None] ** np.arange(4.0)[:, None], errors


INTERPOLATIONS = ("cubic", "linear", "hold")
#: Ratio of a second difference to both neighbours above which a sample is a kink: if the samples
#: are close enough for a cubic, curvature changes by far less.
_KINK = 10.0
#: Distance, in sample intervals, within which a break coincides with a sample.
_ON_SAMPLE = 1e-6


def sampled_torque(
    values: ArrayLike,
    rate: float,
    duration: float,
    joints: int,
    interpolation: str,
    breaks: ArrayLike = (),
) -> PiecewiseCubic:
    """Interpolate samples (samples, joints) taken at ``rate`` (Hz) from time zero."""
    check_choice("torque_interpolation", interpolation, INTERPOLATIONS)
    samples = check_array("torque", values, (-1, joints))
    needed = int(np.floor(duration * rate * (1 + 1e-12) + 1e-9))
    if len(samples) < max(needed, 1):
        rule = f"have at least {max(needed, 1)} samples (duration times rate)"
        raise InputError(Problem("torque", rule, str(len(samples))))
    times = np.arange(len(samples)) / rate
    if interpolation == "hold":  # each sample twice: at its time, and at that of the next sample
        return PiecewiseCubic.table(np.repeat(times, 2)[1:], np.repeat(samples, 2, axis=0)[:-1])
    if interpolation == "linear" or len(samples) == 1:
        return PiecewiseCubic.table(times, samples)
    edges = spline_edges(samples, rate, breaks)
    cubics = _cubics(times, samples, edges)
    stops = np.union1d(times[edges[1:-1]], pulses(times, cubics))
    return PiecewiseCubic(times, cubics, stops).held_to(duration)


def spline_edges(samples: FloatArray, rate: float, breaks: ArrayLike = ()) -> list[int]:
    """Return the first sample, those at kinks and beside breaks, and the last one."""
    last = len(samples) - 1
    places = np.asarray(breaks, dtype=np.float64) * rate
    places = places[(places > 0.0) & (places < last)]
    beside = np.concatenate([np.floor(places + _ON_SAMPLE), np.ceil(places - _ON_SAMPLE)])
    kinks = np.union1d(find_kinks(samples), beside.astype(np.intp))
    return [0, *kinks[(kinks > 0) & (kinks < last)].tolist(), last]


class Samples(NamedTuple):
    """Torque samples of a run, and the derivatives of the coefficients of `sampled_torque`."""

    history: PiecewiseCubic
    shape: tuple[int, int]  # (samples, joints)
    rate: float  # Hz
    interpolation: str
    edges: list[int]  # of splines, which stay where they are

    def added(self, units: FloatArray) -> FloatArray:
        """Return the derivatives (pieces, 4, columns) by changes (samples, columns)."""
        times = np.arange(len(units)) / self.rate
        if self.interpolation == "hold":
            at_jumps = np.repeat(times, 2)[1:], np.repeat(units, 2, axis=0)[:-1]
            return PiecewiseCubic.table(*at_jumps).coefficients
        if self.interpolation == "linear" or len(times) == 1:
            return PiecewiseCubic.table(times, units).coefficients
        coefficients = _cubics(times, units, self.edges)
        if len(self.history.coefficients) > len(coefficients):  # constant after the last sample
            end = np.zeros((1, 4, units.shape[1]))
            end[0, 0] = units[-1]
            coefficients = np.concatenate([coefficients, end])
        return coefficients

    def collected(self, pieces: FloatArray) -> FloatArray:
        """Return the gradient (samples, joints) from that by coefficients (pieces, k, joints).

        This is the transpose of ``added``; k is 1 for "hold", 2 for "linear", 4 for "cubic".
        """
        history, rate, count = self.history, self.rate, self.shape[0]
        gradient = np.zeros((count, pieces.shape[2]))
        if self.interpolation == "cubic" and count > 1:
            for first, last in pairwise(self.edges):
                gradient[first : last + 1] += _collected_spline(pieces[first:last], rate)
            gradient[-1] += pieces[count - 1 :, 0].sum(axis=0)  # constant after the last sample
            return gradient
        starts = np.clip(np.rint(history.breaks[:-1] * rate).astype(np.intp), 0, count - 1)
        np.add.at(gradient, starts, pieces[:, 0])
        if self.interpolation == "linear" and count > 1:
            inside = (history.breaks[:-1] >= 0.0) & (starts < count - 1)
            slopes = rate * pieces[inside, 1]
            np.add.at(gradient, starts[inside], -slopes)
            np.add.at(gradient, starts[inside] + 1, slopes)
        return gradient


def _cubics(times: FloatArray, samples: FloatArray, edges: Sequence[int]) -> FloatArray:
    """Return the coefficients of splines between ``edges``, which are samples."""
    coefficients = np.zeros((len(times) - 1, 4, samples.shape[1]))
    for first, last in pairwise(edges):
        piece = slice(first, last + 1)
        # SciPy orders (power falling, piece, joint); not-a-knot ends need four samples.
        spline = interpolate.CubicSpline(times[piece], samples[piece], bc_type="not-a-knot")
        c = np.zeros((4, last - first, samples.shape[1]))
        c[4 - len(spline.c) :] = spline.c
        coefficients[first:last] = c[::-1].transpose(1, 0, 2)
    return coefficients


def _collected_spline(pieces: FloatArray, rate: float) -> FloatArray:
    """Return the gradient (k + 1, joints) by the samples of a spline; the transpose of ``_cubics``.

    The coefficients follow from the slopes at the samples and those of the chords. The former
    satisfy the tridiagonal system of SciPy's ``CubicSpline``, here for equal distances.
    """
    count = len(pieces)
    if count < 3:  # a parabola or a line
        units = _cubics(np.arange(count + 1) / rate, np.eye(count + 1), [0, count])
        return np.asarray(np.tensordot(units, pieces, axes=([0, 1], [0, 1])))
    by_value, by_slope, square, cube = np.moveaxis(pieces, 1, 0)
    square, cube = square * rate, cube * rate**2
    slope = np.zeros((count + 1, pieces.shape[2]))
    slope[:-1] += by_slope - 2.0 * square + cube
    slope[1:] += cube - square
    chord = 3.0 * square - 2.0 * cube
    bands = np.array([[1.0], [4.0], [1.0]]) * np.ones(count + 1)
    bands[1, [0, -1]] = 1.0
    bands[0, -1] = bands[2, 0] = 2.0
    right = linalg.solve_banded((1, 1), bands, slope)
    chord[:-1] += 3.0 * right[1:-1]
    chord[1:] += 3.0 * right[1:-1]
    chord[[0, -1]] += 2.5 * right[[0, -1]]
    chord[1] += 0.5 * right[0]
    chord[-2] += 0.5 * right[-1]
    found = np.zeros_like(slope)
    found[:-1] += by_value - chord * rate
    found[1:] += chord * rate
    return found


def find_kinks(samples: FloatArray) -> NDArray[np.intp]:
    """Return the samples at which the slope jumps, because a spline across them would ring.

    At such a sample the second difference is large compared with both neighbours.
    """
    bend = np.abs(np.diff(samples, n=2, axis=0))
    if len(bend) < 3:
        return np.zeros(0, dtype=np.intp)
    floor = 1e-9 * np.max(np.abs(samples), initial=0.0)
    beside = np.maximum(bend[:-2], bend[2:])
    stands_out = np.any(bend[1:-1] > _KINK * beside + floor, axis=1)
    return np.flatnonzero(stands_out) + 2


def pulses(breaks: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return times (s) in the pulses of columns (pieces, 4, columns) that rest otherwise.

    A step that is long, because an arm rests, must not pass over a pulse, whose force none of its
    stages and error estimates sees. An arm at rest passed over those of 5 % of the run, and not
    over those of 10 %.
    """
    width = np.diff(breaks)[:, None]
    slopes = np.abs(coefficients[:, 1:]) * np.stack([width**0, 2.0 * width, 3.0 * width**2], axis=1)
    steep = slopes.sum(axis=1) * (width > _JUMP * width.sum())
    active = steep > _STILL * steep.max(axis=0)
    times = [np.zeros(0)]
    for column in active[:, (active * width).sum(axis=0) < _PULSE * width.sum()].T:
        edges = np.flatnonzero(np.diff(np.concatenate([[False], column, [False]])))
        for first, last in edges.reshape(-1, 2):
            times.append(np.linspace(breaks[first], breaks[last], _STOPS))
    return np.unique(np.concatenate(times))


FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PiecewiseCubic:
    """Columns of numbers as cubics of time between breaks."""

    breaks: FloatArray  # (pieces + 1,) s, ascending
    #: (pieces, 4, columns): the value is ``sum_p coefficients[k, p] (t - breaks[k])^p``
    coefficients: FloatArray
    #: (stops,) s: times after 0, the start of runs, where a value or a slope jumps
    stops: FloatArray
    #: longest interval (s) between two instants at which a function of time was evaluated to
    #: create this object; 0 for samples and tables, which are exact
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
        return np.asarray(c[:, 0] + x * (c[:, 1] + x * (c[:, 2] + x * c[:, 3])))

    def rates_at(self, times: FloatArray) -> FloatArray:
        """Evaluate the derivative at times (T,): (T, columns), 1/s; at a break from the right."""
        c, x = self._pieces_at(times)
        return np.asarray(c[:, 1] + x * (2.0 * c[:, 2] + 3.0 * x * c[:, 3]))

    def means(self, edges: FloatArray) -> FloatArray:
        """Return the means (intervals, columns) between ascending times (intervals + 1,)."""
        own = self.held_to(float(edges[-1]))
        integral = interpolate.PPoly(
            own.coefficients[:, ::-1].swapaxes(0, 1), own.breaks
        ).antiderivative()
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
        breaks, stops = np.append(self.breaks, time), np.append(self.stops, end)
        coefficients = np.concatenate([self.coefficients, held])
        return replace(self, breaks=breaks, coefficients=coefficients, stops=stops)

    def stopping_where_rough(self, relative: float) -> PiecewiseCubic:
        """Add stops where samples jump or contain noise, for a relative tolerance of a run.

        A step over several samples sees little of what turns the spline between them. The cubic
        terms of neighbouring pieces then differ, and their difference changes from sample to
        sample. Rounding errors beside other columns do not count.
        """
        values, cubic = np.abs(self.coefficients[:, 0]).max(axis=0), self.coefficients[:, 3]
        width, shares = np.diff(self.breaks), np.maximum(values, _FAINT * values.max(initial=0.0))
        jumps = np.diff(cubic, axis=0) * np.minimum(width[:-1], width[1:])[:, None] ** 3
        turns = np.diff(jumps, axis=0, append=0.0)
        rough = np.minimum(np.abs(jumps), np.abs(turns)) > _ROUGH * relative * shares
        stops = np.union1d(self.stops, self.breaks[1:-1][np.any(rough, axis=1)])
        return replace(self, stops=stops)

    def _pieces_at(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the coefficients (T, 4, columns) at times (T,), and the times (T, 1) in them."""
        last = len(self.breaks) - 2
        k = np.minimum(np.maximum(self.breaks.searchsorted(times, "right") - 1, 0), last)
        return self.coefficients[k], (times - self.breaks[k])[:, None]

    def _split(self, breaks: FloatArray) -> FloatArray:
        """Return coefficients (pieces, 4, columns) of the same function over finer pieces."""
        c, x = self._pieces_at(breaks[:-1])
        c0, c1, c2, c3 = c.swapaxes(0, 1)
        value, rate = c0 + x * (c1 + x * (c2 + x * c3)), c1 + x * (2.0 * c2 + 3.0 * x * c3)
        return np.stack([value, rate, c2 + 3.0 * x * c3, c3], axis=1)


def delayed(history: PiecewiseCubic, delay: float) -> PiecewiseCubic:
    """Return a history that is later by ``delay`` (s), with its first value before that.

    It is earlier by a negative delay, with its last value at the end.
    """
    place = 0 if delay > 0.0 else -1
    edge, constant = history.breaks[[place]], np.zeros_like(history.coefficients[:1])
    constant[:, 0] = history.at(edge)
    parts = [constant, history.coefficients]
    stops = np.concatenate([edge, history.stops]) + delay
    return replace(
        history,
        breaks=np.sort(np.concatenate([edge, history.breaks + delay])),
        coefficients=np.concatenate(parts if delay > 0.0 else parts[::-1]),
        stops=np.sort(stops[stops > 0.0]),
    )
