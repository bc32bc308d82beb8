"""Hybrid control of the position along a surface and of the force normal to it."""

from __future__ import annotations

from typing import Any, ClassVar

from flexarm.control.contract.base import Arrays, Measurement
from flexarm.control.laws.force.task_controller import TaskController, TaskSample, TipLaw
from flexarm.model.drives.controllers import HybridForceParameters

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
