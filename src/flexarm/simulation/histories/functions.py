"""Functions of time as piecewise cubics, approximated as accurately as a run requires."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.base.errors import InputError, Problem, check_array
from flexarm.base.user_functions import FunctionError, call, first_failure
from flexarm.simulation.histories.piecewise import FloatArray, PiecewiseCubic

#: Allowed error of the cubics, as a fraction of the integrator's tolerance, and its lower limit.
_SHARE, _LEAST = 1e-2, 1e-12
#: Maximum number of pieces that are halved at once: a few for a function with a few jumps, all of
#: them for noise.
_MOST_PIECES = 50_000
#: Initial number of pieces of a function of time.
_FIRST_PIECES = 64
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

    Args:
        relative: relative tolerance of the run.
        breaks: times (s) of kinks or jumps, in addition to ``function.breaks`` if it exists.
        name: name of the function, for messages.
        spacing: interval (s) of the comparison, increased to limit it to 20 000 instants; None
            for no comparison.

    Raises:
        InputError: if the function does not return ``columns`` finite numbers or is rough
            everywhere, or the breaks are not a list of numbers.
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
    stops = np.unique(np.concatenate([known, stops, _jumps(times, pieces, follower.allowed)]))
    inner = stops[(stops > 0.0) & (stops < duration)]
    points = starts[:, None] + np.diff(times)[:, None] * follower.points
    gap = float(np.max(np.diff(np.union1d(points, instants))))
    return PiecewiseCubic(times, pieces, inner, gap)


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
        self._function = function
        self._name = name
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
                raise InputError(Problem(self._name, rule, value, hint))
            middle = 0.5 * (a + b)
            starts, ends = np.concatenate([a, middle]), np.concatenate([middle, b])
        times = np.concatenate([start for start, _ in kept])
        order = np.argsort(times)
        pieces = np.concatenate([piece for _, piece in kept])[order]
        return times[order], pieces, np.concatenate(stops)

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
            for t in in_order:
                row = call(self._name, function, t)
                # Copy, because the function may write each result into the same array or list.
                rows.append(copy(row) if type(row) is list or hasattr(row, "__array__") else row)
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
