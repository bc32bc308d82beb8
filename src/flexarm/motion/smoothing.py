"""Motions smoothed in time: averages of the joint angles over a window of the past.

Theory page "position control", (C.9) and (C.10).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm.base.arguments import check_choice, check_positive
from flexarm.base.errors import public_call
from flexarm.motion.motion import DerivedMotion, JointState, Motion, check_motion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

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
    """Return the points of Gauss quadrature over a window around each time, between the breaks.

    Args:
        times: (T,) s. breaks: (b,) s, where the averaged function is not smooth.
        window: first and last age, s, counted back from each time.
        count: points between two neighbouring breaks.

    Returns:
        Ages (T, k), s, and shares (T, k) of the window, whose sum is 1.
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
