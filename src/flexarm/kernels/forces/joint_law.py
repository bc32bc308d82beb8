"""Passive joint torques: damping, spring, dry friction, stops, and a geared rotor.

Theory page "recursion", (R.32) to (R.34), and (R.37) for the rotor. Torques act on the relative
joint angle.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.columns import (
    COULOMB,
    COULOMB_EXCESS,
    GEAR_RATIO,
    JOINT_DAMPING,
    JOINT_REST,
    JOINT_STIFFNESS,
    LOWER_STOP,
    ROTOR_INERTIA,
    SMOOTHING_RATE,
    STATIC_RISE,
    STOP_DAMPING,
    STOP_STIFFNESS,
    STRIBECK_RATE,
    UPPER_STOP,
    VISCOUS,
    VISCOUS_EXCESS,
)
from flexarm.kernels.compilation.cache import merged
from flexarm.kernels.compilation.numbers import exp, positive_part, tanh
from flexarm.kernels.layout import ArmConstants, Sizes

#: Rounding radius at a stop (rad): far below the resolution of encoders, far above rounding errors.
CORNER = 1e-9
#: Rounding radius of the relative increase of the torque by damping.
PUSH = 1e-6


@merged
def _friction_terms(constants: ArmConstants, i: int, rate: Any) -> tuple[Any, Any, Any]:
    """Return the smooth sign of a rate, the level of dry friction and the viscous friction."""
    c = constants
    ratio = rate / c.body[i, STRIBECK_RATE]
    sign = tanh(rate / c.body[i, SMOOTHING_RATE])
    backward = 0.5 - 0.5 * sign
    level = c.body[i, COULOMB] + c.body[i, COULOMB_EXCESS] * backward
    level += c.body[i, STATIC_RISE] * exp(-ratio * ratio)
    return sign, level, c.body[i, VISCOUS] + c.body[i, VISCOUS_EXCESS] * backward


@merged
def passive_torque(sizes: Sizes, constants: ArmConstants, i: int, angle: Any, rate: Any) -> Any:
    """Return the passive torque (N m) of the joint of body i at a relative angle and rate."""
    c = constants
    torque = -c.body[i, JOINT_DAMPING] * rate - c.body[i, JOINT_STIFFNESS] * (
        angle - c.body[i, JOINT_REST]
    )
    for _ in range(len(sizes.joint_laws)):
        sign, level, viscous = _friction_terms(constants, i, rate)
        torque -= level * sign + viscous * rate
        below = positive_part(c.body[i, LOWER_STOP] - angle, CORNER)
        above = positive_part(angle - c.body[i, UPPER_STOP], CORNER)
        # A stop never pulls, however fast the joint leaves it.
        rise = c.body[i, STOP_DAMPING] * rate
        torque += c.body[i, STOP_STIFFNESS] * below * positive_part(1.0 - rise, PUSH)
        torque -= c.body[i, STOP_STIFFNESS] * above * positive_part(1.0 + rise, PUSH)
    return torque


@merged
def friction_slope(constants: ArmConstants, i: int, rate: Any) -> Any:
    """Return the damping (N m s/rad) of the joint of body i that its friction causes at a rate.

    It is never negative: the decrease of the torque by the Stribeck effect is left out.
    """
    sign, level, viscous = _friction_terms(constants, i, rate)
    return level * (1.0 - sign * sign) / constants.body[i, SMOOTHING_RATE] + viscous


@merged
def joint_energy(sizes: Sizes, constants: ArmConstants, i: int, angle: Any) -> Any:
    """Return the energy (J) stored in the spring and the stops of the joint of body i."""
    c = constants
    turned = angle - c.body[i, JOINT_REST]
    energy = 0.5 * c.body[i, JOINT_STIFFNESS] * turned * turned
    for _ in range(len(sizes.joint_laws)):
        below = positive_part(c.body[i, LOWER_STOP] - angle, CORNER)
        above = positive_part(angle - c.body[i, UPPER_STOP], CORNER)
        energy += 0.5 * c.body[i, STOP_STIFFNESS] * (below * below + above * above)
    return energy


@merged
def rotor_moment(sizes: Sizes, constants: ArmConstants, i: int, carrier: Any, relative: Any) -> Any:
    """Return the moment (N m) on the rotor of body i's motor, about its own axis.

    ``carrier``: angular acceleration of the section that carries the motor; ``relative``: angular
    acceleration of the joint angle, rad/s^2. The angular rate of the rotor is that of the carrier
    plus the gear ratio times that of the joint.
    """
    moment = 0.0 * relative
    for _ in range(len(sizes.joint_laws)):
        moment += constants.body[i, ROTOR_INERTIA] * (
            carrier + constants.body[i, GEAR_RATIO] * relative
        )
    return moment


@merged
def rotor_energy(sizes: Sizes, constants: ArmConstants, i: int, carrier: Any, relative: Any) -> Any:
    """Return the kinetic energy (J) of the rotor of body i's motor at angular rates in rad/s."""
    energy = 0.0 * relative
    for _ in range(len(sizes.joint_laws)):
        rate = carrier + constants.body[i, GEAR_RATIO] * relative
        energy += 0.5 * constants.body[i, ROTOR_INERTIA] * rate * rate
    return energy
