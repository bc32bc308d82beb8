"""Impedance control: stiffness and damping of the tip about its path."""

from __future__ import annotations

from typing import ClassVar

from flexarm.control.contract.base import Arrays, Measurement
from flexarm.control.laws.force.task_controller import TaskController, TaskSample, TipLaw
from flexarm.model.drives.controllers import ImpedanceParameters


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
