"""Adaptive control after Slotine and Li, with the rigid model of the arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_kind, check_list_of
from flexarm.arm import Arm
from flexarm.control.base import Controller, FloatArray, Measurement, Needs, Reference
from flexarm.control.gains import Gains
from flexarm.control_design.rigid_parameters import RigidParameters, parameter_names
from flexarm.controllers.sliding import SlidingVariable
from flexarm.kernels.adaptation import adaptive_torque


class Adaptive(Controller):
    """Computed torque of a rigid model with adapted parameters; (C.40) to (C.46).

    Slotine and Li, On the adaptive control of robot manipulators, Int. J. Robotics Research 6(3),
    1987. ``torque = Y a - damping s``, with Y the regressor of the rigid model, and
    ``a' = -adaptation Y' s - leakage (a - initial)``, clipped to the bounds.

    Args:
        arm: model of the arm; its parameters are the initial estimates.
        bandwidth: 1/s, one number or one per joint: decay rate of angle errors on s = 0.
        damping: N m s/rad, one number or one per joint: gain of s.
        adaptation: adaptation gains, one number or one for each parameter, in the unit of the
            parameter squared per (N m rad).
        parameters: parameters to adapt: "payload" (its mass), "links" (mass, first moment and
            inertia of each), "friction" (viscous and Coulomb of each joint), or a list of names
            such as "payload.mass", "link_2.inertia", "joint_1.coulomb".
        bounds: mapping from names to (lowest, largest) values; parameters without bounds are at
            least 0.
        initial: mapping from names to initial estimates that replace the values of the arm.
        leakage: 1/s, decay rate of the estimates to their initial values (sigma modification).
        dead_zone: rad/s, norm of s below which the estimates are constant.
        strain_gain: rad/s per 1/m, one number or one per joint: feedback of the curvature at the
            root of the joint's link to the reference rate, which damps vibration; requires a gauge
            on that link.
        washout: Hz, cutoff of the high-pass filter of the curvature.
        sample_time: s.

    Raises:
        InputError: if a name is unknown, a number is negative or not finite, or a lower bound
            exceeds the upper one.
    """

    name = "adaptive"
    memory = ("_estimate", "_sliding._slow", "_sliding._fast")

    def __init__(
        self,
        arm: Arm,
        bandwidth: ArrayLike,
        damping: ArrayLike,
        adaptation: ArrayLike,
        parameters: str | Sequence[str] = "payload",
        bounds: Mapping[str, tuple[float, float]] | None = None,
        initial: Mapping[str, float] | None = None,
        leakage: float = 0.0,
        dead_zone: float = 0.0,
        strain_gain: ArrayLike = 0.0,
        washout: float = 0.5,
        sample_time: float = 1e-3,
    ) -> None:
        self.arm = check_kind("Adaptive", "arm", arm, Arm)
        self.parameters = _listed(arm, parameters)
        self._model = RigidParameters("Adaptive", arm, self.parameters)
        gains = Gains("Adaptive")
        self._sliding = SlidingVariable(gains, arm, bandwidth, strain_gain, washout)
        self.bandwidth, self.strain_gain = self._sliding.bandwidth, self._sliding.strain_gain
        self.washout = self._sliding.washout
        self.damping = gains.each("damping", damping, arm.joints)
        count = len(self.parameters)
        if not count:
            gains.refuse("parameters", "name at least one", parameters)
        self.adaptation = gains.each("adaptation", adaptation, count, what="parameter")
        self.leakage = gains.one("leakage", leakage)
        self.dead_zone = gains.one("dead_zone", dead_zone)
        self.sample_time = gains.one("sample_time", sample_time, positive=True)
        self.bounds = gains.mapping("bounds", bounds)
        self.initial = gains.mapping("initial", initial)
        gains.known("bounds", self.bounds, self.parameters)
        gains.known("initial", self.initial, self.parameters)
        gains.done()
        self._start, self._lower, self._upper = self._limits(gains)
        gains.done()
        self._estimate = self._start.copy()
        self._torque = np.zeros(arm.joints)

    def _limits(self, gains: Gains) -> tuple[FloatArray, FloatArray, FloatArray]:
        start = self._model.values.copy()
        lower, upper = np.zeros_like(start), np.full_like(start, np.inf)
        for k, name in enumerate(self.parameters):
            start[k] = gains.one(f"initial of {name}", self.initial.get(name, start[k]))
            if name in self.bounds:
                lower[k], upper[k] = gains.range(f"bounds of {name}", self.bounds[name])
            start[k] = np.clip(start[k], lower[k], upper[k])
        return start, lower, upper

    @property
    def estimate(self) -> dict[str, float]:
        """Current estimate of each parameter."""
        return dict(zip(self.parameters, self._estimate.tolist(), strict=True))

    def reset(self) -> None:
        """Reset the estimates to their initial values."""
        self._estimate[:] = self._start
        self._sliding.reset(self.sample_time)

    def needs(self, arm: Arm, reference: Reference | None) -> Needs:
        """See ``Controller.needs``."""
        return self._sliding.needs(self.arm)

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        now = self._sliding
        now.take(t, measurement, reference)
        columns = self._model.regressor(
            now.angle, now.rate, now.reference_rate, now.reference_acceleration
        )
        adaptive_torque(
            columns,
            self._model.known,
            now.s,
            self.damping,
            self.adaptation,
            self.leakage,
            self.dead_zone,
            self._start,
            self._lower,
            self._upper,
            self.sample_time,
            self._estimate,
            self._torque,
        )
        return self._torque.copy()


def _listed(arm: Arm, parameters: str | Sequence[str]) -> tuple[str, ...]:
    groups = {
        "payload": ("payload.mass",),
        "links": tuple(n for n in parameter_names(arm) if n.startswith("link_")),
        "friction": tuple(n for n in parameter_names(arm) if n.startswith("joint_")),
    }
    asked = [parameters] if isinstance(parameters, str) else parameters
    listed = check_list_of("Adaptive", "parameters", asked, str)
    return tuple(name for item in listed for name in groups.get(item, (item,)))
