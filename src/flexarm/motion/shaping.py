"""Motions made of another one: sums of delayed copies that cancel a vibration, averages.

Delays are measured in the phase of the vibration, whose frequency may change: theory page
"position control", (C.7) and (C.8). Averages over a window of the past: (C.9) and (C.10).

Impulses: (C.3) to (C.6), (C.16), with times in the phase of the damped vibration, rad.

References:
    N. C. Singer and W. P. Seering, J. Dynamic Systems, Measurement, and Control 112 (1990) 76-82.
    W. E. Singhose, W. P. Seering and N. C. Singer, J. Mechanical Design 116 (1994) 654-659.
    W. E. Singhose, W. P. Seering and N. C. Singer, Japan-USA Symposium on Flexible Automation
    (1996) 1-8: specified insensitivity.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from flexarm.base.arguments import check_choice, check_positive
from flexarm.base.errors import InputError, Problem, public_call
from flexarm.base.late import interpolate, optimize
from flexarm.motion.motion import DerivedMotion, Floats, JointState, Motion, check_motion

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


#: Impulses, half a period of the vibration apart, up to a common factor. ``K`` is the amplitude of
#: a vibration after half a period relative to its start. At the design frequency, no residual
#: vibration remains, (C.4), nor its derivative by the frequency, nor the second one, (C.5); or the
#: residual is the tolerance r, (C.6).
SHAPERS: dict[str, Callable[[float, float], tuple[float, ...]]] = {
    "zv": lambda K, r: (1.0, K),
    "zvd": lambda K, r: (1.0, 2.0 * K, K * K),
    "zvdd": lambda K, r: (1.0, 3.0 * K, 3.0 * K * K, K**3),
    "ei": lambda K, r: (1.0, (2.0 * K * K - r * (1.0 + K * K)) / (K + r), K * K),
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
    """Return the shortest positive impulses with a limited residual in a range; (C.16)."""
    start = _undamped(tolerance, insensitivity)
    decayed = start.amplitudes * np.exp(-_slope(damping_ratio) * start.phases)
    count = len(decayed)
    ratios = _range(insensitivity)

    def shaper(x: Floats) -> Impulses:
        return Impulses(x[:count], np.concatenate([[0.0], np.cumsum(x[count:])]))

    def margin(x: Floats) -> Floats:
        left = residual(shaper(x), damping_ratio, ratios) / tolerance
        return 1.0 - left**2

    found = optimize.minimize(
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
    waves = np.cos(np.outer(_range(insensitivity), np.linspace(0.0, 0.5 * duration, _PLACES)))
    limit = -np.ones((len(waves), 1))
    both = np.vstack([np.hstack([waves, limit]), np.hstack([-waves, limit])])
    cost, total = np.zeros(_PLACES + 1), np.ones((1, _PLACES + 1))
    cost[-1], total[0, -1] = 1.0, 0.0
    found = optimize.linprog(cost, both, np.zeros(len(both)), total, [1.0], method="highs")
    return float(found.fun), found.x[:-1]


def _merged(places: Floats, parts: Floats) -> Impulses:
    """Return one impulse for each group of neighbouring places with a share."""
    used = np.flatnonzero(parts > _SMALLEST)
    groups = np.split(used, np.flatnonzero(np.diff(places[used]) > 2.5 * places[1]) + 1)
    amplitudes = np.array([parts[group].sum() for group in groups])
    phases = np.array([parts[group] @ places[group] / parts[group].sum() for group in groups])
    return Impulses(amplitudes / amplitudes.sum(), phases - phases[0])


#: Largest number of Newton steps for the inverse of the phase.
_NEWTON_STEPS = 50


@dataclass(frozen=True, eq=False)
class Clock:
    """Phase of a vibration whose frequency changes with time; (C.7).

    ``rates`` (k,) rad/s are damped angular frequencies at evenly spaced ``times`` (k,) s, at least
    six; the frequency is constant before and after them.
    """

    times: Floats
    rates: Floats

    @cached_property
    def _rate(self) -> interpolate.BSpline:
        still = [(1, 0.0), (2, 0.0)]
        return interpolate.make_interp_spline(self.times, self.rates, k=5, bc_type=(still, still))

    @cached_property
    def _phase(self) -> interpolate.BSpline:
        return self._rate.antiderivative()

    def rate(self, t: Floats, derivative: int = 0) -> Floats:
        """Return the angular frequency, rad/s, or its derivative."""
        inside = np.clip(t, self.times[0], self.times[-1])
        found: Floats = self._rate(inside, derivative)
        return np.where(inside == t, found, 0.0) if derivative else found

    def phase(self, t: Floats) -> Floats:
        """Return the phase, rad, zero at the first time."""
        inside = np.clip(t, self.times[0], self.times[-1])
        found: Floats = self._phase(inside) - self._phase(self.times[0])
        # The frequency is constant outside the times, and an infinite time has an infinite phase.
        return found + np.where(inside == t, 0.0, self.rate(inside) * (t - inside))

    def time(self, phase: Floats) -> Floats:
        """Return the time at a phase, s, the inverse of `phase`."""
        known = self.phase(self.times)
        t = np.interp(phase, known, self.times)
        first, last = self.rates[0], self.rates[-1]
        t = np.where(phase < 0.0, self.times[0] + phase / first, t)
        t = np.where(phase > known[-1], self.times[-1] + (phase - known[-1]) / last, t)
        between = (phase >= 0.0) & (phase <= known[-1])
        inside, target = t[between], phase[between]
        for _ in range(_NEWTON_STEPS):
            step = (target - self.phase(inside)) / self.rate(inside)
            inside = inside + step
            if np.max(np.abs(step), initial=0.0) <= 1e-15 * np.ptp(self.times):
                break
        t[between] = inside
        return t


@dataclass(frozen=True, eq=False, repr=False)
class ShapedMotion(DerivedMotion):
    """A motion convolved with impulses.

    Attributes:
        amplitudes: amplitudes of the impulses (k,), with sum 1.
        phases: phases of the vibration at the impulses (k,), rad, ascending from 0.
        clock: phase of the vibration as a function of time.
    """

    amplitudes: Floats
    phases: Floats
    clock: Clock

    def _about(self) -> str:
        return f"{len(self.phases)} impulses, {super()._about()}"

    def _times(self) -> tuple[float, float]:
        start, own = self.motion.start_time, np.array([self.motion.end_time])
        last = self.clock.phase(own) + self.phases[-1]
        return start, float(self.clock.time(last)[0]) - start

    @property
    def breaks(self) -> tuple[float, ...]:
        """Breaks of all copies of the original, s."""
        return tuple(np.unique(self._images).tolist())

    @property
    def delays(self) -> Floats:
        """Delays of the start (row 0) and of the end (row 1) of each copy, (2, k), s."""
        ends = self._images[:, [0, -1]]
        return (ends - ends[:1]).T

    @cached_property
    def _images(self) -> Floats:
        """Times of the breaks of the original in each copy, (k, breaks), s."""
        own = np.array(self.motion.breaks)
        turned = self.clock.phase(own) + self.phases[:, None]
        images = self.clock.time(turned.reshape(-1)).reshape(turned.shape)
        images[0], images[-1, -1] = own, self.end_time  # without rounding errors
        return images

    def at(self, times: Floats) -> JointState:
        """See `Motion.at`: (C.8), and its derivatives by the chain rule."""
        total = [self.amplitudes[0] * part for part in self.motion.at(times)]
        now, slope = self.clock.rate(times), self.clock.rate(times, 1)
        finite = np.isfinite(times)
        phase = self.clock.phase(np.where(finite, times, 0.0))
        for k, share in enumerate(self.amplitudes[1:], start=1):
            original = np.where(finite, self.clock.time(phase - self.phases[k]), times)
            breaks, images = np.array(self.motion.breaks), self._images[k]
            piece = np.searchsorted(images, times, side="right")
            least = np.concatenate([[-np.inf], breaks])[piece]
            most = np.concatenate([np.nextafter(breaks, -np.inf), [np.inf]])[piece]
            original = np.clip(original, least, most)
            then = self.clock.rate(original)
            speed = now / then
            bend = (slope - self.clock.rate(original, 1) * speed**2) / then
            state = self.motion.at(original)
            total[0] += share * state.angle
            total[1] += share * state.rate * speed[:, None]
            bent = state.acceleration * speed[:, None] ** 2
            total[2] += share * (bent + state.rate * bend[:, None])
        return JointState(*total)


#: Gauss points between two breaks: exact to rounding for motions that are smooth there.
_POINTS = 24
#: Number of times averaged in one batch: limits the memory for long runs.
_CHUNK = 1024

#: Weights over the fraction of the window, from 0 to 1, with mean 1.
WINDOWS: dict[str, Callable[[Floats], Floats]] = {
    "moving_average": np.ones_like,
    "raised_cosine": lambda u: 1.0 - np.cos(2.0 * np.pi * u),
}


@dataclass(frozen=True, eq=False, repr=False)
class SmoothedMotion(DerivedMotion):
    """A motion averaged over a window: it starts with the original and ends a window later.

    Attributes:
        window: name of the weights in `WINDOWS`.
        span: length of the window, s.
    """

    window: str
    span: float

    def _about(self) -> str:
        return f"{self.window} of {self.span:.5g} s, {super()._about()}"

    def _times(self) -> tuple[float, float]:
        return self.motion.start_time, self.motion.duration + self.span

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which a break of the original enters or leaves the window, s."""
        own = self.motion.breaks
        late = [t + self.span for t in own[:-1]]  # the last one is exactly the end
        return tuple(sorted({*own, *late, self.end_time}))

    def at(self, times: Floats) -> JointState:
        parts = [self._averages(times[k : k + _CHUNK]) for k in range(0, len(times), _CHUNK)]
        if not parts:
            return self.motion.at(times)
        angle, rate, acceleration = (np.concatenate(part) for part in zip(*parts, strict=True))
        # At the end, the last break may still be in the window because of rounding.
        moving = ((times >= self.start_time) & (times < self.end_time))[:, None]
        return JointState(angle, rate * moving, acceleration * moving)

    def _averages(self, times: Floats) -> list[Floats]:
        ages, shares = self._points(times)
        counted = shares > 0.0  # zero between breaks outside the window
        state = self.motion.at((times[:, None] - ages)[counted])
        parts = np.zeros((*ages.shape, 3, self.joints))
        parts[counted] = np.stack(state, axis=1)
        averages = np.einsum("tk,tkpn->ptn", shares, parts)
        return list(averages)

    def _points(self, times: Floats) -> tuple[Floats, Floats]:
        """Return the ages (T, k), s, and the weights (T, k) of the points of quadrature."""
        ages, shares = window_points(times, self.motion.breaks, (0.0, self.span), _POINTS)
        return ages, shares * WINDOWS[self.window](ages / self.span)


