"""Terms of the rigid model for controllers: torques by parameter, and momentum.

Theory page "control under uncertainty", (C.41) to (C.43), (C.52). The inverse dynamics are
linear in the inertial parameters of the bodies and in the magnitudes of the passive joint torques.
A *set* contains one row of these parameters for each body, of length ``SET_COLUMNS``. The kernels
write it into the constants and evaluate the inverse dynamics, so that each column of a regressor
uses the same physics.

The constants are those of the rigid model, in arrays that the caller owns and that are overwritten.
"""

from __future__ import annotations

from flexarm.kernels.columns import (
    COULOMB,
    COULOMB_EXCESS,
    FIRST_MOMENT_X,
    FIRST_MOMENT_Y,
    GRAVITY_X,
    GRAVITY_Y,
    INERTIA,
    JOINT_DAMPING,
    JOINT_STIFFNESS,
    MASS,
    ROTOR_INERTIA,
    STATIC_RISE,
    STOP_STIFFNESS,
    TIP_INERTIA,
    TIP_MASS,
    VISCOUS,
    VISCOUS_EXCESS,
)
from flexarm.kernels.compilation.cache import compiled, merged
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.newton_euler import inverse_dynamics

#: Columns of a set: mass, first moments x and y, inertia, tip mass, tip inertia, rotor inertia;
#: viscous damping, spring, Coulomb friction, rise to static friction, viscous friction, stop;
#: excess of Coulomb and viscous friction at negative rates.
SET_COLUMNS = 15


@merged
def _write(constants: ArmConstants, sets: Array, k: int, i: int) -> None:
    """Write the parameters of body i in set k into the constants."""
    constants.body[i, MASS] = sets[k, i, 0]
    constants.body[i, FIRST_MOMENT_X] = sets[k, i, 1]
    constants.body[i, FIRST_MOMENT_Y] = sets[k, i, 2]
    constants.body[i, INERTIA] = sets[k, i, 3]
    constants.body[i, TIP_MASS] = sets[k, i, 4]
    constants.body[i, TIP_INERTIA] = sets[k, i, 5]
    constants.body[i, ROTOR_INERTIA] = sets[k, i, 6]
    constants.body[i, JOINT_DAMPING] = sets[k, i, 7]
    constants.body[i, JOINT_STIFFNESS] = sets[k, i, 8]
    constants.body[i, COULOMB] = sets[k, i, 9]
    constants.body[i, STATIC_RISE] = sets[k, i, 10]
    constants.body[i, VISCOUS] = sets[k, i, 11]
    constants.body[i, STOP_STIFFNESS] = sets[k, i, 12]
    constants.body[i, COULOMB_EXCESS] = sets[k, i, 13]
    constants.body[i, VISCOUS_EXCESS] = sets[k, i, 14]


@merged
def _difference(
    sizes: Sizes,
    constants: ArmConstants,
    loads: Loads,
    work: Workspace,
    bodies: Array,
    angle: Array,
    first: Array,
    second: Array,
    per_acceleration: float,
    gravities: float,
    state: Array,
    acceleration: Array,
    torque: Array,
) -> None:
    """Write a quarter of the difference of two inverse dynamics into ``torque`` (joints,).

    The rates are first + second and first - second. The accelerations are ``torque`` times
    ``per_acceleration`` and its negative; gravity is multiplied by ``gravities`` and its negative.
    Linear terms add up, and the mixed product remains of the squares of rates.
    """
    ax = loads.base_acceleration[0]
    ay = loads.base_acceleration[1]
    for j in range(bodies.shape[0]):
        i = bodies[j]
        state[0, i, 0] = angle[j]
        state[1, i, 0] = first[j] + second[j]
        acceleration[i, 0] = per_acceleration * torque[j]
    # The inverse dynamics use the base's acceleration minus gravity.
    loads.base_acceleration[0] = (1.0 - gravities) * constants.arm[GRAVITY_X]
    loads.base_acceleration[1] = (1.0 - gravities) * constants.arm[GRAVITY_Y]
    inverse_dynamics(sizes, constants, state, acceleration, loads, work)
    for j in range(bodies.shape[0]):
        i = bodies[j]
        state[1, i, 0] = first[j] - second[j]
        acceleration[i, 0] = -per_acceleration * torque[j]
        torque[j] = 0.25 * work.force[i, 0]
    loads.base_acceleration[0] = (1.0 + gravities) * constants.arm[GRAVITY_X]
    loads.base_acceleration[1] = (1.0 + gravities) * constants.arm[GRAVITY_Y]
    inverse_dynamics(sizes, constants, state, acceleration, loads, work)
    for j in range(bodies.shape[0]):
        torque[j] -= 0.25 * work.force[bodies[j], 0]
    loads.base_acceleration[0] = ax
    loads.base_acceleration[1] = ay


