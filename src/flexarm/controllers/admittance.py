"""Admittance control: the force error moves the reference of a stiff position loop."""

from __future__ import annotations

from flexarm.arguments import check_kind
from flexarm.arm import Arm
from flexarm.control.base import FloatArray, Measurement, Reference
from flexarm.control.gains import Gains
from flexarm.controllers.task_controller import TaskController, felt_force


class Admittance(TaskController):
    """Position loop whose reference yields to the force error like a spring and a damper.

    The reference moves away from the surface by y with ``damping`` y' + ``stiffness`` y = measured
    force - force of the reference. The tip of the rigid model follows it as a mass, a spring and a
    damper of ``frequency`` and ``damping_ratio``. Without stiffness the force has no steady-state
    error: (F.12). Theory page "control-force", (F.10) to (F.12).

    Args:
        arm: model of the arm.
        damping: N s/m. The bandwidth is the stiffness of surface and arm in series over it.
        stiffness: N/m, of the spring that moves y back to zero.
        frequency: rad/s, natural frequency of the position loop.
        damping_ratio: damping ratio of the position loop.
        most_speed: m/s, limit of y', and so of the speed of approach without contact.
        sample_time: s.

    The controller measures ``joint_angle``, ``joint_rate`` and ``contact_force``, of which it uses
    the first contact. If the reference has no force, or there is no reference, the joints follow
    the motion or keep their first angles with ``frequency``, and no force is measured.

    Raises:
        InputError: if a gain is negative or not finite, or damping, frequency, speed or sample time
            are not positive.
    """

    name = "admittance"
    memory = ("_away",)

    def __init__(
        self,
        arm: Arm,
        damping: float = 150.0,
        stiffness: float = 0.0,
        frequency: float = 8.0,
        damping_ratio: float = 0.7,
        most_speed: float = 0.1,
        sample_time: float = 1e-3,
    ) -> None:
        arm, gains = check_kind("Admittance", "arm", arm, Arm), Gains("Admittance")
        self.damping = gains.one("damping", damping, positive=True)
        self.stiffness = gains.one("stiffness", stiffness)
        self.frequency = gains.one("frequency", frequency, positive=True)
        self.damping_ratio = gains.one("damping_ratio", damping_ratio)
        self.most_speed = gains.one("most_speed", most_speed, positive=True)
        sample_time = gains.one("sample_time", sample_time, positive=True)
        gains.done()
        super().__init__(arm, sample_time, self.frequency)
        self._away = 0.0  # y, m

    def reset(self) -> None:
        """Clear the displacement of the reference, and the reference."""
        super().reset()
        self._away = 0.0

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        angle, rate = measurement.joint_angle, measurement.joint_rate
        asked = self._plan.at(t, angle, reference)
        state = self._task.at(angle, rate)
        nx, ny = asked.normal_x, asked.normal_y
        if not (nx or ny):
            return self._joints_follow(asked, state, angle, rate)
        (x, y), (x_rate, y_rate), _ = state.motion.tolist()
        spring = self.frequency * self.frequency
        damper = 2.0 * self.damping_ratio * self.frequency
        force = felt_force(asked, measurement) - asked.force - self.stiffness * self._away
        speed = min(max(force / self.damping, -self.most_speed), self.most_speed)
        across = spring * self._away + damper * speed
        self._away += speed * self.sample_time
        x_pull = spring * (asked.x - x) + damper * (asked.x_rate - x_rate)
        y_pull = spring * (asked.y - y) + damper * (asked.y_rate - y_rate)
        return self._task.torque(
            state,
            (
                asked.x_acceleration + x_pull + across * nx,
                asked.y_acceleration + y_pull + across * ny,
            ),
            (0.0, 0.0),
            self._posture(asked, angle, rate),
            asked.pressing,
        )
