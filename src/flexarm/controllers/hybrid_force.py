"""Hybrid control of the position along a surface and of the force normal to it."""

from __future__ import annotations

from flexarm.arguments import check_kind
from flexarm.arm import Arm
from flexarm.control.base import FloatArray, Measurement, Reference
from flexarm.control.gains import Gains
from flexarm.control_design.task_plan import Asked
from flexarm.controllers.task_controller import TaskController, felt_force

#: Limit of the integral, relative to the requested force. It prevents windup without contact,
#: which would make the tip hit the surface.
_MOST_CORRECTION = 0.5


class HybridForce(TaskController):
    """Position control along a surface, force control normal to it (Raibert and Craig 1981).

    Along the surface the tip of the rigid model follows the reference as a mass, a spring and a
    damper of ``frequency`` and ``damping_ratio``. Normal to it the torque presses with the force of
    the reference plus the integral of the force error, damped by ``normal_damping``. The reference
    (`pressed_motion`) supplies the torque that the bent arm needs to press at rest. Without contact
    the tip approaches the surface at ``approach_speed``. Theory page "control-force", (F.1) to
    (F.7).

    Args:
        arm: model of the arm.
        frequency: rad/s, natural frequency of the error along the surface.
        damping_ratio: damping ratio of that error.
        path_integral: 1/s, integral gain of that error. It compensates unmodelled friction within
            about its inverse.
        force_integral: 1/s, integral gain of the force error. It is the bandwidth of the force
            control and should be below the lowest frequency of the arm in contact.
        force_proportional: proportional gain of the force error.
        normal_damping: N s/m, damping of the tip of the rigid model normal to the surface.
        approach_speed: m/s, speed of approach without contact.
        touch_force: N, measured force below which there is no contact.
        sample_time: s.

    The controller measures ``joint_angle``, ``joint_rate`` and ``contact_force``, of which it uses
    the first contact. If the reference has no force, or there is no reference, the joints follow
    the motion or keep their first angles with ``frequency``, and no force is measured.

    Raises:
        InputError: if a gain is negative or not finite, or frequency, speed or sample time are not
            positive.
    """

    name = "hybrid_force"
    memory = ("_sum", "_x_sum", "_y_sum")

    def __init__(
        self,
        arm: Arm,
        frequency: float = 8.0,
        damping_ratio: float = 1.0,
        path_integral: float = 2.0,
        force_integral: float = 10.0,
        force_proportional: float = 0.0,
        normal_damping: float = 20.0,
        approach_speed: float = 0.1,
        touch_force: float = 0.2,
        sample_time: float = 1e-3,
    ) -> None:
        arm, gains = check_kind("HybridForce", "arm", arm, Arm), Gains("HybridForce")
        self.frequency = gains.one("frequency", frequency, positive=True)
        self.damping_ratio = gains.one("damping_ratio", damping_ratio)
        self.path_integral = gains.one("path_integral", path_integral)
        self.force_integral = gains.one("force_integral", force_integral)
        self.force_proportional = gains.one("force_proportional", force_proportional)
        self.normal_damping = gains.one("normal_damping", normal_damping)
        self.approach_speed = gains.one("approach_speed", approach_speed, positive=True)
        self.touch_force = gains.one("touch_force", touch_force)
        sample_time = gains.one("sample_time", sample_time, positive=True)
        gains.done()
        super().__init__(arm, sample_time, self.frequency)
        self._sum, self._touched = 0.0, False
        self._x_sum, self._y_sum = 0.0, 0.0

    def reset(self) -> None:
        """Clear the integrals of both errors, and the reference."""
        super().reset()
        self._sum, self._touched = 0.0, False
        self._x_sum, self._y_sum = 0.0, 0.0

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
        x_slip, y_slip = asked.x_rate - x_rate, asked.y_rate - y_rate
        x_off, y_off = asked.x - x, asked.y - y
        # Remove the normal component of the position error, which the force control replaces.
        across = nx * x_off + ny * y_off
        x_off, y_off = x_off - across * nx, y_off - across * ny
        x_pull = spring * (x_off + self._x_sum) + damper * x_slip
        y_pull = spring * (y_off + self._y_sum) + damper * y_slip
        across = nx * x_pull + ny * y_pull
        gain = self.path_integral * self.sample_time
        self._x_sum += gain * x_off
        self._y_sum += gain * y_off
        push = self._push(asked, measurement, nx * x_slip + ny * y_slip)
        return self._task.torque(
            state,
            (
                asked.x_acceleration + x_pull - across * nx,
                asked.y_acceleration + y_pull - across * ny,
            ),
            (-push * nx, -push * ny),
            self._posture(asked, angle, rate),
            asked.pressing,
        )

    def _push(self, asked: Asked, measurement: Measurement, slip: float) -> float:
        """Return the force (N) to add to the reference's: (F.5) in contact, (F.6) without."""
        felt, against = felt_force(asked, measurement), -self.normal_damping * slip
        error, limit = asked.force - felt, _MOST_CORRECTION * asked.force
        touching = felt >= self.touch_force
        self._touched = self._touched or touching
        push = self.force_proportional * error + self._sum + against
        if self._touched:
            # Integrate without contact as well, so that a bouncing tip has the correct mean force.
            added = self._sum + self.force_integral * self.sample_time * error
            self._sum = min(max(added, -limit), limit)
        if touching:
            return push
        return against + min(0.0, self.normal_damping * self.approach_speed - asked.force)
