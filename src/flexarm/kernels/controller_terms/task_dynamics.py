"""Quantities that a task-space controller requires at each sample time, in one call.

They are the motion of the last tip (``tip_motion``), the mass matrix (``composite_body``) and the
bias (``newton_euler``) of an arm, reduced to its joints. One call computes all three, because
passing the arrays of an arm to compiled code costs more than the computation.
"""

from __future__ import annotations

from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.controller_terms.tip_motion import tip_motion
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.composite_body import mass_matrix
from flexarm.kernels.recursion.newton_euler import inverse_dynamics

#: Fraction of its trace added to J J'. It bounds the joint accelerations if the arm is straight or
#: folded; elsewhere the relative error of the tip's acceleration is of the same order.
DAMPING = 1e-6


@compiled
def task_dynamics(
    sizes: Sizes,
    constants: ArmConstants,
    joint_body: Array,
    angle: Array,
    rate: Array,
    loads: Loads,
    state: Array,
    at_rest: Array,
    work: Workspace,
    scratch: Array,
    body_poses: Array,
    tip: Array,
    columns: Array,
    full_mass: Array,
    motion: Array,
    jacobian: Array,
    mass: Array,
    bias_torque: Array,
) -> None:
    """Compute motion of the tip, mass matrix and bias at ``angle`` and ``rate`` (joints,).

    ``motion`` (3, 2): position, velocity, and acceleration at zero joint acceleration of the tip,
    world axes; ``jacobian`` (2, joints); ``mass`` (joints, joints); ``bias_torque`` (joints,), the
    torque required at zero joint acceleration. The other arguments are scratch: ``state``
    (2, n, 1 + m), ``at_rest`` (n, 1 + m) zeros, ``scratch``, ``body_poses``, ``tip`` as in
    ``tip_motion``, ``columns`` (2, n), ``full_mass`` (n, 1 + m, n, 1 + m).
    """
    joints = joint_body.shape[0]
    for k in range(joints):
        state[0, joint_body[k], 0] = angle[k]
        state[1, joint_body[k], 0] = rate[k]
    tip_motion(
        sizes, constants, state, scratch, body_poses, tip, motion[0], motion[1], columns, motion[2]
    )
    mass_matrix(sizes, constants, state, work, full_mass)
    inverse_dynamics(sizes, constants, state, at_rest, loads, work)
    for k in range(joints):
        i = joint_body[k]
        jacobian[0, k] = columns[0, i]
        jacobian[1, k] = columns[1, i]
        bias_torque[k] = work.force[i, 0]
        for other in range(joints):
            mass[k, other] = full_mass[i, 0, joint_body[other], 0]


@compiled
def tip_torque(
    motion: Array,
    jacobian: Array,
    mass: Array,
    bias_torque: Array,
    posture: Array,
    wanted_x: float,
    wanted_y: float,
    push_x: float,
    push_y: float,
    added: Array,
    torque: Array,
) -> None:
    """Fill ``torque`` (joints,) for a desired tip acceleration, m/s^2, and tip force, N; (F.1).

    The first four arguments are results of ``task_dynamics``. ``posture`` (joints,) rad/s^2 are the
    preferred joint accelerations; ``added`` (joints,) N m is added to the torque.
    """
    joints = mass.shape[0]
    xx = 0.0
    xy = 0.0
    yy = 0.0
    x = wanted_x - motion[2, 0]
    y = wanted_y - motion[2, 1]
    for k in range(joints):
        xx += jacobian[0, k] * jacobian[0, k]
        xy += jacobian[0, k] * jacobian[1, k]
        yy += jacobian[1, k] * jacobian[1, k]
        x -= jacobian[0, k] * posture[k]
        y -= jacobian[1, k] * posture[k]
    damping = DAMPING * (xx + yy)
    xx += damping
    yy += damping
    scale = 1.0 / (xx * yy - xy * xy)
    along_x = scale * (yy * x - xy * y)
    along_y = scale * (xx * y - xy * x)
    for k in range(joints):
        total = bias_torque[k] + added[k] + jacobian[0, k] * push_x + jacobian[1, k] * push_y
        for other in range(joints):
            needed = jacobian[0, other] * along_x + jacobian[1, other] * along_y
            total += mass[k, other] * (posture[other] + needed)
        torque[k] = total
