"""Impedance control: stiffness and damping of the tip about its path."""

from __future__ import annotations

from flexarm.arguments import check_kind
from flexarm.arm import Arm
from flexarm.control.base import FloatArray, Measurement, Reference
from flexarm.control.gains import Gains
from flexarm.controllers.task_controller import TaskController, felt_force


class Impedance(TaskController):
    """Stiffness and damping of the tip, along a surface and normal to it (Hogan 1985).

    Springs and dampers act between the tip of the rigid model and the reference, in addition to the
    torques of the rigid model along it. The inertia is that of the arm. A reference that presses
    (`pressed_motion`) has joint angles that place the tip of the rigid model behind the surface, so
    that the spring presses on it. Without force feedback, errors in the position of the surface and
    in the stiffness of the links cause force errors: (F.9). ``force_integral`` moves the end of the
    spring until the measured force is correct. Theory page "control-force", (F.8) and (F.9).

    Args:
        arm: model of the arm.
        tangent_stiffness: N/m along the surface.
        tangent_damping: N s/m along the surface.
        normal_stiffness: N/m normal to the surface.
        normal_damping: N s/m normal to the surface.
        force_proportional: proportional gain of the force error.
        force_integral: 1/s, integral gain of the force error.
        posture_frequency: rad/s, natural frequency of the posture error of arms with more than two
            joints, and of all joint errors along a reference without force.
        sample_time: s.

    The controller measures ``joint_angle`` and ``joint_rate``, and also ``contact_force``, of which
    it uses the first contact, if a force gain is not zero and the reference has a force. If the
    reference has no force, or there is no reference, the joints follow the motion or keep their
    first angles with ``posture_frequency``.

    Raises:
        InputError: if a gain is negative or not finite, or the sample time is not positive.
    """

    name = "impedance"
    memory = ("_sum",)

    def __init__(
        self,
        arm: Arm,
        tangent_stiffness: float = 60.0,
        tangent_damping: float = 8.0,
        normal_stiffness: float = 20.0,
        normal_damping: float = 10.0,
        force_proportional: float = 0.0,
        force_integral: float = 0.0,
        posture_frequency: float = 5.0,
        sample_time: float = 1e-3,
    ) -> None:
        arm, gains = check_kind("Impedance", "arm", arm, Arm), Gains("Impedance")
        self.tangent_stiffness = gains.one("tangent_stiffness", tangent_stiffness)
        self.tangent_damping = gains.one("tangent_damping", tangent_damping)
        self.normal_stiffness = gains.one("normal_stiffness", normal_stiffness)
        self.normal_damping = gains.one("normal_damping", normal_damping)
        self.force_proportional = gains.one("force_proportional", force_proportional)
        self.force_integral = gains.one("force_integral", force_integral)
        self.posture_frequency = gains.one("posture_frequency", posture_frequency)
        sample_time = gains.one("sample_time", sample_time, positive=True)
        gains.done()
        super().__init__(arm, sample_time, self.posture_frequency)
        self._reads_force = self.force_proportional > 0.0 or self.force_integral > 0.0
        self._sum = 0.0

    def reset(self) -> None:
        """Clear the integral of the force error, and the reference."""
        super().reset()
        self._sum = 0.0

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        angle, rate = measurement.joint_angle, measurement.joint_rate
        asked = self._plan.at(t, angle, reference)
        state = self._task.at(angle, rate)
        nx, ny = asked.normal_x, asked.normal_y
        if not (nx or ny):
            return self._joints_follow(asked, state, angle, rate)
        (x, y), (x_rate, y_rate), _ = state.motion.tolist()
        x, y, x_rate, y_rate = (
            asked.x - x,
            asked.y - y,
            asked.x_rate - x_rate,
            asked.y_rate - y_rate,
        )
        # Apply the tangential gains in all directions, and add the difference along the normal.
        k, d = self.tangent_stiffness, self.tangent_damping
        across = (self.normal_stiffness - k) * (nx * x + ny * y)
        across += (self.normal_damping - d) * (nx * x_rate + ny * y_rate)
        if self._reads_force:
            error = asked.force - felt_force(asked, measurement)
            across -= self.force_proportional * error + self._sum
            self._sum += self.force_integral * self.sample_time * error
        return self._task.torque(
            state,
            (asked.x_acceleration, asked.y_acceleration),
            (k * x + d * x_rate + across * nx, k * y + d * y_rate + across * ny),
            self._posture(asked, angle, rate),
            asked.pressing,
        )
