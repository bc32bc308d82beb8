"""Controllers of the tip and its force: hybrid, impedance, admittance and adaptive control."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.control.contract.base import (
    JOINTS,
    Arrays,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    Step,
)
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.design.arm_scales import arm_scales, check_sample_time, set_defaults, slow_rate
from flexarm.control.design.rigid_model import (
    NUMBERS,
    SurfaceMotion,
    SurfacePlan,
    TaskPlan,
    TaskReference,
    TaskSpace,
    TaskState,
)
from flexarm.model.drives.controllers import (
    AdaptiveForceParameters,
    AdmittanceParameters,
    HybridForceParameters,
    ImpedanceParameters,
    NeuralForceParameters,
)

#: Acceleration (m/s^2) of the tip of the rigid model, and force (N) on it, x and y of each.
TipLaw = tuple[tuple[float, float], tuple[float, float]]


class TaskSample(NamedTuple):
    """One sample of a controller of the tip; the memory is a copy that the law advances."""

    memory: dict[str, Any]
    inputs: Arrays
    request: TaskReference
    state: TaskState
    readings: Measurement

    @property
    def felt(self) -> float:
        """Measured force (N) of the first contact along the normal."""
        x, y = self.readings.contact_force[0].tolist()
        force: float = self.request.normal_x * x + self.request.normal_y * y
        return force


#: Turn of the force on a convex surface, relative to that of a stiff arm beside its path: links
#: bend along, which displaces the tip further than the joints show. It is enough for links that the
#: force deflects by half of the radius, (F.3a).
_TURNED = 2.0


class TaskController(OfArm, Controller):
    """Base of controllers of the tip of a rigid model in contact with a surface."""

    _unsupported = None

    exports_plan = True

    if TYPE_CHECKING:  # a parameter of every law
        delay: float

    _shares: ClassVar[dict[str, float]]
    """Defaults of parameters, relative to their typical sizes on the arm."""

    _frequency_name: ClassVar[str] = "frequency"
    """Name of the parameter that is the frequency of joint errors, rad/s."""

    def __post_init__(self) -> None:
        check_sample_time(self.arm, self.sample_time)
        rate = slow_rate(self.arm, self.sample_time, self.delay)
        self._scales = arm_scales(self.arm, rate)
        set_defaults(self, self._shares, self._scales)
        self._reads_force = True
        self._posture_frequency = getattr(self, self._frequency_name)
        self._task = TaskSpace(self.arm)
        self._plan = TaskPlan(self.arm, self.sample_time)

    def reset(self) -> None:
        """Clear the memory and the reference."""
        super().reset()
        self._plan.reset()

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """Return the requirements: a reference that presses needs a measured force."""
        presses = self._reads_force and hasattr(reference, "contact_force")
        measured = (*JOINTS, "contact_force") if presses else JOINTS
        return ControllerRequirements(self.arm.n_joints, measured)

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the requested motion and force at t (s), in the order of `TaskReference`."""
        return {"request": self._plan.row(t, reference)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after = dict(memory)
        angle, rate = readings.joint_angle, readings.joint_rate
        request = self._request(after, inputs)
        state = self._task.at(angle, rate)
        if not (request.normal_x or request.normal_y):
            # A motion without force: computed torque, regular at any posture.
            w = self._posture_frequency
            desired = request.acceleration + w * w * (request.angle - angle)
            desired += 2.0 * w * (request.rate - rate)
            torque: FloatArray = state.mass.dot(desired)
            torque += state.bias_torque
            torque += request.pressing
            return after, torque
        now = TaskSample(after, inputs, request, state, readings)
        acceleration, force = self._law(now)
        x, y = self._pressed(request, state)
        force = (force[0] + x, force[1] + y)
        posture = self._posture(request, angle, rate)
        return after, self._task.torque(state, acceleration, force, posture, request.pressing)

    def _request(self, memory: Arrays, inputs: Arrays) -> TaskReference:
        """Return the requested motion and force of a sample."""
        return self._plan.request(inputs["request"])

    def _pressed(self, request: TaskReference, state: TaskState) -> tuple[float, float]:
        """Return the requested force (N) on the surface where the tip is, x and y, (F.3).

        Beside its path the tip would otherwise be pushed further away: on a convex surface, and
        because the forces of constant torques turn with the arm.
        """
        (x, y), *_ = state.motion.tolist()
        nx, ny, force = request.normal_x, request.normal_y, request.force
        beside = nx * (y - request.y) - ny * (x - request.x)
        turned = _TURNED * max(0.0, request.curvature) * beside
        return force * (turned * ny - nx), -force * (turned * nx + ny)

    @abstractmethod
    def _law(self, now: TaskSample) -> TipLaw:
        """Return the acceleration and the force of a reference that presses on a surface."""

    def _posture(self, request: TaskReference, angle: FloatArray, rate: FloatArray) -> FloatArray:
        """Return joint accelerations (joints,), with posture control of more than two joints."""
        if self._task.joints < 3:
            return request.acceleration
        w = self._posture_frequency
        back: FloatArray = w * w * (request.angle - angle) + 2.0 * w * (request.rate - rate)
        return request.acceleration + back


#: Default of ``touch_force``, relative to the requested force.
_TOUCH = 0.1
#: Limit of the integral, relative to the requested force. It prevents windup without contact,
#: which would make the tip hit the surface.
_MOST_CORRECTION = 0.5


class HybridForce(HybridForceParameters, TaskController):
    """Position control along a surface, force control normal to it (Raibert and Craig 1981).

    Along the surface the tip of the rigid model follows the reference as a mass, a spring and a
    damper of ``frequency`` and ``damping_ratio``. Normal to it the torque presses with the force of
    the reference plus the integral of the force error, damped by ``normal_damping``. The reference
    (`pressed_motion`) supplies the torque that the bent arm needs to press at rest. Without contact
    the tip approaches the surface at ``approach_speed``. Theory page "control-force", (F.1) to
    (F.7).

    The controller measures ``joint_angle``, ``joint_rate`` and ``contact_force``, of which it uses
    the first contact. Where the force of the reference is 0, the tip follows it in all directions,
    also into a surface nearer than the path. If the reference has no force, or there is no
    reference, the joints follow the motion or keep their first angles with ``frequency``, and no
    force is measured.
    """

    _shares: ClassVar[dict[str, float]] = {
        "frequency": 1.25,
        "path_integral": 0.32,
        "force_integral": 1.6,
        "normal_damping": 16.0,
        "approach_speed": 0.0066,
    }

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        """Return the integrals of both errors, and whether the tip has touched the surface."""
        return {"integral": 0.0, "touched": False, "x_integral": 0.0, "y_integral": 0.0}

    def _law(self, now: TaskSample) -> TipLaw:
        memory, request = now.memory, now.request
        nx, ny = request.normal_x, request.normal_y
        (x, y), (x_rate, y_rate), _ = now.state.motion.tolist()
        spring = self.frequency * self.frequency
        damper = 2.0 * self.damping_ratio * self.frequency
        x_slip, y_slip = request.x_rate - x_rate, request.y_rate - y_rate
        x_off, y_off = request.x - x, request.y - y
        if request.force > 0.0:
            # Remove the normal component of the position error, which the force control replaces.
            across = nx * x_off + ny * y_off
            x_off, y_off = x_off - across * nx, y_off - across * ny
        x_pull = spring * (x_off + memory["x_integral"]) + damper * x_slip
        y_pull = spring * (y_off + memory["y_integral"]) + damper * y_slip
        if request.force <= 0.0:
            memory["integral"], memory["touched"] = 0.0, False
            return (request.x_acceleration + x_pull, request.y_acceleration + y_pull), (0.0, 0.0)
        across = nx * x_pull + ny * y_pull
        gain = self.path_integral * self.sample_time
        memory["x_integral"] += gain * x_off
        memory["y_integral"] += gain * y_off
        push = self._push(now, nx * x_slip + ny * y_slip)
        acceleration = (
            request.x_acceleration + x_pull - across * nx,
            request.y_acceleration + y_pull - across * ny,
        )
        return acceleration, (-push * nx, -push * ny)

    def _push(self, now: TaskSample, slip: float) -> float:
        """Return the force (N) to add to the reference's: (F.5) in contact, (F.6) without."""
        memory, request = now.memory, now.request
        felt, against = now.felt, -self.normal_damping * slip
        error, limit = request.force - felt, _MOST_CORRECTION * request.force
        least = _TOUCH * request.force if self.touch_force is None else self.touch_force
        touching = self._touching(memory, felt, least)
        memory["touched"] = memory["touched"] or touching
        push: float = self.force_proportional * error + memory["integral"] + against
        if memory["touched"]:
            # Integrate without contact as well, so that a bouncing tip has the correct mean force.
            added = memory["integral"] + self.force_integral * self.sample_time * error
            memory["integral"] = min(max(added, -limit), limit)
        if touching:
            return push
        approach: float = self.normal_damping * self.approach_speed
        closing: float = against + min(0.0, approach - request.force)
        return closing

    def _touching(self, memory: dict[str, Any], felt: float, least: float) -> bool:
        """Return whether a measured force (N) is a contact, which has at least ``least``."""
        return felt >= least


class Impedance(ImpedanceParameters, TaskController):
    """Stiffness and damping of the tip, along a surface and normal to it (Hogan 1985).

    Springs and dampers act between the tip of the rigid model and the reference, in addition to the
    torques of the rigid model along it. The inertia is that of the arm. A reference that presses
    (`pressed_motion`) has joint angles that place the tip of the rigid model behind the surface, so
    that the spring presses on it. Without force feedback, errors in the position of the surface and
    in the stiffness of the links cause force errors: (F.9). ``force_integral`` moves the end of the
    spring until the measured force is correct. Theory page "control-force", (F.8) and (F.9).

    The controller measures ``joint_angle`` and ``joint_rate``, and also ``contact_force``, of which
    it uses the first contact, if a force gain is not zero and the reference has a force. If the
    reference has no force, or there is no reference, the joints follow the motion or keep their
    first angles with ``posture_frequency``.
    """

    _shares: ClassVar[dict[str, float]] = {
        "tangent_stiffness": 7.6,
        "tangent_damping": 6.4,
        "normal_stiffness": 2.5,
        "normal_damping": 8.0,
        "posture_frequency": 0.8,
    }
    _frequency_name = "posture_frequency"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._reads_force = self.force_proportional > 0.0 or self.force_integral > 0.0

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {"integral": 0.0}

    def _law(self, now: TaskSample) -> TipLaw:
        memory, request = now.memory, now.request
        nx, ny = request.normal_x, request.normal_y
        (x, y), (x_rate, y_rate), _ = now.state.motion.tolist()
        x, y = request.x - x, request.y - y
        x_rate, y_rate = request.x_rate - x_rate, request.y_rate - y_rate
        # Apply the tangential gains in all directions, and add the difference along the normal.
        k, d = self.tangent_stiffness, self.tangent_damping
        across = (self.normal_stiffness - k) * (nx * x + ny * y)
        across += (self.normal_damping - d) * (nx * x_rate + ny * y_rate)
        if self._reads_force:
            error = request.force - now.felt
            across -= self.force_proportional * error + memory["integral"]
            memory["integral"] += self.force_integral * self.sample_time * error
        force = (k * x + d * x_rate + across * nx, k * y + d * y_rate + across * ny)
        return (request.x_acceleration, request.y_acceleration), force


class Admittance(AdmittanceParameters, TaskController):
    """Position loop whose reference yields to the force error like a spring and a damper.

    The reference moves away from the surface by y with ``damping`` y' + ``stiffness`` y = measured
    force - force of the reference. The tip of the rigid model follows it as a mass, a spring and a
    damper of ``frequency`` and ``damping_ratio``. Without stiffness the force has no steady-state
    error: (F.12). Theory page "control-force", (F.10) to (F.12).

    The controller measures ``joint_angle``, ``joint_rate`` and ``contact_force``, of which it uses
    the first contact. If the reference has no force, or there is no reference, the joints follow
    the motion or keep their first angles with ``frequency``, and no force is measured.
    """

    _shares: ClassVar[dict[str, float]] = {
        "damping": 120.0,
        "frequency": 1.25,
        "most_speed": 0.0066,
    }

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        """Return the displacement of the reference y, m."""
        return {"away": 0.0}

    def _law(self, now: TaskSample) -> TipLaw:
        memory, request = now.memory, now.request
        nx, ny = request.normal_x, request.normal_y
        (x, y), (x_rate, y_rate), _ = now.state.motion.tolist()
        spring = self.frequency * self.frequency
        damper = 2.0 * self.damping_ratio * self.frequency
        away = memory["away"]
        force = now.felt - request.force - self.stiffness * away
        speed = min(max(force / self.damping, -self.most_speed), self.most_speed)
        across = spring * away + damper * speed
        memory["away"] = away + speed * self.sample_time
        x_pull = spring * (request.x - x) + damper * (request.x_rate - x_rate)
        y_pull = spring * (request.y - y) + damper * (request.y_rate - y_rate)
        acceleration = (
            request.x_acceleration + x_pull + across * nx,
            request.y_acceleration + y_pull + across * ny,
        )
        return acceleration, (0.0, 0.0)


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
        friction = {"friction": inputs["reference_friction"], "friction_rate": 0.0}
        memory = {"estimate": np.zeros(self._terms), **friction, "unfelt": self._released}
        return {**super().initial_memory(readings, inputs), **memory}

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
