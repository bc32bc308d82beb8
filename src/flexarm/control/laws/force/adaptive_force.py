"""Hybrid force control that adapts to the surface, and learns its shape with a network."""

from __future__ import annotations

import math
from typing import Any, ClassVar, cast

import numpy as np

from flexarm.control.contract.base import Arrays, FloatArray, Measurement, Reference
from flexarm.control.design.task_space import (
    NUMBERS,
    SurfaceMotion,
    SurfacePlan,
    TaskPlan,
    TaskReference,
)
from flexarm.control.laws.force.task_controller import HybridForce, TaskSample, TipLaw
from flexarm.model.drives.controllers import AdaptiveForceParameters, NeuralForceParameters

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
    """

    references: ClassVar[str] = "RoyWhitcomb2002"
    _shares: ClassVar[dict[str, float]] = {
        **HybridForce._shares,
        "adaptation": 0.32,
        "friction_adaptation": 0.16,
        "nominal_force": 0.25,
        "nominal_speed": 0.0066,
        "release_time": 0.32,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        self._rougher = TaskPlan(self.arm, self.sample_time)
        self._surface = SurfacePlan(self.sample_time)
        self._gains = np.full(self._terms, self.adaptation)
        # The force changes by the nominal one in a period of the arm.
        self._nominal_rate = self.nominal_force * self._scales.rate / (2.0 * math.pi)

    @property
    def _terms(self) -> int:
        """Number of estimated coefficients of the force normal to the surface."""
        return 2

    @property
    def _released(self) -> float:
        """Time without a force (s) from which on a longer one makes no difference."""
        return float(self.release_time) + self.sample_time

    def _slides(self, inputs: Arrays) -> bool:
        """Return whether the tip certainly slides; below this speed, static friction may hold."""
        return abs(surface_of(inputs).speed) >= float(_SLIDING * self.nominal_speed)

    @property
    def estimate(self) -> dict[str, float]:
        """Current estimates: ``stiffness_push`` and ``slope_push`` (N), and ``friction``.

        The first is the push at a force rate of ``nominal_force`` per 2 pi / w, with the rate w of
        the arm; the second that at ``nominal_speed``.
        """
        stiffness, slope = self.memory.get("estimate", np.zeros(2))[:2].tolist()
        friction = float(self.memory.get("friction", 0.0))
        return {"stiffness_push": stiffness, "slope_push": slope, "friction": friction}

    def reset(self) -> None:
        """Clear the memory and the reference."""
        super().reset()
        self._rougher.reset()
        self._surface.reset()

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the requests of the reference and of its ``rougher`` counterpart, if any."""
        inputs = dict(super().planned(t, reference))
        pressing: Any = reference
        inputs["reference_friction"] = getattr(pressing, "friction", 0.0)
        if hasattr(pressing, "contact_force"):
            inputs["surface"] = self._surface.along(t, pressing)
        rougher = getattr(pressing, "rougher", None)
        if rougher is not None:
            inputs["rougher_request"] = self._rougher.row(t, rougher)
            inputs["rougher_friction"] = rougher.friction
        return inputs

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        """See ``Controller.initial_memory``; ``unfelt`` is the time since a force was felt, s."""
        return {
            **super().initial_memory(readings, inputs),
            "estimate": np.zeros(self._terms),
            "friction": inputs["reference_friction"],
            "friction_rate": 0.0,
            "unfelt": self._released,
        }

    def _request(self, memory: Arrays, inputs: Arrays) -> TaskReference:
        """Return the request for the estimated friction, between those of both references."""
        row = inputs["request"]
        if "rougher_request" in inputs:
            given = inputs["reference_friction"]
            slope = (inputs["rougher_request"] - row) / (inputs["rougher_friction"] - given)
            row = row + (memory["friction"] - given) * slope
            rates = NUMBERS + self._task.joints
            row[2:4] += memory["friction_rate"] * slope[0:2]
            row[rates : rates + self._task.joints] += memory["friction_rate"] * slope[NUMBERS:rates]
        return self._plan.request(row)

    def _law(self, now: TaskSample) -> TipLaw:
        if now.request.force <= 0.0:
            now.memory["unfelt"], now.memory["friction_rate"] = self._released, 0.0
        return super()._law(now)

    def _touching(self, memory: dict[str, Any], felt: float, least: float) -> bool:
        """Return whether the tip is in contact: until ``release_time`` without a force."""
        unfelt = min(memory["unfelt"] + self.sample_time, self._released)
        memory["unfelt"] = 0.0 if felt >= least else unfelt
        return bool(memory["unfelt"] <= self.release_time)

    def _push(self, now: TaskSample, slip: float) -> float:
        """Return the force (N) to add to the reference's: (F.13)."""
        memory, push = now.memory, super()._push(now, slip)
        memory["friction_rate"] = 0.0
        if memory["unfelt"] > self.release_time:
            return push
        signals = self._signals(now.inputs)
        learned: float = memory["estimate"].dot(signals)
        push += learned
        if memory["unfelt"] > 0.0:
            return push
        self._adapt(now, signals, now.request.force - now.felt)
        if self._slides(now.inputs):
            self._rub(now)
        return push

    def _signals(self, inputs: Arrays) -> FloatArray:
        """Return the signals that the estimates multiply, relative to nominal values: (F.13)."""
        now = surface_of(inputs)
        signals = (now.force_rate / self._nominal_rate, now.speed / self.nominal_speed)
        return np.array([min(max(one, -_MOST_SIGNAL), _MOST_SIGNAL) for one in signals])

    def _adapt(self, now: TaskSample, signals: FloatArray, error: float) -> None:
        """Update the estimates with the force error (N): (F.14)."""
        added = now.memory["estimate"] + self.sample_time * error * self._gains * signals
        now.memory["estimate"] = np.clip(added, -self.nominal_force, self.nominal_force)

    def _rub(self, now: TaskSample) -> None:
        """Update the coefficient of friction of a tip that slides: (F.17)."""
        memory, request = now.memory, now.request
        x, y = now.readings.contact_force[0].tolist()
        along = request.normal_x * y - request.normal_y * x
        relative = now.felt / self.nominal_force
        sliding = surface_of(now.inputs).speed
        against = (-along if sliding > 0.0 else along) / self.nominal_force
        before = memory["friction"]
        rate = self.friction_adaptation * relative * (against - before * relative)
        memory["friction"] = min(max(before + self.sample_time * rate, 0.0), _MOST_FRICTION)
        memory["friction_rate"] = (memory["friction"] - before) / self.sample_time


