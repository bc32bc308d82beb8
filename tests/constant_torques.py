"""The motion of a body under torques that are constant between given times."""

from __future__ import annotations

from typing import Any

import numpy as np


def parabolas(edges: Any, acceleration: Any, t: Any) -> tuple[Any, Any]:
    """Return angle and rate at t (s) of a body that starts at rest.

    acceleration: one value, rad/s^2, between any two of the times ``edges``.
    """
    angle = rate = 0.0
    for start, end, value in zip(edges[:-1], edges[1:], acceleration, strict=True):
        span = np.clip(t, start, end) - start
        angle += rate * span + value * span**2 / 2
        rate += value * span
    return angle, rate
