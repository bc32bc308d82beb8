"""What controllers of the joint angles share: where the joints should be, and a torque added."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import ArrayLike

from flexarm.control.base import Controller, FloatArray, Measurement, Reference
from flexarm.control.feedforward import SampledFeedforward
from flexarm.errors import InputError, Problem, shown


class JointFollower(Controller):
    """Base of controllers that follow a reference; without one, they hold the first angles.

    A subclass sets ``sample_time`` and ``feedforward``.
    """

    feedforward: Callable[[float], ArrayLike] | None

    def __init__(self) -> None:
        self._held: FloatArray | None = None
        self._ahead: SampledFeedforward | None = None

    def reset(self) -> None:
        """Forget the angles held."""
        self._held = None
        self._ahead = None

    def _wanted(
        self, t: float, measurement: Measurement, reference: Reference | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return the angles (rad) and rates (rad/s) to be at."""
        if reference is not None:
            return reference.joint_angle(t), reference.joint_rate(t)
        if self._held is None:
            self._held = measurement.joint_angle.copy()
        return self._held, 0.0 * self._held

    def _fed_forward(self, t: float) -> FloatArray:
        """Return the torque of ``feedforward`` for the time from t to the next sample, N m.

        Held, it stands best for the middle of that time: half a sample late it would be a
        disturbance, and the largest one where the model is good.
        """
        assert self.feedforward is not None
        if self._ahead is None:
            later = 0.5 * self.sample_time
            self._ahead = SampledFeedforward(self.feedforward, self.sample_time, later)
        return self._ahead(t)


def check_feedforward(where: str, value: object) -> None:
    """Refuse what cannot be called.

    Raises:
        InputError: so it is.
    """
    if value is not None and not callable(value):
        rule = "be a function of time that gives torques, or None"
        raise InputError(Problem(where, "feedforward", rule, shown(value)))
