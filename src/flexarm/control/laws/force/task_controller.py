"""Controllers of the tip and its contact force: hybrid, impedance and admittance control."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar, NamedTuple

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
from flexarm.control.design.arm_scales import arm_scales, set_defaults, slow_rate
from flexarm.control.design.task_space import TaskPlan, TaskReference, TaskSpace, TaskState
from flexarm.model.drives.controllers import (
    AdmittanceParameters,
    HybridForceParameters,
    ImpedanceParameters,
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


class TaskController(OfArm, Controller):
    """Base of controllers of the tip of a rigid model in contact with a surface."""

    _shares: ClassVar[dict[str, float]]
    """Defaults of parameters, relative to their typical sizes on the arm."""

    def __post_init__(self) -> None:
        self._scales = arm_scales(self.arm, slow_rate(self.arm, self.sample_time))
        set_defaults(self, self._shares, self._scales)
        self._reads_force = True
        self._posture_frequency = 0.0  # of joint errors, rad/s; a subclass sets it
        self._task = TaskSpace(self.arm)
        self._plan = TaskPlan(self.arm, self.sample_time)

    def reset(self) -> None:
        """Clear the memory and the reference."""
        super().reset()
        self._plan.reset()

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """Return the requirements: a reference that presses needs a measured force."""
        presses = self._reads_force and hasattr(reference, "contact_force")
        return ControllerRequirements(
            self.arm.joints, (*JOINTS, "contact_force") if presses else JOINTS
        )

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the requested motion and force at t (s), in the order of `TaskReference`."""
        return {"request": self._plan.row(t, reference)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        after = dict(memory)
        angle, rate = readings.joint_angle, readings.joint_rate
        request = self._request(after, inputs)
        state = self._task.at(angle, rate)
        if not (request.normal_x or request.normal_y):
            return after, self._joints_follow(request, state, angle, rate)
        now = TaskSample(after, inputs, request, state, readings)
        acceleration, force = self._law(now)
        posture = self._posture(request, angle, rate)
        return after, self._task.torque(state, acceleration, force, posture, request.pressing)

    def _request(self, memory: Arrays, inputs: Arrays) -> TaskReference:
        """Return the requested motion and force of a sample."""
        return self._plan.request(inputs["request"])

    @abstractmethod
    def _law(self, now: TaskSample) -> TipLaw:
        """Return the acceleration and the force of a reference that presses on a surface."""

    def _joints_follow(
        self, request: TaskReference, state: TaskState, angle: FloatArray, rate: FloatArray
    ) -> FloatArray:
        """Return the torque of a motion without force: computed torque, regular at any posture."""
        w = self._posture_frequency
        desired = request.acceleration + w * w * (request.angle - angle)
        desired += 2.0 * w * (request.rate - rate)
        torque: FloatArray = state.mass.dot(desired)
        torque += state.bias_torque
        torque += request.pressing
        return torque

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

    def __post_init__(self) -> None:
        super().__post_init__()
        self._posture_frequency = self.frequency

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
        if request.force <= 0.0:
            memory["integral"], memory["touched"] = 0.0, False
            x_pull = spring * (x_off + memory["x_integral"]) + damper * x_slip
            y_pull = spring * (y_off + memory["y_integral"]) + damper * y_slip
            free = (request.x_acceleration + x_pull, request.y_acceleration + y_pull)
            return free, (0.0, 0.0)
        # Remove the normal component of the position error, which the force control replaces.
        across = nx * x_off + ny * y_off
        x_off, y_off = x_off - across * nx, y_off - across * ny
        x_pull = spring * (x_off + memory["x_integral"]) + damper * x_slip
        y_pull = spring * (y_off + memory["y_integral"]) + damper * y_slip
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

    def __post_init__(self) -> None:
        super().__post_init__()
        self._posture_frequency = self.posture_frequency
        self._reads_force = self.force_proportional > 0.0 or self.force_integral > 0.0

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {"integral": 0.0}

    def _law(self, now: TaskSample) -> TipLaw:
        memory, request = now.memory, now.request
        nx, ny = request.normal_x, request.normal_y
        (x, y), (x_rate, y_rate), _ = now.state.motion.tolist()
        x, y, x_rate, y_rate = (
            request.x - x,
            request.y - y,
            request.x_rate - x_rate,
            request.y_rate - y_rate,
        )
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

    def __post_init__(self) -> None:
        super().__post_init__()
        self._posture_frequency = self.frequency

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
