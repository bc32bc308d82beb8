"""Recorded contact forces and a reference that presses, for the recorded run of a controller."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray

#: Samples (first, end) without a contact force: at the start, within a contact, after the lift-off.
_NO_CONTACT = ((0, 3), (10, 12), (23, 25))
#: Samples whose reference has no force, and no surface. Afterwards the normal is vertical.
_NO_FORCE, _FREE = (20, 23), (25, 27)
#: Directions of the contact force and of the normal of the surface.
_FORCE, _NORMAL = np.array([0.8, 0.6]), np.array([0.6, 0.8])
#: Pressing torque (N m), and coefficients of friction.
_PRESSING, _FRICTION, _ROUGHER = 0.05, 0.1, 0.2
#: Joint angle (rad) by which the motion for more friction differs, relative to the other.
_BENT = 1.05
#: Largest speed relative to the nominal one.
_FAST = 1.5


def _within(k: int, *intervals: tuple[int, int]) -> bool:
    return any(first <= k < end for first, end in intervals)


def contact_readings(controller: object, count: int) -> FloatArray:
    """Return contact forces (count, 1, 2) N of a tip that touches and leaves a surface."""
    size = getattr(controller, "nominal_force", 1.0)
    felt = [
        0.0 if _within(k, *_NO_CONTACT) else size * (1.0 + 0.3 * np.sin(k)) for k in range(count)
    ]
    forces: FloatArray = np.outer(felt, _FORCE)[:, None]
    return forces


class PressedRun:
    """Reference with a motion of the joints, and with and without a force and a surface.

    Args:
        motion: motion of the joints.
        controller: controller of the tip, whose nominal force and speed are exceeded.
        count: number of samples.
        bent: factor of the joint motion.
        friction: coefficient of friction of the motion.
    """

    def __init__(
        self,
        motion: Any,
        controller: Any,
        count: int,
        bent: float = 1.0,
        friction: float = _FRICTION,
    ) -> None:
        self._given, self._motion, self.friction = (motion, controller, count), motion, friction
        self._bent, self._h = bent, controller.sample_time
        self._size = getattr(controller, "nominal_force", 1.0)
        self._turn = 2.0 * np.pi / (count * self._h)
        self._reach = _FAST * getattr(controller, "nominal_speed", 0.1) / self._turn

    @property
    def rougher(self) -> PressedRun:
        """The motion for more friction."""
        return PressedRun(*self._given, _BENT, _ROUGHER)

    def joint_angle(self, t: float) -> FloatArray:
        """Return the joint angles (joints,), rad."""
        return self._bent * np.asarray(self._motion.joint_angle(t))

    def joint_rate(self, t: float) -> FloatArray:
        """Return the joint rates (joints,), rad/s."""
        return self._bent * np.asarray(self._motion.joint_rate(t))

    def joint_acceleration(self, t: float) -> FloatArray:
        """Return the joint accelerations (joints,), rad/s^2."""
        return self._bent * np.asarray(self._motion.joint_acceleration(t))

    def tip(self, t: float) -> FloatArray:
        """Return the position of the tip (2,), m, which slides to and fro."""
        place = self._reach * np.sin(self._turn * t)
        return np.array([-place * _NORMAL[1], place * _NORMAL[0]])

    def contact_force(self, t: float) -> float:
        """Return the force on the surface, N."""
        force = self._size * (1.0 + 0.5 * np.sin(self._turn * t))
        return 0.0 if _within(self._sample(t), _NO_FORCE) else float(force)

    def normal(self, t: float) -> FloatArray:
        """Return the normal of the surface (2,), zero without a surface."""
        k = self._sample(t)
        if _within(k, _FREE):
            return np.zeros(2)
        return _NORMAL if k < _FREE[1] else np.array([0.0, 1.0])

    def pressing_torque(self, t: float) -> FloatArray:
        """Return the torques to press (joints,), N m."""
        return _PRESSING * self._bent * np.ones_like(self.joint_angle(t))

    def _sample(self, t: float) -> int:
        return int(np.round(t / self._h))


def pressed_values(controller: Any, t: float, reference: PressedRun) -> dict[str, FloatArray]:
    """Return the inputs of an exported controller of the tip at t (s), by name."""
    found = {
        "reference_force": [reference.contact_force(t)],
        "reference_normal": reference.normal(t),
    }
    for prefix, motion in {"reference": reference, "rougher": reference.rougher}.items():
        found |= {
            f"{prefix}_angle": motion.joint_angle(t),
            f"{prefix}_rate": motion.joint_rate(t),
            f"{prefix}_acceleration": motion.joint_acceleration(t),
            f"{prefix}_pressing": motion.pressing_torque(t),
            f"{prefix}_friction": [motion.friction],
        }
    surface = getattr(controller, "_surface", None)
    if surface is not None:
        *path, speed, force_rate = surface.along(t, reference)
        found |= {
            "path_position": path,
            "path_speed": [speed],
            "reference_force_rate": [force_rate],
        }
    return {name: np.array(value, dtype=np.float64) for name, value in found.items()}
