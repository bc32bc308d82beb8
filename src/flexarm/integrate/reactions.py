"""Joint reactions and section forces of recorded states, by forward and inverse dynamics."""

from __future__ import annotations

from flexarm.integrate.base import System
from flexarm.integrate.closures import independence
from flexarm.integrate.sticking import settle_next, sticks, take_directions
from flexarm.integrate.torque import loads_at
from flexarm.kernels.columns import (
    GEAR_RATIO,
    MULTIPLIER,
    ROOT_ACCELERATION_W,
    ROOT_ACCELERATION_X,
    SLIDE_X,
    SLIDE_Y,
    SLIDES,
    WRENCH_W,
    WRENCH_X,
    WRENCH_Y,
)
from flexarm.kernels.compilation.cache import compiled, unlocked
from flexarm.kernels.forces.joint_law import passive_torque, rotor_moment
from flexarm.kernels.layout import Array, Stations
from flexarm.kernels.observation.section_forces import section_forces
from flexarm.kernels.recursion.articulated_body import forward_dynamics
from flexarm.kernels.recursion.newton_euler import inverse_dynamics


@unlocked
def reactions_many(
    system: System,
    times: Array,
    states: Array,
    torques: Array,
    accelerations: Array,
    root_accelerations: Array,
    reactions: Array,
    motor: Array,
    closing: Array,
) -> None:
    """Fill ``reactions`` (samples, n, 3) in body axes and ``motor`` torques (samples, n).

    ``states`` (samples, 2, n, 1 + m); ``torques`` (samples, n) as in ``forward_dynamics``. The
    motor torque is the transmitted moment minus the joint's passive torque; for a joint with
    prescribed motion, it is the required torque. Also filled, for ``section_forces_many``:
    ``accelerations`` (samples, n, 1 + m) and ``root_accelerations`` (samples, n, 3) minus gravity;
    and ``closing`` (samples, rows + 1), the forces of closures on their first points and their
    ``independence``.
    """
    sizes, constants, work = system.sizes, system.constants, system.work
    for k in range(states.shape[0]):
        loads_at(system, times[k], False)
        take_directions(system, states[k])
        evaluations = 1
        forward_dynamics(sizes, constants, states[k], torques[k], system.drive.loads, work)
        while settle_next(system, states[k], evaluations):
            evaluations += 1
            forward_dynamics(sizes, constants, states[k], torques[k], system.drive.loads, work)
        for c in range(len(sizes.closures)):
            closing[k, c] = work.closure[c, MULTIPLIER]
        if len(sizes.closures) > 0:
            closing[k, len(sizes.closures)] = independence(system)
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                accelerations[k, i, j] = work.acceleration[i, j]
            if sticks(system, i):
                accelerations[k, i, 0] = 0.0
        inverse_dynamics(sizes, constants, states[k], accelerations[k], system.drive.loads, work)
        for i in range(len(sizes.bodies)):
            for p in range(3):
                reactions[k, i, p] = work.body[i, WRENCH_X + p]
                root_accelerations[k, i, p] = work.body[i, ROOT_ACCELERATION_X + p]
            passive = passive_torque(sizes, constants, i, states[k], work)
            relative = accelerations[k, i, 0]
            turns = 1.0 - constants.body[i, SLIDES]
            carrier = work.body[i, ROOT_ACCELERATION_W] - turns * relative
            rotor = rotor_moment(sizes, constants, i, carrier, relative)
            moved = turns * work.body[i, WRENCH_W]
            moved += constants.body[i, SLIDE_X] * work.body[i, WRENCH_X]
            moved += constants.body[i, SLIDE_Y] * work.body[i, WRENCH_Y]
            motor[k, i] = moved + constants.body[i, GEAR_RATIO] * rotor - passive


@compiled
def section_forces_many(
    system: System,
    stations: Stations,
    times: Array,
    states: Array,
    accelerations: Array,
    root_accelerations: Array,
    reactions: Array,
    forces: Array,
) -> None:
    """Fill ``forces`` (samples, links, 3): axial, shear, moment at one station of each link.

    ``system`` is the arm with links that end at ``stations`` and with the loads inboard of them.
    The other arrays come from ``reactions_many`` of the whole arm.
    """
    sizes, constants, work = system.sizes, system.constants, system.work
    for k in range(states.shape[0]):
        loads_at(system, times[k], False)
        for i in range(len(sizes.bodies)):
            for p in range(3):
                work.body[i, WRENCH_X + p] = reactions[k, i, p]
                work.body[i, ROOT_ACCELERATION_X + p] = root_accelerations[k, i, p]
        section_forces(
            sizes,
            constants,
            stations,
            states[k],
            accelerations[k],
            system.drive.loads,
            work,
            forces[k],
        )
