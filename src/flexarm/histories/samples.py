"""Torque samples as piecewise cubics: zero-order hold, lines or splines between the samples."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arguments import check_choice
from flexarm.errors import InputError, Problem, check_array
from flexarm.histories.piecewise import FloatArray, PiecewiseCubic

INTERPOLATIONS = ("cubic", "linear", "hold")
#: Ratio of a second difference to both neighbours above which a sample is a kink: if the samples
#: are close enough for a cubic, curvature changes by far less.
_KINK = 10.0
#: Number of samples whose splines are computed together, which bounds the memory.
_TOGETHER = 256
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
    places = np.asarray(breaks, dtype=np.float64) * rate
    places = places[(places > 0.0) & (places < len(samples) - 1.0)]
    beside = np.concatenate([np.floor(places + _ON_SAMPLE), np.ceil(places - _ON_SAMPLE)])
    return _spline(times, samples, beside.astype(np.intp)).held_to(duration)


def added_coefficients(
    history: PiecewiseCubic, units: FloatArray, rate: float, interpolation: str
) -> FloatArray:
    """Return the derivatives (pieces, 4, columns) of the coefficients of ``sampled_torque``.

    Args:
        history: the torque, whose kinks stay where they are.
        units: (samples, columns) changes of the samples of one joint, one in each column.
    """
    times = np.arange(len(units)) / rate
    if interpolation == "hold":
        at_jumps = np.repeat(times, 2)[1:], np.repeat(units, 2, axis=0)[:-1]
        return PiecewiseCubic.table(*at_jumps).coefficients
    if interpolation == "linear" or len(times) == 1:
        return PiecewiseCubic.table(times, units).coefficients
    kinks = np.rint(history.stops * rate).astype(np.intp)
    coefficients = _cubics(times, units, kinks[kinks < len(times) - 1])
    if len(history.coefficients) > len(coefficients):  # constant after the last sample
        end = np.zeros((1, 4, units.shape[1]))
        end[0, 0] = units[-1]
        coefficients = np.concatenate([coefficients, end])
    return coefficients


def collected_samples(
    history: PiecewiseCubic, pieces: FloatArray, rate: float, interpolation: str, count: int
) -> FloatArray:
    """Return the gradient of a number by samples from that by coefficients of ``sampled_torque``.

    This is the transpose of ``added_coefficients``.

    Args:
        pieces: (pieces, k, joints) gradient by the first k coefficients: 1 for "hold", 2 for
            "linear", 4 for "cubic".
        count: number of samples.
    """
    found = np.zeros((count, pieces.shape[2]))
    if interpolation == "cubic" and count > 1:
        for first in range(0, count, _TOGETHER):
            own = np.arange(first, min(first + _TOGETHER, count))
            units = np.zeros((count, own.size))
            units[own, own - first] = 1.0
            added = added_coefficients(history, units, rate, interpolation)
            found[own] = np.tensordot(added, pieces, axes=([0, 1], [0, 1]))
        return found
    starts = np.clip(np.rint(history.breaks[:-1] * rate).astype(np.intp), 0, count - 1)
    np.add.at(found, starts, pieces[:, 0])
    if interpolation == "linear" and count > 1:
        inside = (history.breaks[:-1] >= 0.0) & (starts < count - 1)
        slopes = rate * pieces[inside, 1]
        np.add.at(found, starts[inside], -slopes)
        np.add.at(found, starts[inside] + 1, slopes)
    return found


def _spline(times: FloatArray, samples: FloatArray, parted: NDArray[np.intp]) -> PiecewiseCubic:
    kinks = np.union1d(find_kinks(samples), parted)
    kinks = kinks[(kinks > 0) & (kinks < len(times) - 1)]
    return PiecewiseCubic(times, _cubics(times, samples, kinks), times[kinks])


def _cubics(times: FloatArray, samples: FloatArray, kinks: NDArray[np.intp]) -> FloatArray:
    """Return the coefficients of splines between kinks, which are samples inside the range."""
    from scipy.interpolate import CubicSpline

    edges = [0, *kinks.tolist(), len(times) - 1]
    coefficients = np.zeros((len(times) - 1, 4, samples.shape[1]))
    for first, last in pairwise(edges):
        piece = slice(first, last + 1)
        # SciPy orders (power falling, piece, joint); not-a-knot ends need four samples.
        spline = CubicSpline(times[piece], samples[piece], bc_type="not-a-knot")
        c = np.zeros((4, last - first, samples.shape[1]))
        c[4 - len(spline.c) :] = spline.c
        coefficients[first:last] = c[::-1].transpose(1, 0, 2)
    return coefficients


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
