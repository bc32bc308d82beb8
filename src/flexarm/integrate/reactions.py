"""Joint reactions of recorded states: forward dynamics for the accelerations, then inverse."""

from __future__ import annotations

from flexarm.integrate.base import System
from flexarm.integrate.torque import loads_at
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.cache import compiled
from flexarm.kernels.joint_law import passive_torque, rotor_moment
from flexarm.kernels.layout import Array
from flexarm.kernels.newton_euler import inverse_dynamics


@compiled
def reactions_many(
    system: System,
    times: Array,
    states: Array,
    torques: Array,
    acceleration: Array,
    reactions: Array,
    motor: Array,
) -> None:
    """Fill ``reactions`` (samples, n, 3) in body axes and ``motor`` torques (samples, n).

    ``states`` (samples, 2, n, 1 + m); ``torques`` (samples, n) as ``forward_dynamics`` takes them;
    ``acceleration`` (n, 1 + m) scratch. A motor gives what the joint transmits less what the joint
    gives by itself; for a joint whose motion is given, that is the torque it takes.
    """
    sizes, constants, work = system.sizes, system.constants, system.work
    for k in range(states.shape[0]):
        loads_at(system, times[k], False)
        forward_dynamics(sizes, constants, states[k], torques[k], system.drive.loads, work)
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                acceleration[i, j] = work.acceleration[i, j]
        inverse_dynamics(sizes, constants, states[k], acceleration, system.drive.loads, work)
        for i in range(len(sizes.bodies)):
            for p in range(3):
                reactions[k, i, p] = work.wrench[i, p]
            passive = passive_torque(sizes, constants, i, states[k, 0, i, 0], states[k, 1, i, 0])
            relative = acceleration[i, 0]
            carrier = work.root_acceleration[i, 2] - relative
            rotor = rotor_moment(sizes, constants, i, carrier, relative)
            motor[k, i] = work.wrench[i, 2] + constants.rotor[i, 1] * rotor - passive
