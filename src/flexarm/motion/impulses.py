"""Impulses of input shapers, and the vibration that remains after them: (C.3) to (C.6), (C.16).

Times are measured in the phase of the damped vibration at the design frequency, rad.

References:
    N. C. Singer and W. P. Seering, J. Dynamic Systems, Measurement, and Control 112 (1990) 76-82.
    W. E. Singhose, W. P. Seering and N. C. Singer, J. Mechanical Design 116 (1994) 654-659.
    W. E. Singhose, W. P. Seering and N. C. Singer, Japan-USA Symposium on Flexible Automation
    (1996) 1-8: specified insensitivity.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.base.errors import InputError, Problem

Floats = NDArray[np.float64]

#: Number of frequencies at which a design limits the residual, and of possible impulses in half a
#: shaper. Between two frequencies the residual exceeds the tolerance by 5e-4 of it at most, for
#: tolerances of a percent and more.
_FREQUENCIES, _PLACES = 161, 160
#: Relative precision of the duration before the refinement, and smallest share of an impulse.
_BRACKET, _SMALLEST = 2e-3, 1e-6


class Impulses(NamedTuple):
    """Impulses of a shaper."""

    amplitudes: Floats  # (k,), with sum 1
    phases: Floats  # (k,) rad, ascending from 0


def zero_vibration(K: float, tolerance: float) -> tuple[float, ...]:
    """Return two impulses without residual vibration at the design frequency; (C.4)."""
    return 1.0, K


def zero_vibration_and_derivative(K: float, tolerance: float) -> tuple[float, ...]:
    """Return three impulses: the derivative of the residual by frequency is zero, too; (C.5)."""
    return 1.0, 2.0 * K, K * K


def zero_vibration_and_two_derivatives(K: float, tolerance: float) -> tuple[float, ...]:
    """Return four impulses: the second derivative is zero, too; (C.5)."""
    return 1.0, 3.0 * K, 3.0 * K * K, K**3


def extra_insensitive(K: float, tolerance: float) -> tuple[float, ...]:
    """Return three impulses with the residual ``tolerance`` at the design frequency; (C.6)."""
    middle = (2.0 * K * K - tolerance * (1.0 + K * K)) / (K + tolerance)
    return 1.0, middle, K * K


#: Impulses, half a period of the vibration apart, up to a common factor. ``K`` is the amplitude of
#: a vibration after half a period relative to its start.
SHAPERS: dict[str, Callable[[float, float], tuple[float, ...]]] = {
    "zv": zero_vibration,
    "zvd": zero_vibration_and_derivative,
    "zvdd": zero_vibration_and_two_derivatives,
    "ei": extra_insensitive,
}


def impulses(method: str, damping_ratio: float, tolerance: float, insensitivity: float) -> Impulses:
    """Return the impulses of a shaper; "si" is `specified_insensitivity`."""
    if method == "si":
        return specified_insensitivity(damping_ratio, tolerance, insensitivity)
    left = float(np.exp(-np.pi * _slope(damping_ratio)))
    parts = np.array(SHAPERS[method](left, tolerance))
    phases: Floats = np.pi * np.arange(len(parts), dtype=np.float64)
    return Impulses(parts / parts.sum(), phases)


def residual(shaper: Impulses, damping_ratio: float, frequency_ratio: Floats) -> Floats:
    """Return the residual vibration, relative to that after one impulse, at ratios (k,); (C.3)."""
    s = _slope(damping_ratio)
    exponents = np.outer(frequency_ratio, (s - 1j) * shaper.phases)
    exponents -= s * shaper.phases[-1] * np.asarray(frequency_ratio)[:, None]
    return np.asarray(np.abs(np.exp(exponents) @ shaper.amplitudes))


def _slope(damping_ratio: float) -> float:
    """Return the decay of a damped vibration per phase, 1/rad."""
    return float(damping_ratio / np.sqrt(1.0 - damping_ratio**2))


@lru_cache(maxsize=64)
def specified_insensitivity(
    damping_ratio: float, tolerance: float, insensitivity: float
) -> Impulses:
    """Return the shortest positive impulses with a limited residual in a range; (C.16).

    ``tolerance`` is the largest residual in the range, ``insensitivity`` its width relative to the
    design frequency, its middle. InputError if no impulses were found.
    """
    from scipy.optimize import minimize

    start = _undamped(tolerance, insensitivity)
    decayed = start.amplitudes * np.exp(-_slope(damping_ratio) * start.phases)
    count = len(decayed)
    ratios = _range(insensitivity)

    def shaper(x: Floats) -> Impulses:
        return Impulses(x[:count], np.concatenate([[0.0], np.cumsum(x[count:])]))

    def margin(x: Floats) -> Floats:
        left = residual(shaper(x), damping_ratio, ratios) / tolerance
        return 1.0 - left**2

    found = minimize(
        lambda x: x[count:].sum(),
        np.concatenate([decayed / decayed.sum(), np.diff(start.phases)]),
        method="SLSQP",
        bounds=[(0.0, 1.0)] * count + [(0.0, None)] * (count - 1),
        constraints=[
            {"type": "ineq", "fun": margin},
            {"type": "eq", "fun": lambda x: x[:count].sum() - 1.0},
        ],
        options={"maxiter": 500, "ftol": 1e-10},
    )
    # At a degenerate optimum SLSQP reports a failed line search, so the result is examined.
    if np.min(margin(found.x)) < -1e-6 or found.fun > 1.01 * start.phases[-1]:
        rule = f"is {insensitivity:g}, for which the search for a shaper did not converge"
        hint = "Increase tolerance or reduce insensitivity."
        raise InputError(Problem("insensitivity", rule, hint=hint))
    amplitudes, phases = shaper(found.x)
    used = amplitudes > _SMALLEST
    return Impulses(amplitudes[used] / amplitudes[used].sum(), phases[used])


def _range(insensitivity: float) -> Floats:
    return np.linspace(1.0 - 0.5 * insensitivity, 1.0 + 0.5 * insensitivity, _FREQUENCIES)


@lru_cache(maxsize=64)
def _undamped(tolerance: float, insensitivity: float) -> Impulses:
    """Return nearly the shortest impulses without damping, by bisection of the duration.

    Impulses are symmetric in time. Their residual is then real, and for given times the smallest
    limit of the residual is a linear programme in the amplitudes.
    """
    shortest, longest = 0.0, 2.0 * np.pi
    while (best := _least(longest, insensitivity))[0] > tolerance:
        shortest, longest = longest, 1.5 * longest
    while longest - shortest > _BRACKET * longest:
        middle = 0.5 * (shortest + longest)
        tried = _least(middle, insensitivity)
        if tried[0] > tolerance:
            shortest = middle
        else:
            longest, best = middle, tried
    half, parts = np.linspace(0.0, 0.5 * longest, _PLACES), best[1]
    places = np.concatenate([-half[::-1], half]) + 0.5 * longest
    return _merged(places, 0.5 * np.concatenate([parts[::-1], parts]))


def _least(duration: float, insensitivity: float) -> tuple[float, Floats]:
    """Return the smallest limit of the residual, and amplitudes of pairs; ``duration`` in rad."""
    from scipy.optimize import linprog

    waves = np.cos(np.outer(_range(insensitivity), np.linspace(0.0, 0.5 * duration, _PLACES)))
    limit = -np.ones((len(waves), 1))
    both = np.vstack([np.hstack([waves, limit]), np.hstack([-waves, limit])])
    cost, total = np.zeros(_PLACES + 1), np.ones((1, _PLACES + 1))
    cost[-1], total[0, -1] = 1.0, 0.0
    found = linprog(cost, both, np.zeros(len(both)), total, [1.0], method="highs")
    return float(found.fun), found.x[:-1]


def _merged(places: Floats, parts: Floats) -> Impulses:
    """Return one impulse for each group of neighbouring places with a share."""
    used = np.flatnonzero(parts > _SMALLEST)
    groups = np.split(used, np.flatnonzero(np.diff(places[used]) > 2.5 * places[1]) + 1)
    amplitudes = np.array([parts[group].sum() for group in groups])
    phases = np.array([parts[group] @ places[group] / parts[group].sum() for group in groups])
    return Impulses(amplitudes / amplitudes.sum(), phases - phases[0])
