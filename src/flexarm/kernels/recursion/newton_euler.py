"""Inverse dynamics in O(n m): generalised forces of a given motion, and joint reactions.

Theory page "recursion", (R.15) to (R.17). Symbols as in ``articulated_body``.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.compilation.cache import compiled, merged
from flexarm.kernels.forces.contact import place_bodies
from flexarm.kernels.forces.external import apply_loads
from flexarm.kernels.forces.joint_law import passive_torque, rotor_moment
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.closures import closure_rows, closure_wrench
from flexarm.kernels.recursion.outward import carrier_acceleration

# isort: off
from flexarm.kernels.columns import (
    A, ALPHA, BENT_INERTIA, BETA, CARRIED_KW, CARRIED_KX, CARRIED_KY, COSINE, D0_ETA, DP,
    FIRST_MOMENT_X, FLEX_BIAS, FREE, FX, GEAR_RATIO, GRAVITY_X, GRAVITY_Y, INERTIA, INVERSE_MASS,
    JOINT_BIAS_X, JOINT_BIAS_Y, MASS, MEAN_RATES, MOMENT_MU, MOMENT_S, P, ROOT_ACCELERATION_W,
    ROOT_ACCELERATION_X, ROOT_ACCELERATION_Y, ROOT_BIAS_W, ROOT_BIAS_X, ROOT_BIAS_Y, ROOT_FROM_X,
    ROOT_FROM_Y, S, SINE, SLIDES, SLIDE_X, SLIDE_Y, TIP_ACCELERATION_W, TIP_ACCELERATION_X,
    TIP_ACCELERATION_Y, TIP_BIAS_X, TIP_BIAS_Y, TIP_INERTIA, TIP_MASS, TIP_X, TIP_Y, WRENCH_W,
    WRENCH_X, WRENCH_Y,
)  # fmt: skip
# isort: on


@compiled
def inverse_dynamics(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    acceleration: Array,
    loads: Loads,
    work: Workspace,
) -> None:
    """Write generalised forces (n, 1 + m) into ``work.force`` and reactions into WRENCH columns.

    ``acceleration`` (n, 1 + m). The force is M qdd + bias, including stiffness, damping and
    gravity, less the forces of closures for the multipliers in ``work.closure``. The wrench (n, 3)
    is that of the joint on its body, at the joint, in the body's axes.
    """
    link_terms(sizes, constants, state, work)
    apply_loads(sizes, constants, loads, state, work)
    _accelerations(sizes, constants, acceleration, loads, work)
    if len(sizes.closures) > 0:
        place_bodies(sizes, constants, state, work)
        closure_rows(sizes, constants, work)
    _wrenches(sizes, constants, state, acceleration, work)


@merged
def _accelerations(
    sizes: Sizes, constants: ArmConstants, acceleration: Array, loads: Loads, work: Workspace
) -> None:
    """Compute, outwards, accelerations of each body's root and tip, in the body's axes."""
    c = constants
    ground_x = loads.base_acceleration[0] - c.arm[GRAVITY_X]
    ground_y = loads.base_acceleration[1] - c.arm[GRAVITY_Y]
    Ax = ground_x
    Ay = ground_y
    Aw = 0.0
    for i in range(len(sizes.bodies)):
        if len(sizes.tree) > 0:
            Ax, Ay, Aw = carrier_acceleration(sizes, i, ground_x, ground_y, work)
        cosine = work.body[i, COSINE]
        sine = work.body[i, SINE]
        turned = cosine * Ax + sine * Ay
        Ay = cosine * Ay - sine * Ax
        Ax = turned
        turning = acceleration[i, 0]
        if len(sizes.tree) > 0:
            Ax = Ax - Aw * work.body[i, ROOT_FROM_Y] + work.body[i, JOINT_BIAS_X]
            Ay = Ay + Aw * work.body[i, ROOT_FROM_X] + work.body[i, JOINT_BIAS_Y]
            Ax = Ax + c.body[i, SLIDE_X] * acceleration[i, 0]
            Ay = Ay + c.body[i, SLIDE_Y] * acceleration[i, 0]
            turning = turning * (1.0 - c.body[i, SLIDES])
        Aw = Aw + turning
        work.body[i, ROOT_ACCELERATION_X] = Ax
        work.body[i, ROOT_ACCELERATION_Y] = Ay
        work.body[i, ROOT_ACCELERATION_W] = Aw
        tip_x = Ax - work.body[i, TIP_Y] * Aw + work.body[i, TIP_BIAS_X]
        tip_y = Ay + work.body[i, TIP_X] * Aw + work.body[i, TIP_BIAS_Y]
        tip_w = Aw
        for j in range(len(sizes.modes)):
            tip_y += c.mode[i, j, P] * acceleration[i, 1 + j]
            tip_w += c.mode[i, j, DP] * acceleration[i, 1 + j]
        for j in range(len(sizes.geometric)):
            tip_x += work.mode[i, j, FX] * acceleration[i, 1 + j]
        Ax = tip_x
        Ay = tip_y
        Aw = tip_w
        work.body[i, TIP_ACCELERATION_X] = tip_x
        work.body[i, TIP_ACCELERATION_Y] = tip_y
        work.body[i, TIP_ACCELERATION_W] = tip_w


@merged
def body_wrench(
    sizes: Sizes,
    constants: ArmConstants,
    i: int,
    acceleration: Array,
    kx: Any,
    ky: Any,
    kw: Any,
    work: Workspace,
) -> tuple[Any, Any, Any]:
    """Return the wrench (Fx, Fy, Mz) required at the root of body i, body axes: (R.16).

    (kx, ky, kw) is the wrench of its tip on the outboard chain. ``work`` contains the results of
    ``link_terms`` and ``apply_loads``, and the accelerations of the roots. The modal forces,
    (R.17), are written into ``work.force``.
    """
    c = constants
    Ax = work.body[i, ROOT_ACCELERATION_X]
    Ay = work.body[i, ROOT_ACCELERATION_Y]
    Aw = work.body[i, ROOT_ACCELERATION_W]
    s = work.body[i, MOMENT_S]
    first_moment = c.body[i, FIRST_MOMENT_X] + work.body[i, MOMENT_MU]
    inertia = c.body[i, INERTIA] + work.body[i, BENT_INERTIA]
    rx = work.body[i, ROOT_BIAS_X] + c.body[i, MASS] * Ax - s * Aw + kx
    ry = work.body[i, ROOT_BIAS_Y] + c.body[i, MASS] * Ay + first_moment * Aw + ky
    rw = work.body[i, ROOT_BIAS_W] - s * Ax + first_moment * Ay + inertia * Aw
    rw += work.body[i, TIP_X] * ky - work.body[i, TIP_Y] * kx + kw
    rising = Ay
    turning = Aw
    if len(sizes.geometric) > 0:
        rising += work.body[i, ALPHA] * Aw
        turning += work.body[i, BETA] * Aw
    for j in range(len(sizes.modes)):
        eta_dot_dot = acceleration[i, 1 + j]
        ry += c.mode[i, j, S] * eta_dot_dot
        rw += c.mode[i, j, A] * eta_dot_dot
        work.force[i, 1 + j] = (
            c.mode[i, j, S] * rising
            + c.mode[i, j, A] * turning
            + eta_dot_dot
            + work.mode[i, j, FLEX_BIAS]
            + c.mode[i, j, P] * ky
            + c.mode[i, j, DP] * kw
        )
    pull = 0.0  # d . eta''
    for j in range(len(sizes.geometric)):
        eta_dot_dot = acceleration[i, 1 + j]
        pull += work.mode[i, j, D0_ETA] * eta_dot_dot
        rw += work.body[i, ALPHA] * c.mode[i, j, S] * eta_dot_dot
        rw += work.body[i, BETA] * c.mode[i, j, A] * eta_dot_dot
    for j in range(len(sizes.geometric)):
        along = c.body[i, INVERSE_MASS] * (pull + work.body[i, MEAN_RATES] + s * Aw) - Ax
        work.force[i, 1 + j] += work.mode[i, j, FX] * kx + work.mode[i, j, D0_ETA] * along
    return rx - pull, ry, rw + c.body[i, INVERSE_MASS] * s * pull


@merged
def _wrenches(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    acceleration: Array,
    work: Workspace,
) -> None:
    """Compute, inwards, the wrench at each root and the generalised force of each coordinate."""
    c = constants
    last = len(sizes.bodies) - 1
    kx = 0.0
    ky = 0.0
    kw = 0.0
    if len(sizes.tree) > 0:
        for i in range(len(sizes.bodies)):
            work.body[i, CARRIED_KX] = 0.0
            work.body[i, CARRIED_KY] = 0.0
            work.body[i, CARRIED_KW] = 0.0
    for back in range(len(sizes.bodies)):
        i = last - back
        if len(sizes.tree) > 0:
            kx, ky = work.body[i, CARRIED_KX], work.body[i, CARRIED_KY]
            kw = work.body[i, CARRIED_KW]
        kx = kx + c.body[i, TIP_MASS] * work.body[i, TIP_ACCELERATION_X]
        ky = ky + c.body[i, TIP_MASS] * work.body[i, TIP_ACCELERATION_Y]
        kw = kw + c.body[i, TIP_INERTIA] * work.body[i, TIP_ACCELERATION_W]
        for row in range(len(sizes.closures)):
            fx, fy, fw = closure_wrench(sizes, row, i, work)
            kx = kx - fx
            ky = ky - fy
            kw = kw - fw
        rx, ry, rw = body_wrench(sizes, c, i, acceleration, kx, ky, kw, work)
        passive = passive_torque(sizes, c, i, state, work)
        relative = acceleration[i, 0]
        carrier = work.body[i, ROOT_ACCELERATION_W] - relative
        needed = rw
        if len(sizes.tree) > 0:
            turns = 1.0 - c.body[i, SLIDES]
            carrier = work.body[i, ROOT_ACCELERATION_W] - turns * relative
            needed = turns * rw + c.body[i, SLIDE_X] * rx + c.body[i, SLIDE_Y] * ry
        rotor = rotor_moment(sizes, c, i, carrier, relative)
        work.force[i, 0] = c.body[i, FREE] * (needed + c.body[i, GEAR_RATIO] * rotor - passive)
        work.body[i, WRENCH_X] = rx
        work.body[i, WRENCH_Y] = ry
        work.body[i, WRENCH_W] = rw
        cosine = work.body[i, COSINE]
        sine = work.body[i, SINE]
        kx = cosine * rx - sine * ry
        ky = sine * rx + cosine * ry
        kw = rw + rotor
        if len(sizes.tree) > 0:
            kw = kw + work.body[i, ROOT_FROM_X] * ry - work.body[i, ROOT_FROM_Y] * rx
            if sizes.joints[i, 0] >= 0:
                work.body[sizes.joints[i, 0], CARRIED_KX] += kx
                work.body[sizes.joints[i, 0], CARRIED_KY] += ky
                work.body[sizes.joints[i, 0], CARRIED_KW] += kw


@compiled
def inverse_dynamics_many(
    sizes: Sizes,
    constants: ArmConstants,
    states: Array,
    accelerations: Array,
    loads: Loads,
    work: Workspace,
    forces: Array,
) -> None:
    """Compute the inverse dynamics of states (samples, 2, n, 1 + m).

    ``accelerations`` and the result ``forces`` have shape (samples, n, 1 + m).
    """
    for k in range(states.shape[0]):
        inverse_dynamics(sizes, constants, states[k], accelerations[k], loads, work)
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                forces[k, i, j] = work.force[i, j]