def surface_of(inputs: Arrays) -> SurfaceMotion:
    """Return the requested motion along the surface, at rest without a surface."""
    return cast("SurfaceMotion", inputs.get("surface", _AT_REST))


class NeuralForce(NeuralForceParameters, AdaptiveForce):
    """Adaptive force control with a network that learns a surface of unknown shape.

    The network adds a push that depends on the requested position of the tip, and one that depends
    on the position and is proportional to the speed. Its signals are random Fourier features of the
    position (Rahimi and Recht 2007) in place of the coefficients of `AdaptiveForce`, which it
    contains. It learns from stroke to stroke. Theory page "control-force", (F.19) and (F.20).
    """

    references: ClassVar[str] = "RoyWhitcomb2002 RahimiRecht2007"
    _shares: ClassVar[dict[str, float]] = {
        **AdaptiveForce._shares,
        "learning": 1.9,
        "feature_length": 0.04,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        random = np.random.default_rng(self.seed)
        self._waves = random.normal(size=(self.features, 2)) / self.feature_length
        self._phases = random.uniform(0.0, 2.0 * np.pi, self.features)
        self._gains[2:] = self.learning

    @property
    def _terms(self) -> int:
        return 2 + 2 * self.features

    def _signals(self, inputs: Arrays) -> FloatArray:
        known, now = super()._signals(inputs), surface_of(inputs)
        place = self._waves[:, 0] * now.x + self._waves[:, 1] * now.y + self._phases
        network = np.sqrt(2.0 / self.features) * np.cos(place)
        moving = np.tanh(now.speed / self.nominal_speed)
        return np.concatenate([known, network, moving * network])

    def _adapt(self, now: TaskSample, signals: FloatArray, error: float) -> None:
        """Update the estimates; those of the network only while the tip slides."""
        estimate = now.memory["estimate"]
        if self._slides(now.inputs):
            decay = self.sample_time * (self.leakage + self.e_modification * abs(error))
            network = estimate[2:] * max(0.0, 1.0 - decay)
            now.memory["estimate"] = np.concatenate([estimate[:2], network])
        else:
            signals = np.concatenate([signals[:2], 0.0 * signals[2:]])
        super()._adapt(now, signals, error)