_gauss = lru_cache(np.polynomial.legendre.leggauss)


def window_points(
    times: Floats, breaks: Sequence[float], window: tuple[float, float], count: int
) -> tuple[Floats, Floats]:
    """Return ages (T, k) s of Gauss points over a window before each time, and their shares."""
    ago = np.clip(times[:, None] - np.array(breaks), *window)
    edges = np.sort(np.pad(ago, ((0, 0), (1, 1)), constant_values=((0, 0), window)))
    nodes, weights = _gauss(count)
    middle, half = 0.5 * (edges[:, 1:] + edges[:, :-1]), 0.5 * np.diff(edges, axis=1)
    ages = (middle[:, :, None] + half[:, :, None] * nodes).reshape(len(times), -1)
    shares = (half[:, :, None] * weights).reshape(ages.shape) / (window[1] - window[0])
    return ages, shares


@public_call
def smoothed(motion: Motion, duration: float, window: str = "raised_cosine") -> SmoothedMotion:
    """Smooth a motion in time by averages of the joint angles over the last ``duration``.

    Args:
        motion: the original motion.
        duration: length of the window, s; the motion ends that much later.
        window: weights of the average: "moving_average" is uniform, "raised_cosine" is 1 - cos.

    Returns:
        The smoothed motion. Its tip deviates a little from the original path, because angles are
        averaged and the path is not linear in them.

    Raises:
        InputError: if ``motion`` is not a motion, ``duration`` is not positive, or ``window`` is
            unknown.

    A vibration of frequency f is not excited where ``f * duration`` is 1, 2, 3, ... (moving
    average) or 2, 3, ... (raised cosine); (C.10).
    """
    motion = check_motion(motion)
    window = check_choice("window", window, WINDOWS)
    return SmoothedMotion(motion, window, check_positive("duration", duration, "s"))
