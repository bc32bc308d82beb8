"""Hybrid position and force control: the tip follows its path along a surface and presses on it."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.arm import Arm
from flexarm.control.base import Controller, FloatArray, Measurement, Reference
from flexarm.control.gains import Gains
from flexarm.control.rigid_model import RigidModel
from flexarm.control.task_space import TaskSpace, accelerations_for
from flexarm.errors import InputError, Problem, shown


class HybridForce(Controller):
    """Position control along a surface, force control across it (Raibert and Craig 1981).

    Along the tangent the joints' tip follows the reference with the rigid model's inertia,
    like a mass, a spring and a damper of ``frequency`` and ``damping_ratio``. Across it the torque
    presses with the reference's force, corrected by the integral of its error, against
    ``normal_damping``. What the bent arm needs to press at rest comes from the reference
    (`pressed_motion`). Theory page "control-force", (C.60) to (C.64).

    Args:
        arm: what the controller believes the arm to be.
        frequency: rad/s, of the error along the surface.
        damping_ratio: of that error.
        force_integral: 1/s, of the force error: the bandwidth of the force control, below the
            arm's lowest frequency in touch.
        force_proportional: of the force error.
        normal_damping: N s/m, against motion of the joints' tip across the surface.
        sample_time: s.

    It measures ``joint_angle``, ``joint_rate`` and ``contact_force``, of which the first contact's
    counts, and needs a reference with ``contact_force`` and ``normal``.

    Raises:
        InputError: a gain is negative or not finite, or the sample time is not positive.
    """

    name = "hybrid_force"

    def __init__(
        self,
        arm: Arm,
        frequency: float = 8.0,
        damping_ratio: float = 1.0,
        force_integral: float = 10.0,
        force_proportional: float = 0.0,
        normal_damping: float = 20.0,
        sample_time: float = 1e-3,
    ) -> None:
        gains = Gains("HybridForce")
        self.arm = arm
        self.frequency = gains.one("frequency", frequency, positive=True)
        self.damping_ratio = gains.one("damping_ratio", damping_ratio)
        self.force_integral = gains.one("force_integral", force_integral)
        self.force_proportional = gains.one("force_proportional", force_proportional)
        self.normal_damping = gains.one("normal_damping", normal_damping)
        self.sample_time = gains.one("sample_time", sample_time, positive=True)
        gains.done()
        self._model = RigidModel(arm)
        self._task = TaskSpace(arm)
        self._sum = 0.0

    def reset(self) -> None:
        """Forget the integral of the force error."""
        self._sum = 0.0

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        wanted = pressed(self.name, reference)
        angle, rate = measurement.joint_angle, measurement.joint_rate
        normal = wanted.normal(t)
        tangent = np.array([-normal[1], normal[0]])
        tip = self._task.at(angle, rate)
        asked = self._task.at(wanted.joint_angle(t), wanted.joint_rate(t))
        force = wanted.contact_force(t)
        error = force - normal @ measurement.contact_force[0]
        w = self.frequency
        along = tangent @ (
            w * w * (asked.position - tip.position)
            + 2.0 * self.damping_ratio * w * (asked.velocity - tip.velocity)
        )
        acceleration = accelerations_for(tip, along * tangent)
        # What the bent arm needs to press and hold, less what the rigid model counts of gravity.
        pressing = wanted.holding_torque(t) - self._model.gravity_torque(wanted.joint_angle(t))
        push = self.force_proportional * error + self._sum
        push += self.normal_damping * (normal @ (tip.velocity - asked.velocity))
        self._sum += self.force_integral * self.sample_time * error
        torque: FloatArray = self._model.torque(angle, rate, acceleration) + pressing
        return torque - tip.jacobian.T @ (push * normal)


def pressed(name: str, reference: Reference | None) -> Any:
    """Return a reference that has a force.

    Raises:
        InputError: it has none.
    """
    for needed in ("contact_force", "normal", "holding_torque"):
        if not hasattr(reference, needed):
            rule = f"be a pressed motion, with {needed}, for {name}"
            hint = "pressed_motion makes one of a motion along a surface."
            raise InputError(Problem("controller", "reference", rule, shown(reference), hint))
    return reference
