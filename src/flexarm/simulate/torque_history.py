"""Torques over time as piecewise cubics: from samples, from a function of time.

The kernels read one form only; everything a user may give is turned into it here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arguments import check_choice
from flexarm.errors import InputError, Problem, check_array
from flexarm.simulate.functions_of_time import FunctionError, call, first_failure

FloatArray = NDArray[np.float64]

INTERPOLATIONS = ("cubic", "linear", "hold")
#: A second difference that stands out this much from both neighbours is a kink, not curvature:
#: between samples fine enough for a cubic, curvature changes by far less.
_KINK = 10.0
#: Pieces being halved at once. Few jumps keep few pieces open; noise keeps all of them.
_MOST_PIECES = 50_000


@dataclass(frozen=True, eq=False)
class TorqueHistory:
    """Joint torques as a piecewise cubic.

    Attributes:
        breaks: (pieces + 1,) s, ascending.
        coefficients: (pieces, 4, joints): ``sum_p coefficients[k, p] (t - breaks[k])^p`` N m.
        stops: (stops,) s: times where a value or a slope jumps.
    """

    breaks: FloatArray
    coefficients: FloatArray
    stops: FloatArray

    def at(self, times: FloatArray) -> FloatArray:
        """Evaluate at times (T,): (T, joints) N m; on a break from the right."""
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
        return TorqueHistory(self.breaks, coefficients, self.stops)


def constant_torque(torque: FloatArray) -> TorqueHistory:
    """Hold a torque (joints,) for ever."""
    coefficients = np.zeros((1, 4, torque.size))
    coefficients[0, 0] = torque
    return TorqueHistory(np.array([0.0, 1.0]), coefficients, np.zeros(0))


def sampled_torque(
    values: ArrayLike, rate: float, duration: float, joints: int, interpolation: str
) -> TorqueHistory:
    """Interpolate samples (samples, joints) taken at ``rate`` (Hz) from time zero.

    Args:
        values: N m; they must reach to the end of the run, less one sample at most.
        interpolation: "hold" keeps each sample until the next; "linear" joins them; "cubic" is
            the spline with continuous curvature, parted where the samples show a kink.

    Raises:
        InputError: too few samples, wrong shape, NaN, or an unknown interpolation.
    """
    where = "simulate"
    check_choice(where, "torque_interpolation", interpolation, INTERPOLATIONS)
    samples = check_array(where, "torque", values, (-1, joints))
    needed = int(np.floor(duration * rate * (1 + 1e-12) + 1e-9))
    if len(samples) < max(needed, 1):
        rule = f"hold at least {max(needed, 1)} samples (duration times rate)"
        raise InputError(Problem(where, "torque", rule, f"{len(samples)} samples"))
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
        return TorqueHistory(times, coefficients, times[1:-1][bends])
    return _spline(times, samples)


def _spline(times: FloatArray, samples: FloatArray) -> TorqueHistory:
    from scipy.interpolate import CubicSpline

    kinks = find_kinks(samples)
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
    """Return the samples at which a slope jumps: a spline across them would ring.

    There the second difference is large against that of both neighbours.
    """
    bend = np.abs(np.diff(samples, n=2, axis=0))
    if len(bend) < 3:
        return np.zeros(0, dtype=np.intp)
    floor = 1e-9 * np.max(np.abs(samples), axis=0, initial=0.0)
    beside = np.maximum(bend[:-2], bend[2:])
    stands_out = np.any(bend[1:-1] > _KINK * beside + floor, axis=1)
    return np.flatnonzero(stands_out) + 2


def function_torque(
    function: Callable[[float], ArrayLike],
    duration: float,
    joints: int,
    relative: float,
    breaks: ArrayLike = (),
    name: str = "torque",
    where: str = "simulate",
) -> TorqueHistory:
    """Follow a function ``t -> (joints,)`` by cubics, as closely as the run's tolerance needs.

    Each piece is halved until the cubic through four of its points meets three more to
    ``relative`` of the largest torque; where halving no longer helps, the function jumps or bends,
    and the integrator is made to stop there. Two features closer together than a 64th of the run
    and invisible at the first points may be missed: give ``breaks`` there.

    Args:
        breaks: times (s) known to be kinks or jumps.
        name: what the function is, for messages; ``where``: the call.

    Raises:
        InputError: the function returns something else than ``joints`` finite numbers, or is
            rough everywhere.
    """
    follower = _Follower(function, duration, joints, name, where)
    known = np.asarray(breaks, dtype=np.float64).ravel()
    known = known[(known > 0.0) & (known < duration)]
    edges = np.unique(np.concatenate([np.linspace(0.0, duration, 65), known]))
    starts, ends = edges[:-1], edges[1:]
    shortest = duration * 2.0**-40
    scale = 0.0
    stops = [known]
    kept: list[tuple[FloatArray, FloatArray]] = []
    while starts.size:
        coefficients, errors, largest = follower.cubics(starts, ends)
        scale = max(scale, largest)
        good = errors <= relative * scale
        hopeless = ~good & (ends - starts <= shortest)
        stops += [starts[hopeless], ends[hopeless]]
        done = good | hopeless
        kept.append((starts[done], coefficients[done]))
        a, b = starts[~done], ends[~done]
        if a.size > _MOST_PIECES:
            rule = "be a function of time that is smooth but for a few jumps"
            value = f"still not followed at steps of {(b - a).min():.2g} s"
            hint = "It must give one answer at one time: pass noise as samples at a rate."
            raise InputError(Problem(where, name, rule, value, hint))
        middle = 0.5 * (a + b)
        starts, ends = np.concatenate([a, middle]), np.concatenate([middle, b])
    times = np.concatenate([start for start, _ in kept])
    order = np.argsort(times)
    pieces = np.concatenate([piece for _, piece in kept])[order]
    times = np.append(times[order], duration)
    stops.append(_jumps(times, pieces, relative * scale))
    inner = np.unique(np.concatenate(stops))
    return TorqueHistory(times, pieces, inner[(inner > 0.0) & (inner < duration)])


def _jumps(breaks: FloatArray, coefficients: FloatArray, allowed: float) -> FloatArray:
    """Return the breaks where value or slope differ by far more than the approximation errs."""
    width = np.diff(breaks)[:-1, None]
    left, right = coefficients[:-1], coefficients[1:]
    value = left[:, 0] + width * (left[:, 1] + width * (left[:, 2] + width * left[:, 3]))
    slope = left[:, 1] + width * (2.0 * left[:, 2] + 3.0 * width * left[:, 3])
    narrower = np.minimum(width, np.diff(breaks)[1:, None])
    jump = np.abs(value - right[:, 0]) > 100.0 * allowed
    bend = np.abs(slope - right[:, 1]) * narrower > 1000.0 * allowed
    return breaks[1:-1][np.any(jump | bend, axis=1)]


class _Follower:
    """Calls the user's function, checks what it returns, fits cubics."""

    #: Four points that the cubic goes through (ends shared), and three that test it.
    _NODES = np.array([0.0, 0.25, 0.75, 1.0])
    _TESTS = np.array([0.1, 0.5, 0.9])

    def __init__(
        self,
        function: Callable[[float], ArrayLike],
        duration: float,
        joints: int,
        name: str,
        where: str,
    ) -> None:
        self._function = function
        self._where, self._name = where, name
        self._joints = joints
        self._powers = np.vander(self._TESTS, 4, increasing=True)
        # A point just inside each end: the function may jump exactly on an edge, and either side
        # must be followed from within.
        self._inside = 1e-12 * duration

    def _values(self, times: FloatArray) -> FloatArray:
        """Call the function: once for all times if it says that it can, else for each.

        Raises:
            InputError: if it returns something else than numbers for the joints.
            FunctionError: if it raises; the time is that up to which it answered.
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
        before = 0.0  # where it fails from the start, nothing was computed
        for k in np.argsort(times):
            t = float(times[k])
            try:
                row = call(self._name, function, t)
            except FunctionError as failed:
                raise first_failure(self._name, function, before, failed) from failed.__cause__
            rows[k] = check_array(self._where, f"{self._name}({t:g})", row, (self._joints,))
            before = t
        return rows

    def cubics(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Fit pieces from a (k,) to b: coefficients (k, 4, joints), errors (k,), largest value."""
        width = (b - a)[:, None]
        inside = np.minimum(self._inside / width, 1e-3)
        nodes = np.tile(self._NODES, (a.size, 1))
        nodes[:, :1] += inside
        nodes[:, -1:] -= inside
        tests = np.tile(self._TESTS, (a.size, 1))
        times = a[:, None] + np.concatenate([nodes, tests], axis=1) * width
        values = self._values(times.ravel()).reshape(*times.shape, self._joints)
        powers = nodes[:, :, None] ** np.arange(4.0)
        scaled = np.linalg.solve(powers, values[:, :4])
        missed = self._powers @ scaled - values[:, 4:]
        errors = np.max(np.abs(missed), axis=(1, 2))
        coefficients = scaled / width[:, :, None] ** np.arange(4.0)[:, None]
        return coefficients, errors, float(np.max(np.abs(values)))
