"""Adaptive control after Slotine and Li, with the rigid model of the arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_each
from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.contract.base import Arrays, Measurement, Step
from flexarm.control.design.rigid_model import RigidParameters, parameter_names
from flexarm.control.laws.uncertain.sliding_mode import SlidingController
from flexarm.kernels.controller_terms.adaptation import adaptive_torque
from flexarm.model.drives.controllers import AdaptiveParameters
from flexarm.model.wording import nearest


class Adaptive(AdaptiveParameters, SlidingController):
    """Computed torque of a rigid model with adapted parameters; (C.40) to (C.46).

    Slotine and Li, On the adaptive control of robot manipulators, Int. J. Robotics Research 6(3),
    1987. ``torque = Y a - damping s``, with Y the regressor of the rigid model, and
    ``a' = -adaptation Y' s - leakage (a - initial)``, clipped to the bounds.

    Raises:
        InputError: if a name is unknown, a number is negative or not finite, or a lower bound
            exceeds the upper one.
    """

    _law = staticmethod(adaptive_torque)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.parameters = _listed(self.arm, self.parameters)
        self._model = RigidParameters(self.arm, self.parameters, self._sliding.smoothing_rate)
        if not self.parameters:
            raise InputError(Problem("parameters", "name at least one", "[]"))
        bounds, initial = self.bounds or {}, self.initial or {}
        self._check_names(bounds=bounds, initial=initial)
        count = len(self.parameters)
        gains = check_each("adaptation", self.adaptation, count)
        self.adaptation = np.full(count, gains)
        own = dict(zip(self.parameters, self._model.values, strict=True))
        start = [initial.get(name, own[name]) for name in self.parameters]
        limits = np.array([bounds.get(name, (0.0, np.inf)) for name in self.parameters])
        self._lower, self._upper = limits.T.copy()
        self._start = np.clip(start, self._lower, self._upper)

    def _check_names(self, **given: Mapping[str, Any]) -> None:
        rule = f"be names from {', '.join(self.parameters)}"
        problems = [
            Problem(argument, rule, shown(name), nearest(name, self.parameters))
            for argument, named in given.items()
            for name in named
            if name not in self.parameters
        ]
        if problems:
            raise InputError(*problems)

    @property
    def estimate(self) -> dict[str, float]:
        """Current estimate of each parameter."""
        now = self.memory.get("estimate", self._start)
        return dict(zip(self.parameters, now.tolist(), strict=True))

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {"estimate": self._start, **super().initial_memory(readings, inputs)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after, now = self._sliding.at(memory, readings, inputs)
        estimate, torque = memory["estimate"].copy(), np.zeros_like(now.s)
        columns = self._model.regressor(
            now.angle, now.rate, now.reference_rate, now.reference_acceleration
        )
        self._law(
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
            estimate,
            torque,
        )
        return {"estimate": estimate, **after}, torque


def _listed(arm: Arm, parameters: str | Sequence[str]) -> tuple[str, ...]:
    groups = {
        "payload": ("payload.mass",),
        "links": tuple(n for n in parameter_names(arm) if n.startswith("link_")),
        "friction": tuple(n for n in parameter_names(arm) if n.startswith("joint_")),
    }
    listed = [parameters] if isinstance(parameters, str) else parameters
    return tuple(name for item in listed for name in groups.get(item, (item,)))
