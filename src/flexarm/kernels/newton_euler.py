"""Inverse dynamics in O(n m): the forces that a given motion takes, and the joint reactions.

Theory page "recursion", (R.15) to (R.17). Symbols as in ``articulated_body``.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.cache import compiled, merged
from flexarm.kernels.external import apply_loads
from flexarm.kernels.joint_law import passive_torque, rotor_moment
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace


@compiled
def inverse_dynamics(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    acceleration: Array,
    loads: Loads,
    work: Workspace,
) -> None:
    """Write generalised forces (n, 1 + m) into ``work.force`` and reactions into ``work.wrench``.

    ``acceleration`` (n, 1 + m). The force is M qdd + bias: with stiffness, damping and gravity. The
    wrench (n, 3) is what the joint gives to its body, at the joint, in the body's axes.
    """
    link_terms(sizes, constants, state, work)
    apply_loads(sizes, constants.P, loads, state, work)
    _accelerations(sizes, constants, acceleration, loads, work)
    _wrenches(sizes, constants, state, acceleration, work)


@merged
def _accelerations(
    sizes: Sizes, constants: ArmConstants, acceleration: Array, loads: Loads, work: Workspace
) -> None:
    """Outwards: accelerations of each body's root and tip, in the body's axes."""
    c = constants
    Ax = loads.base_acceleration[0] - c.gravity[0]
    Ay = loads.base_acceleration[1] - c.gravity[1]
    Aw = 0.0
    for i in range(len(sizes.bodies)):
        cosine = work.rotation[i, 0]
        sine = work.rotation[i, 1]
        turned = cosine * Ax + sine * Ay
        Ay = cosine * Ay - sine * Ax
        Ax = turned
        Aw = Aw + acceleration[i, 0]
        work.root_acceleration[i, 0] = Ax
        work.root_acceleration[i, 1] = Ay
        work.root_acceleration[i, 2] = Aw
        tip_x = Ax - work.tip[i, 1] * Aw + work.tip_bias[i, 0]
        tip_y = Ay + work.tip[i, 0] * Aw + work.tip_bias[i, 1]
        tip_w = Aw
        for j in range(len(sizes.modes)):
            tip_y += c.P[i, j] * acceleration[i, 1 + j]
            tip_w += c.dP[i, j] * acceleration[i, 1 + j]
        for j in range(len(sizes.geometric)):
            tip_x += work.Fx[i, j] * acceleration[i, 1 + j]
        Ax = tip_x
        Ay = tip_y
        Aw = tip_w
        work.tip_acceleration[i, 0] = tip_x
        work.tip_acceleration[i, 1] = tip_y
        work.tip_acceleration[i, 2] = tip_w


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
    """Wrench (Fx, Fy, Mz) that body i takes at its root, body axes: (R.16) of one body.

    With (kx, ky, kw) what its tip gives to the chain; ``work`` after ``link_terms`` and
    ``apply_loads``, with the accelerations of roots. Writes the modes' forces, (R.17), too.
    """
    c = constants
    Ax = work.root_acceleration[i, 0]
    Ay = work.root_acceleration[i, 1]
    Aw = work.root_acceleration[i, 2]
    s = work.moment[i, 0]
    first_moment = c.first_moment_x[i] + work.moment[i, 1]
    inertia = c.inertia[i] + work.moment[i, 2]
    rx = work.root_bias[i, 0] + c.mass[i] * Ax - s * Aw + kx
    ry = work.root_bias[i, 1] + c.mass[i] * Ay + first_moment * Aw + ky
    rw = work.root_bias[i, 2] - s * Ax + first_moment * Ay + inertia * Aw
    rw += work.tip[i, 0] * ky - work.tip[i, 1] * kx + kw
    rising = Ay
    turning = Aw
    for _ in range(min(len(sizes.geometric), 1)):
        rising += work.rigid_shortening[i, 0] * Aw
        turning += work.rigid_shortening[i, 1] * Aw
    for j in range(len(sizes.modes)):
        eta_dot_dot = acceleration[i, 1 + j]
        ry += c.S[i, j] * eta_dot_dot
        rw += c.a[i, j] * eta_dot_dot
        work.force[i, 1 + j] = (
            c.S[i, j] * rising
            + c.a[i, j] * turning
            + eta_dot_dot
            + work.flex_bias[i, j]
            + c.P[i, j] * ky
            + c.dP[i, j] * kw
        )
    pull = 0.0  # d . eta''
    for j in range(len(sizes.geometric)):
        eta_dot_dot = acceleration[i, 1 + j]
        pull += work.shortening[i, j] * eta_dot_dot
        rw += work.rigid_shortening[i, 0] * c.S[i, j] * eta_dot_dot
        rw += work.rigid_shortening[i, 1] * c.a[i, j] * eta_dot_dot
    for j in range(len(sizes.geometric)):
        along = c.inverse_mass[i] * (pull + work.mean_shortening[i, 0] + s * Aw) - Ax
        work.force[i, 1 + j] += work.Fx[i, j] * kx + work.shortening[i, j] * along
    return rx - pull, ry, rw + c.inverse_mass[i] * s * pull


@merged
def _wrenches(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    acceleration: Array,
    work: Workspace,
) -> None:
    """Inwards: wrench at each root, generalised force of each coordinate."""
    c = constants
    last = len(sizes.bodies) - 1
    kx = 0.0
    ky = 0.0
    kw = 0.0
    for back in range(len(sizes.bodies)):
        i = last - back
        kx = kx + c.tip_mass[i] * work.tip_acceleration[i, 0]
        ky = ky + c.tip_mass[i] * work.tip_acceleration[i, 1]
        kw = kw + c.tip_inertia[i] * work.tip_acceleration[i, 2]
        rx, ry, rw = body_wrench(sizes, c, i, acceleration, kx, ky, kw, work)
        passive = passive_torque(sizes, c, i, state[0, i, 0], state[1, i, 0])
        relative = acceleration[i, 0]
        rotor = rotor_moment(sizes, c, i, work.root_acceleration[i, 2] - relative, relative)
        work.force[i, 0] = c.free[i] * (rw + c.rotor[i, 1] * rotor - passive)
        work.wrench[i, 0] = rx
        work.wrench[i, 1] = ry
        work.wrench[i, 2] = rw
        cosine = work.rotation[i, 0]
        sine = work.rotation[i, 1]
        kx = cosine * rx - sine * ry
        ky = sine * rx + cosine * ry
        kw = rw + rotor


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
    """Inverse dynamics of many states: (samples, 2, n, 1 + m), (samples, n, 1 + m)."""
    for k in range(states.shape[0]):
        inverse_dynamics(sizes, constants, states[k], accelerations[k], loads, work)
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                forces[k, i, j] = work.force[i, j]