@compiled
def regressor(
    sizes: Sizes,
    constants: ArmConstants,
    loads: Loads,
    work: Workspace,
    sets: Array,
    inertial: int,
    bodies: Array,
    motion: Array,
    state: Array,
    acceleration: Array,
    columns: Array,
) -> None:
    """Write the torques of each set into ``columns`` (k, joints), (C.41), (C.42).

    ``sets`` (k, n, SET_COLUMNS): the first ``inertial`` of them contain no passive joint torques,
    the others no inertia. ``motion`` (4, joints): angle, rate, reference rate, reference
    acceleration. Inertial sets give M qdd_r + C(q, qd) qd_r + g with Christoffel's C; the others
    are evaluated at the reference rate.
    """
    for k in range(sets.shape[0]):
        for i in range(len(sizes.bodies)):
            _write(constants, sets, k, i)
        if k < inertial:
            for j in range(bodies.shape[0]):
                columns[k, j] = motion[3, j]
            _difference(
                sizes,
                constants,
                loads,
                work,
                bodies,
                motion[0],
                motion[1],
                motion[2],
                2.0,
                2.0,
                state,
                acceleration,
                columns[k],
            )
        else:
            for j in range(bodies.shape[0]):
                state[0, bodies[j], 0] = motion[0, j]
                state[1, bodies[j], 0] = motion[2, j]
                acceleration[bodies[j], 0] = 0.0
            inverse_dynamics(sizes, constants, state, acceleration, loads, work)
            for j in range(bodies.shape[0]):
                columns[k, j] = work.force[bodies[j], 0]


@compiled
def momentum(
    sizes: Sizes,
    constants: ArmConstants,
    loads: Loads,
    work: Workspace,
    sets: Array,
    bodies: Array,
    angle: Array,
    rate: Array,
    unit: Array,
    state: Array,
    acceleration: Array,
    found: Array,
) -> None:
    """Write momentum M qd and its rate without motors, C' qd - g - losses, into ``found``.

    ``found`` (2, joints). ``sets`` (2, n, SET_COLUMNS): the inertial and the other parameters of
    the arm; ``unit`` (joints,) is scratch and must be zero. (C.52), with row k of
    C' qd = qd . C(q, qd) e_k.
    """
    for i in range(len(sizes.bodies)):
        _write(constants, sets, 0, i)
    ax = loads.base_acceleration[0]
    ay = loads.base_acceleration[1]
    # The acceleration of free fall cancels gravity.
    loads.base_acceleration[0] = constants.arm[GRAVITY_X]
    loads.base_acceleration[1] = constants.arm[GRAVITY_Y]
    for j in range(bodies.shape[0]):
        state[0, bodies[j], 0] = angle[j]
        state[1, bodies[j], 0] = 0.0
        acceleration[bodies[j], 0] = rate[j]
    inverse_dynamics(sizes, constants, state, acceleration, loads, work)
    for j in range(bodies.shape[0]):
        found[0, j] = work.force[bodies[j], 0]
        acceleration[bodies[j], 0] = 0.0
    for k in range(bodies.shape[0]):
        unit[k] = 1.0
        found[1, k] = 0.0
        for half in range(2):
            sign = 1.0 - 2.0 * half
            for j in range(bodies.shape[0]):
                state[1, bodies[j], 0] = rate[j] + sign * unit[j]
            inverse_dynamics(sizes, constants, state, acceleration, loads, work)
            for j in range(bodies.shape[0]):
                found[1, k] += 0.25 * sign * rate[j] * work.force[bodies[j], 0]
        unit[k] = 0.0
    loads.base_acceleration[0] = ax
    loads.base_acceleration[1] = ay
    for passive in range(2):
        for i in range(len(sizes.bodies)):
            _write(constants, sets, passive, i)
        for j in range(bodies.shape[0]):
            state[0, bodies[j], 0] = angle[j]
            state[1, bodies[j], 0] = passive * rate[j]
            acceleration[bodies[j], 0] = 0.0
        inverse_dynamics(sizes, constants, state, acceleration, loads, work)
        for j in range(bodies.shape[0]):
            found[1, j] -= work.force[bodies[j], 0]
