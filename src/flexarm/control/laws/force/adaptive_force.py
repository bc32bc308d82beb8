"""Hybrid force control that adapts to the surface."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from flexarm.control.contract.base import FloatArray, Measurement, Reference
from flexarm.control.design.surface_plan import SurfaceMotion, SurfacePlan
from flexarm.control.design.task_plan import TaskReference
from flexarm.control.design.task_space import TaskState
from flexarm.control.laws.force.hybrid_force import HybridForce
from flexarm.control.laws.force.task_controller import felt_force
from flexarm.model.drives.force import AdaptiveForceParameters

#: Largest coefficient of friction that is estimated.
_MOST_FRICTION = 2.0
#: Largest force rate and speed that the law uses, relative to the nominal ones. It bounds the push
#: and the adaptation where the requested force jumps.
_MOST_SIGNAL = 5.0
#: Fraction of the nominal speed above which the tip counts as sliding.
_SLIDING = 0.8
_AT_REST = SurfaceMotion(0.0, 0.0, 0.0, 0.0)


class AdaptiveForce(AdaptiveForceParameters, HybridForce):
    """Hybrid control that adapts to stiffness, position and friction of the surface.

    Normal to the surface it adds ``estimate`` times the requested force rate and speed to the push
    of `HybridForce`: their coefficients are the unknown stiffness and slope of the surface. The
    estimates follow the force error times these signals, so that a Lyapunov function decreases
    (after Roy and Whitcomb 2002). The friction is estimated from both components of the
    measured force, and moves the request between the reference and its ``rougher`` counterpart.
    Where the reference has no force, the tip follows it in free motion, so that it approaches the
    surface and leaves it. Theory page "control-force", (F.13) to (F.18).

    The controller measures ``joint_angle``, ``joint_rate`` and ``contact_force``, of which it uses
    the first contact.

    Raises:
        InputError: if a gain is negative or not finite, or frequency, speeds, nominal force or
            sample time are not positive.
    """

    references: ClassVar[str] = "RoyWhitcomb2002"
    memory = (  # type: ignore[assignment]
        *HybridForce.memory,
        "_estimate",
        "_friction",
        "_friction_rate",
        "_unfelt",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self._surface = SurfacePlan(self.arm, self.sample_time)
        self._gains = np.full(self._terms, self.adaptation)
        self._clear()

    def _clear(self) -> None:
        self._estimate = np.zeros(self._terms)
        self._friction: float | None = None
        self._friction_rate = 0.0
        self._now = _AT_REST
        self._unfelt = self._released  # time since a force was measured, s

    @property
    def _terms(self) -> int:
        """Number of estimated coefficients of the force normal to the surface."""
        return 2

    @property
    def _released(self) -> float:
        """Time without a force (s) from which on a longer one makes no difference."""
        return self.release_time + self.sample_time

    @property
    def _slides(self) -> bool:
        """Whether the tip certainly slides; below this speed, static friction may hold it."""
        return abs(self._now.speed) >= _SLIDING * self.nominal_speed

    @property
    def estimate(self) -> dict[str, float]:
        """Current estimates: ``stiffness_push`` and ``slope_push`` (N), and ``friction``.

        The first two are the pushes at ``nominal_force`` per second and ``nominal_speed``.
        """
        stiffness, slope = self._estimate[:2].tolist()
        friction = 0.0 if self._friction is None else self._friction
        return {"stiffness_push": stiffness, "slope_push": slope, "friction": friction}

    def reset(self) -> None:
        """Clear the estimates, the integrals of both errors, and the reference."""
        super().reset()
        self._surface.reset()
        self._clear()

    def _request(self, t: float, angle: FloatArray, reference: Reference | None) -> TaskReference:
        if self._friction is None:
            self._friction = getattr(reference, "friction", 0.0)
        if reference is not None and hasattr(reference, "contact_force"):
            self._now = self._surface.along(t, reference)
        return self._surface.at(t, angle, reference, self._friction, self._friction_rate)

    def _law(
        self, request: TaskReference, state: TaskState, measurement: Measurement
    ) -> tuple[tuple[float, float], tuple[float, float]]:
        if request.force <= 0.0:
            self._unfelt, self._friction_rate = self._released, 0.0
        return super()._law(request, state, measurement)

    def _touching(self, felt: float) -> bool:
        """Return whether the tip is in contact: until ``release_time`` without a force."""
        unfelt = min(self._unfelt + self.sample_time, self._released)
        self._unfelt = 0.0 if felt >= self.touch_force else unfelt
        return self._unfelt <= self.release_time

    def _push(self, request: TaskReference, measurement: Measurement, slip: float) -> float:
        """Return the force (N) to add to the reference's: (F.13)."""
        push = super()._push(request, measurement, slip)
        self._friction_rate = 0.0
        if self._unfelt > self.release_time:
            return push
        signals = self._signals()
        learned: float = self._estimate.dot(signals)
        push += learned
        if self._unfelt > 0.0:
            return push
        felt = felt_force(request, measurement)
        self._adapt(signals, request.force - felt)
        self._rub(request, measurement, felt)
        return push

    def _signals(self) -> FloatArray:
        """Return the signals that the estimates multiply, relative to nominal values: (F.13)."""
        now = self._now
        signals = (now.force_rate / self.nominal_force, now.speed / self.nominal_speed)
        return np.array([min(max(one, -_MOST_SIGNAL), _MOST_SIGNAL) for one in signals])

    def _adapt(self, signals: FloatArray, error: float) -> None:
        """Update the estimates with the force error (N): (F.14)."""
        added = self._estimate + self.sample_time * error * self._gains * signals
        self._estimate = np.clip(added, -self.nominal_force, self.nominal_force)

    def _rub(self, request: TaskReference, measurement: Measurement, felt: float) -> None:
        """Update the coefficient of friction while the tip slides: (F.17)."""
        if not self._slides or self._friction is None:
            return
        x, y = measurement.contact_force[0].tolist()
        along = request.normal_x * y - request.normal_y * x
        relative = felt / self.nominal_force
        against = (-along if self._now.speed > 0.0 else along) / self.nominal_force
        rate = self.friction_adaptation * relative * (against - self._friction * relative)
        before = self._friction
        self._friction = min(max(before + self.sample_time * rate, 0.0), _MOST_FRICTION)
        self._friction_rate = (self._friction - before) / self.sample_time
