"""Requested motion along a surface whose friction is estimated during the run."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flexarm.control.contract.base import Reference
from flexarm.control.contract.feedforward import SampledFeedforward
from flexarm.control.design.task_plan import Rows, values_of
from flexarm.control.hardware.measurement import FloatArray


class SurfaceMotion(NamedTuple):
    """Requested motion of the tip along a surface at one instant."""

    x: float  # of the tip of the bent arm, m, world axes
    y: float
    speed: float  # along the tangent (-normal_y, normal_x), m/s
    force_rate: float  # N/s


class SurfacePlan:
    """Plan of the requested motion along the surface; at rest for a reference without ``tip``."""

    def __init__(self, sample_time: float) -> None:
        self._sample_time = sample_time
        self.reset()

    def reset(self) -> None:
        """Clear the reference."""
        self._reference: Any = None
        self._rows: SampledFeedforward | None = None

    def along(self, t: float, reference: Reference) -> SurfaceMotion:
        """Return the requested motion along the surface at t (s)."""
        if self._rows is None or reference is not self._reference:
            self._reference = reference
            self._rows = SampledFeedforward(Rows(self._motion, reference), self._sample_time)
        numbers: Any = self._rows(t).tolist()
        return SurfaceMotion(*numbers)

    def _motion(self, reference: Any, t: FloatArray) -> FloatArray:
        """Return rows of ``SurfaceMotion`` at times (T,), with central differences as rates."""
        rows = np.zeros((len(t), 4))
        before, after = t - self._sample_time, t + self._sample_time
        over = 2.0 * self._sample_time
        if hasattr(reference, "tip"):
            rows[:, :2] = values_of(reference, "tip", t)[..., :2]
            rates = values_of(reference, "tip", after) - values_of(reference, "tip", before)
            normal = values_of(reference, "normal", t)
            rows[:, 2] = (normal[:, 0] * rates[:, 1] - normal[:, 1] * rates[:, 0]) / over
        force = values_of(reference, "contact_force", after)
        rows[:, 3] = (force - values_of(reference, "contact_force", before)) / over
        return rows
