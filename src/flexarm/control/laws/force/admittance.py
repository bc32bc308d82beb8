"""Admittance control: the force error moves the reference of a stiff position loop."""

from __future__ import annotations

from typing import ClassVar

from flexarm.control.contract.base import Arrays, Measurement
from flexarm.control.laws.force.task_controller import TaskController, TaskSample, TipLaw
from flexarm.model.drives.controllers import AdmittanceParameters


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
