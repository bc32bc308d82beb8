"""Torques of joints besides those of motors, by textbook formulas with sharp corners."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.model import Joint


def joint_energy(joint: Joint, angle: Any, twist: Any) -> Any:
    """Return the energy of spring and stops (J) at an angle that may be a jet, and that of the
    spring."""
    turned = stretched(joint, twist)
    energy = turned * turned * (0.5 * joint.stiffness)
    for beyond in _beyond(joint, angle):
        energy = energy + beyond * beyond * (0.5 * joint.limits.stiffness)
    return energy


def joint_loss(joint: Joint, angle: float, rate: float) -> float:
    """Return the torque (N m) of dry friction and of the stops' damping, without viscous
    damping."""
    torque = 0.0
    if joint.friction is not None:
        f = joint.friction
        width = 0.1 * f.stribeck_rate if f.smoothing_rate is None else f.smoothing_rate
        sign = np.tanh(rate / width)
        # The mean of the two directions, weighted by their shares of the smoothed sign.
        shares = (1 + sign) / 2, (1 - sign) / 2
        coulomb = f.coulomb, f.coulomb if f.coulomb_negative is None else f.coulomb_negative
        viscous = f.viscous, f.viscous if f.viscous_negative is None else f.viscous_negative
        rise = 0.0 if f.static is None else f.static - f.coulomb
        level = np.dot(shares, coulomb) + rise * np.exp(-((rate / f.stribeck_rate) ** 2))
        torque -= level * sign + np.dot(shares, viscous) * rate
    if joint.limits is not None:
        stop = joint.limits
        inward = 1.0 if angle < stop.lower else -1.0
        approach = -inward * rate
        for beyond in _beyond(joint, angle):
            push = stop.stiffness * beyond * max(0.0, 1.0 + stop.damping * approach)
            torque += inward * (push - stop.stiffness * beyond)  # the elastic part has an energy
    return float(torque)


def stretched(joint: Joint, twist: Any) -> Any:
    """Return the angle (rad) by which the spring of a joint is stretched."""
    if not joint.backlash:
        return twist + -joint.rest_angle
    # The contacts are half the backlash away; between them the spring is relaxed.
    value, half = float(getattr(twist, "value", twist)), 0.5 * joint.backlash
    if abs(value) <= half:
        return twist * 0.0
    return twist + -half * np.sign(value)


def back_electromotive(joint: Joint) -> float:
    """Return the torque per rate (N m s/rad) of a motor whose winding has a constant voltage."""
    if joint.winding is None:
        return 0.0
    volts = joint.winding.torque_constant * joint.gear_ratio
    return volts / joint.winding.resistance * joint.winding.torque_constant * joint.gear_ratio


def passive_torque(joint: Joint, angle: float, rate: float) -> float:
    """Return the passive torque (N m) of a joint without an elastic gear."""
    torque = joint_loss(joint, angle, rate)
    torque -= (joint.damping + back_electromotive(joint)) * rate
    torque -= joint.stiffness * (angle - joint.rest_angle)
    if joint.limits is not None:
        inward = 1.0 if angle < joint.limits.lower else -1.0
        torque += sum(inward * joint.limits.stiffness * p for p in _beyond(joint, angle))
    return float(torque)


def _beyond(joint: Joint, angle: Any) -> list[Any]:
    """Return how far the joint is beyond a stop; empty within its range."""
    if joint.limits is None:
        return []
    value = getattr(angle, "value", angle)
    if value < joint.limits.lower:
        return [-angle + joint.limits.lower]
    return [angle + -joint.limits.upper] if value > joint.limits.upper else []
