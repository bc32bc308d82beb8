"""Motions made of another one: sums of delayed copies that cancel a vibration, averages.

Delays are measured in the phase of the vibration, whose frequency may change: theory page
"position control", (C.7) and (C.8). Averages over a window of the past: (C.9) and (C.10).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from flexarm.base.arguments import check_choice, check_positive
from flexarm.base.errors import public_call
from flexarm.motion.motion import DerivedMotion, JointState, Motion, check_motion

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.interpolate import BSpline

    Floats = NDArray[np.float64]


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
    def _rate(self) -> BSpline:
        from scipy.interpolate import make_interp_spline

        still = [(1, 0.0), (2, 0.0)]
        return make_interp_spline(self.times, self.rates, k=5, bc_type=(still, still))

    @cached_property
    def _phase(self) -> BSpline:
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


@dataclass(frozen=True, eq=False)
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
            own = np.where(finite, self.clock.time(phase - self.phases[k]), times)
            own = self._beside_breaks(times, own, k)
            then = self.clock.rate(own)
            speed = now / then
            bend = (slope - self.clock.rate(own, 1) * speed**2) / then
            state = self.motion.at(own)
            total[0] += share * state.angle
            total[1] += share * state.rate * speed[:, None]
            total[2] += share * (
                state.acceleration * speed[:, None] ** 2 + state.rate * bend[:, None]
            )
        return JointState(*total)

    def _beside_breaks(self, times: Floats, own: Floats, k: int) -> Floats:
        """Correct rounding that moves a time across a break of the original."""
        breaks, images = np.array(self.motion.breaks), self._images[k]
        piece = np.searchsorted(images, times, side="right")
        least = np.concatenate([[-np.inf], breaks])[piece]
        most = np.concatenate([np.nextafter(breaks, -np.inf), [np.inf]])[piece]
        return np.clip(own, least, most)


#: Gauss points between two breaks: exact to rounding for motions that are smooth there.
_POINTS = 24
#: Number of times averaged in one batch: limits the memory for long runs.
_CHUNK = 1024

#: Weights over the fraction of the window, from 0 to 1, with mean 1.
WINDOWS: dict[str, Callable[[Floats], Floats]] = {
    "moving_average": np.ones_like,
    "raised_cosine": lambda u: 1.0 - np.cos(2.0 * np.pi * u),
}


@dataclass(frozen=True, eq=False)
class SmoothedMotion(DerivedMotion):
    """A motion averaged over a window: it starts with the original and ends a window later.

    Attributes:
        window: name of the weights in `WINDOWS`.
        span: length of the window, s.
    """

    window: str
    span: float

    def _times(self) -> tuple[float, float]:
        return self.motion.start_time, self.motion.duration + self.span

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which a break of the original enters or leaves the window, s."""
        own = self.motion.breaks
        late = [t + self.span for t in own[:-1]]  # the last one is exactly the end
        return tuple(sorted({*own, *late, self.end_time}))

    def at(self, times: Floats) -> JointState:
        """See `Motion.at`."""
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


def window_points(
    times: Floats, breaks: Sequence[float], window: tuple[float, float], count: int
) -> tuple[Floats, Floats]:
    """Return ages (T, k) s of Gauss points over a window before each time, and their shares.

    ``breaks`` (b,) s are where the averaged function is not smooth, ``window`` the first and last
    age (s), ``count`` the points between two breaks. The sum of the shares (T, k) is 1.
    """
    ago = np.clip(times[:, None] - np.array(breaks), *window)
    edges = np.sort(np.pad(ago, ((0, 0), (1, 1)), constant_values=((0, 0), window)))
    nodes, weights = np.polynomial.legendre.leggauss(count)
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
