"""Passive joint torques: damping, spring, dry friction, stops, and a geared rotor.

Theory page "recursion", (R.32) to (R.34), (R.50) for bristles, and (R.37) for the rotor. Torques
act on the relative joint angle.

Dry friction is a function of the rate, or the torque of bristles: the LuGre model of Canudas de
Wit, Olsson, Astrom and Lischinsky, IEEE Transactions on Automatic Control 40 (1995) 419-425, with
the function of the rate as its steady state.

=============  =================================================================================
symbol         meaning
=============  =================================================================================
``sigma``      bristle damping, N m s/rad
``root``       square root of the bristle stiffness
``s``          deflection of the bristles times ``root``; ``s' = root rate - decay s``
``decay``      stiffness times |rate| over the level of dry friction, 1/s
=============  =================================================================================
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.columns import (
    BRISTLE_DAMPING,
    BRISTLE_ROOT,
    BRISTLED,
    COULOMB,
    COULOMB_EXCESS,
    GEAR_RATIO,
    JOINT_DAMPING,
    JOINT_REST,
    JOINT_STIFFNESS,
    LOWER_PUSHES,
    LOWER_STOP,
    ROTOR_INERTIA,
    SLIDING,
    SMOOTHING_RATE,
    STATIC_RISE,
    STOP_DAMPING,
    STOP_STIFFNESS,
    STOPS_FIXED,
    STRIBECK_RATE,
    UPPER_PUSHES,
    UPPER_STOP,
    VISCOUS,
    VISCOUS_EXCESS,
)
from flexarm.kernels.compilation.cache import merged
from flexarm.kernels.compilation.numbers import exp, positive_part, sqrt, tanh
from flexarm.kernels.layout import ArmConstants, Array, Sizes, Workspace

#: Rounding radius at a stop (rad), for arms of all sizes: far below the resolution of encoders, far
#: above rounding errors.
CORNER = 1e-9
#: Rounding radius of the relative increase of the torque by damping.
PUSH = 1e-6
#: Rounding of the corner of |rate|, so that derivatives exist, relative to the smoothing rate.
_AT_REST = 1e-7


@merged
def _friction_terms(constants: ArmConstants, i: int, rate: Any) -> tuple[Any, Any, Any]:
    """Return the smooth sign of a rate, the level of dry friction and the viscous friction."""
    c = constants
    ratio = rate / c.body[i, STRIBECK_RATE]
    sign = tanh(rate / c.body[i, SMOOTHING_RATE] + c.body[i, SLIDING])
    backward = 0.5 - 0.5 * sign
    level = c.body[i, COULOMB] + c.body[i, COULOMB_EXCESS] * backward
    level += c.body[i, STATIC_RISE] * exp(-ratio * ratio)
    return sign, level, c.body[i, VISCOUS] + c.body[i, VISCOUS_EXCESS] * backward


@merged
def breakaway(constants: ArmConstants, i: int, backward: float) -> Any:
    """Return the torque (N m) that friction holds at rest; ``backward``: 1 if it is negative."""
    c = constants
    return c.body[i, COULOMB] + c.body[i, COULOMB_EXCESS] * backward + c.body[i, STATIC_RISE]


@merged
def bristle_decay(constants: ArmConstants, i: int, rate: Any) -> Any:
    """Return the decay (1/s) of the bristles of the joint of body i; 0 for a joint without any."""
    c = constants
    _, level, _ = _friction_terms(constants, i, rate)
    level += 1.0 - c.body[i, BRISTLED]
    corner = _AT_REST * c.body[i, SMOOTHING_RATE]
    speed = sqrt(rate * rate + corner * corner)
    return c.body[i, BRISTLE_ROOT] * c.body[i, BRISTLE_ROOT] * speed / level


@merged
def bristle_rate(sizes: Sizes, constants: ArmConstants, i: int, state: Array) -> Any:
    """Return the derivative of ``s`` of the joint of body i; sizes must have bristles."""
    rate = state[1, i, 0]
    s = state[1, i, len(sizes.modes)]
    return constants.body[i, BRISTLE_ROOT] * rate - bristle_decay(constants, i, rate) * s


@merged
def bristle_pull(constants: ArmConstants, i: int, decay: Any) -> Any:
    """Return the torque per ``s`` of the bristles, root - sigma decay / root."""
    root = constants.body[i, BRISTLE_ROOT]
    share = constants.body[i, BRISTLED] / (root + 1.0 - constants.body[i, BRISTLED])
    return root - constants.body[i, BRISTLE_DAMPING] * decay * share


@merged
def _stop_torque(constants: ArmConstants, i: int, angle: Any, rate: Any, work: Workspace) -> Any:
    """Return the torque (N m) of the stops of the joint of body i, (R.33).

    If an integrator has fixed whether they push, the torque is that of linear springs, which it
    continues smoothly beyond the stop.
    """
    c = constants
    below = c.body[i, LOWER_STOP] - angle
    above = angle - c.body[i, UPPER_STOP]
    # A stop never pulls, however fast the joint leaves it.
    slow = 1.0 - c.body[i, STOP_DAMPING] * rate
    fast = 1.0 + c.body[i, STOP_DAMPING] * rate
    by_angle = positive_part(below, CORNER) * positive_part(slow, PUSH)
    by_angle -= positive_part(above, CORNER) * positive_part(fast, PUSH)
    fixed = work.body[i, LOWER_PUSHES] * below * slow - work.body[i, UPPER_PUSHES] * above * fast
    share = work.body[i, STOPS_FIXED]
    return c.body[i, STOP_STIFFNESS] * ((1.0 - share) * by_angle + share * fixed)


@merged
def passive_torque(
    sizes: Sizes, constants: ArmConstants, i: int, state: Array, work: Workspace
) -> Any:
    """Return the passive torque (N m) of the joint of body i at a state (2, n, 1 + m)."""
    c = constants
    angle = state[0, i, 0]
    rate = state[1, i, 0]
    torque = -c.body[i, JOINT_DAMPING] * rate - c.body[i, JOINT_STIFFNESS] * (
        angle - c.body[i, JOINT_REST]
    )
    if len(sizes.joint_laws) > 0:
        sign, level, viscous = _friction_terms(constants, i, rate)
        torque -= level * sign + viscous * rate
        if len(sizes.bristles) > 0:
            decay = bristle_decay(c, i, rate)
            torque += c.body[i, BRISTLED] * level * sign  # instead of the function of the rate
            torque -= bristle_pull(c, i, decay) * state[1, i, len(sizes.modes)]
            torque -= c.body[i, BRISTLE_DAMPING] * rate
        torque += _stop_torque(c, i, angle, rate, work)
    return torque


@merged
def friction_slope(sizes: Sizes, constants: ArmConstants, i: int, rate: Any) -> Any:
    """Return the damping (N m s/rad) of the joint of body i that its friction causes at a rate.

    It is never negative: the decrease of the torque by the Stribeck effect is left out. That of
    bristles is ``bristle_slope``.
    """
    sign, level, viscous = _friction_terms(constants, i, rate)
    if len(sizes.bristles) > 0:
        level *= 1.0 - constants.body[i, BRISTLED]
    return level * (1.0 - sign * sign) / constants.body[i, SMOOTHING_RATE] + viscous


@merged
def bristle_slope(constants: ArmConstants, i: int, decay: Any, hold: float) -> Any:
    """Return the damping (N m s/rad) by bristles whose deflection is implicit over ``hold`` (s).

    It is ``bristle_pull`` times the change of ``s`` by the rate, plus the bristle damping.
    """
    root = constants.body[i, BRISTLE_ROOT]
    return (constants.body[i, BRISTLE_DAMPING] + hold * root * root) / (1.0 + hold * decay)


@merged
def joint_energy(sizes: Sizes, constants: ArmConstants, i: int, angle: Any) -> Any:
    """Return the energy (J) stored in the spring and the stops of the joint of body i."""
    c = constants
    turned = angle - c.body[i, JOINT_REST]
    energy = 0.5 * c.body[i, JOINT_STIFFNESS] * turned * turned
    if len(sizes.joint_laws) > 0:
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
    if len(sizes.joint_laws) > 0:
        moment += constants.body[i, ROTOR_INERTIA] * (
            carrier + constants.body[i, GEAR_RATIO] * relative
        )
    return moment


@merged
def rotor_energy(sizes: Sizes, constants: ArmConstants, i: int, carrier: Any, relative: Any) -> Any:
    """Return the kinetic energy (J) of the rotor of body i's motor at angular rates in rad/s."""
    energy = 0.0 * relative
    if len(sizes.joint_laws) > 0:
        rate = carrier + constants.body[i, GEAR_RATIO] * relative
        energy += 0.5 * constants.body[i, ROTOR_INERTIA] * rate * rate
    return energy
