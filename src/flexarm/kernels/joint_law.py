"""What a joint does besides its motor: damping, spring, dry friction, stops, a geared rotor.

Theory page "recursion", (R.32) to (R.34), and (R.37) for the rotor. Torques act on the relative
joint angle.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.cache import merged
from flexarm.kernels.layout import ArmConstants, Sizes
from flexarm.kernels.numbers import exp, positive_part, tanh

#: Corner of a stop (rad): far below what any encoder sees, far above rounding.
CORNER = 1e-9
#: The same for the relative rise by damping.
PUSH = 1e-6


@merged
def passive_torque(sizes: Sizes, constants: ArmConstants, i: int, angle: Any, rate: Any) -> Any:
    """Torque (N m) that the joint of body i gives by itself at a relative angle and rate."""
    c = constants
    torque = -c.joint_damping[i] * rate - c.joint_stiffness[i] * (angle - c.joint_rest[i])
    for _ in range(len(sizes.joint_laws)):
        ratio = rate / c.friction[i, 2]
        level = c.friction[i, 0] + c.friction[i, 1] * exp(-ratio * ratio)
        torque -= level * tanh(rate / c.friction[i, 3]) + c.friction[i, 4] * rate
        below = positive_part(c.limits[i, 0] - angle, CORNER)
        above = positive_part(angle - c.limits[i, 1], CORNER)
        # A stop pushes, it never pulls, however fast the joint leaves it.
        rise = c.limits[i, 3] * rate
        torque += c.limits[i, 2] * below * positive_part(1.0 - rise, PUSH)
        torque -= c.limits[i, 2] * above * positive_part(1.0 + rise, PUSH)
    return torque


@merged
def joint_energy(sizes: Sizes, constants: ArmConstants, i: int, angle: Any) -> Any:
    """Energy (J) stored in the spring and the stops of the joint of body i."""
    c = constants
    turned = angle - c.joint_rest[i]
    energy = 0.5 * c.joint_stiffness[i] * turned * turned
    for _ in range(len(sizes.joint_laws)):
        below = positive_part(c.limits[i, 0] - angle, CORNER)
        above = positive_part(angle - c.limits[i, 1], CORNER)
        energy += 0.5 * c.limits[i, 2] * (below * below + above * above)
    return energy


@merged
def rotor_moment(sizes: Sizes, constants: ArmConstants, i: int, carrier: Any, relative: Any) -> Any:
    """Moment (N m) on the rotor of body i's motor, about its own axis.

    ``carrier``: angular acceleration of the section that carries the motor; ``relative``: that of
    the joint angle, rad/s^2. The rotor turns at the carrier's rate plus the gear ratio times the
    joint's.
    """
    moment = 0.0 * relative
    for _ in range(len(sizes.joint_laws)):
        rotor = constants.rotor
        moment += rotor[i, 0] * (carrier + rotor[i, 1] * relative)
    return moment


@merged
def rotor_energy(sizes: Sizes, constants: ArmConstants, i: int, carrier: Any, relative: Any) -> Any:
    """Kinetic energy (J) of that rotor at these angular rates, rad/s."""
    energy = 0.0 * relative
    for _ in range(len(sizes.joint_laws)):
        rotor = constants.rotor
        rate = carrier + rotor[i, 1] * relative
        energy += 0.5 * rotor[i, 0] * rate * rate
    return energy
