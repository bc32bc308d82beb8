"""Observables of a state: poses, rates, energies.

Theory page "recursion", (R.20) to (R.23). World axes: origin at the base joint.

``POSE`` columns of a body: x, y of its joint and absolute angle of its axes (m, m, rad), and their
rates; then deflection and slope of its tip from the root tangent (m, rad), and their rates; then
x, y and angle of its tip section, and their rates.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.columns import (
    D0,
    D1,
    DP,
    FIRST_MOMENT_X,
    FIRST_MOMENT_Y,
    GRAVITY_X,
    GRAVITY_Y,
    HUB,
    INERTIA,
    INVERSE_INERTIA,
    INVERSE_MASS,
    JOINT_ANGLE,
    LENGTH,
    MASS,
    SLIDE_X,
    SLIDE_Y,
    SLIDES,
    TIP_INERTIA,
    TIP_MASS,
    W2,
    A,
    G,
    P,
    S,
)
from flexarm.kernels.compilation.cache import compiled, merged, unlocked
from flexarm.kernels.compilation.numbers import cos, sin, sqrt
from flexarm.kernels.forces.joint_law import joint_energy, rotor_energy
from flexarm.kernels.kinematics import root_from_section
from flexarm.kernels.layout import ArmConstants, Array, Sizes

#: Number of columns of a pose; see the module's docstring.
POSE_COLUMNS = 16


@compiled
def poses(
    sizes: Sizes, constants: ArmConstants, state: Array, body_poses: Array, tip: Array
) -> None:
    """Fill ``body_poses`` (n, 16) and ``tip`` (6,): x, y, angle of the last tip and their rates."""
    c = constants
    x = 0.0
    y = 0.0
    angle = 0.0
    x_dot = 0.0
    y_dot = 0.0
    rate = 0.0
    for i in range(len(sizes.bodies)):
        turned = state[0, i, 0]
        turning = state[1, i, 0]
        if len(sizes.tree) > 0:
            x, y, angle, x_dot, y_dot, rate = _root(sizes, c, i, state, body_poses)
            turned = turned * (1.0 - c.body[i, SLIDES])
            turning = turning * (1.0 - c.body[i, SLIDES])
        angle = angle + c.body[i, JOINT_ANGLE] + turned
        rate = rate + turning
        phi = 0.0
        phi_dot = 0.0
        v_tip = 0.0
        v_tip_dot = 0.0
        for j in range(len(sizes.modes)):
            phi += c.mode[i, j, DP] * state[0, i, 1 + j]
            phi_dot += c.mode[i, j, DP] * state[1, i, 1 + j]
            v_tip += c.mode[i, j, P] * state[0, i, 1 + j]
            v_tip_dot += c.mode[i, j, P] * state[1, i, 1 + j]
        u_tip = 0.0
        u_tip_dot = 0.0
        for j in range(len(sizes.geometric)):
            for k in range(len(sizes.geometric)):
                u_tip -= 0.5 * state[0, i, 1 + j] * c.shortening[i, j, k, G] * state[0, i, 1 + k]
                u_tip_dot -= state[1, i, 1 + j] * c.shortening[i, j, k, G] * state[0, i, 1 + k]
        body_poses[i, 0] = x
        body_poses[i, 1] = y
        body_poses[i, 2] = angle
        body_poses[i, 3] = x_dot
        body_poses[i, 4] = y_dot
        body_poses[i, 5] = rate
        body_poses[i, 6] = v_tip
        body_poses[i, 7] = phi
        body_poses[i, 8] = v_tip_dot
        body_poses[i, 9] = phi_dot
        cosine = cos(angle)
        sine = sin(angle)
        x_tip = c.body[i, LENGTH] + u_tip
        vx = u_tip_dot - rate * v_tip
        vy = v_tip_dot + rate * x_tip
        x = x + cosine * x_tip - sine * v_tip
        y = y + sine * x_tip + cosine * v_tip
        x_dot = x_dot + cosine * vx - sine * vy
        y_dot = y_dot + sine * vx + cosine * vy
        angle = angle + phi
        rate = rate + phi_dot
        body_poses[i, 10] = x
        body_poses[i, 11] = y
        body_poses[i, 12] = angle
        body_poses[i, 13] = x_dot
        body_poses[i, 14] = y_dot
        body_poses[i, 15] = rate
    tip[0] = x
    tip[1] = y
    tip[2] = angle
    tip[3] = x_dot
    tip[4] = y_dot
    tip[5] = rate


@merged
def _root(
    sizes: Sizes, constants: ArmConstants, i: int, state: Array, body_poses: Array
) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return position of the root of body i and angle of the section below, and their rates."""
    c = constants
    x, y, angle, x_dot, y_dot, rate = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    carrier = sizes.joints[i, 0]
    if carrier >= 0:
        x, y, angle = (
            body_poses[carrier, 10],
            body_poses[carrier, 11],
            body_poses[carrier, 12],
        )
        x_dot, y_dot, rate = (
            body_poses[carrier, 13],
            body_poses[carrier, 14],
            body_poses[carrier, 15],
        )
    from_x, from_y = root_from_section(sizes, c, i, state)
    turned = angle + c.body[i, JOINT_ANGLE] + state[0, i, 0] * (1.0 - c.body[i, SLIDES])
    cosine = cos(turned)
    sine = sin(turned)
    along = cosine * from_x - sine * from_y
    across = sine * from_x + cosine * from_y
    slide_x = cosine * c.body[i, SLIDE_X] - sine * c.body[i, SLIDE_Y]
    slide_y = sine * c.body[i, SLIDE_X] + cosine * c.body[i, SLIDE_Y]
    x_dot = x_dot - rate * across + slide_x * state[1, i, 0]
    y_dot = y_dot + rate * along + slide_y * state[1, i, 0]
    return x + along, y + across, angle, x_dot, y_dot, rate


@unlocked
def poses_many(
    sizes: Sizes, constants: ArmConstants, states: Array, body_poses: Array, tips: Array
) -> None:
    """Fill poses (k, n, 16) and tips (k, 6) of states (k, 2, n, 1 + m)."""
    for k in range(states.shape[0]):
        poses(sizes, constants, states[k], body_poses[k], tips[k])


@compiled
def energies(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    body_poses: Array,
    tip: Array,
    energy: Array,
) -> None:
    """Fill ``energy`` (3,): kinetic, strain, gravity, in J; zero gravity energy at the base.

    Strain energy includes that of springs, bristles and stops at the joints. ``body_poses`` and
    ``tip`` are filled as in ``poses``.
    """
    c = constants
    poses(sizes, constants, state, body_poses, tip)
    kinetic = 0.0
    strain = 0.0
    potential = 0.0
    for i in range(len(sizes.bodies)):
        strain += joint_energy(sizes, c, i, state[0, i, 0])
        angle = body_poses[i, 2]
        w = body_poses[i, 5]
        cosine = cos(angle)
        sine = sin(angle)
        Vx = cosine * body_poses[i, 3] + sine * body_poses[i, 4]
        Vy = cosine * body_poses[i, 4] - sine * body_poses[i, 3]
        s = c.body[i, FIRST_MOMENT_Y]
        s_dot = 0.0
        spread = 0.0
        turning = 0.0  # a . eta_dot
        modal = 0.0  # |eta_dot|^2
        for j in range(len(sizes.modes)):
            eta = state[0, i, 1 + j]
            eta_dot = state[1, i, 1 + j]
            s += c.mode[i, j, S] * eta
            s_dot += c.mode[i, j, S] * eta_dot
            spread_eta = eta
            for k in range(len(sizes.centrifugal)):
                spread_eta += c.centrifugal[i, j, k] * state[0, i, 1 + k]
            spread += eta * spread_eta
            turning += c.mode[i, j, A] * eta_dot
            modal += eta_dot * eta_dot
            strain += 0.5 * c.mode[i, j, W2] * eta * eta
        mu = 0.0
        mu_dot = 0.0
        chi = 0.0
        for j in range(len(sizes.geometric)):
            for k in range(len(sizes.geometric)):
                mu -= 0.5 * state[0, i, 1 + j] * c.shortening[i, j, k, D0] * state[0, i, 1 + k]
                chi -= 0.5 * state[0, i, 1 + j] * c.shortening[i, j, k, D1] * state[0, i, 1 + k]
                mu_dot -= state[1, i, 1 + j] * c.shortening[i, j, k, D0] * state[0, i, 1 + k]
        # The rigid motion equivalent to the shortening, (L.44), is added to that of the root.
        mean = c.body[i, INVERSE_MASS]
        y = (
            2.0
            * c.body[i, INVERSE_INERTIA]
            * (chi - mean * mu * (c.body[i, FIRST_MOMENT_X] + 0.5 * mu))
        )
        beta = sqrt(1.0 + y + 0.125 * y * y * y * y) - 1.0
        Vx += mean * mu_dot
        Vy += mean * (mu - c.body[i, FIRST_MOMENT_X] * beta) * w
        turn = w + beta * w
        kinetic += 0.5 * c.body[i, MASS] * (Vx * Vx + Vy * Vy)
        kinetic += Vy * (turn * c.body[i, FIRST_MOMENT_X] + s_dot) - Vx * w * s
        kinetic += (
            0.5 * turn * turn * (c.body[i, INERTIA] - c.body[i, HUB]) + turn * turning + 0.5 * modal
        )
        kinetic += 0.5 * w * w * (c.body[i, HUB] + spread)
        if len(sizes.bristles) > 0:
            bent = 0.5 * state[1, i, len(sizes.modes)] * state[1, i, len(sizes.modes)]
            kinetic -= bent  # part of ``modal``
            strain += bent
        first_moment = c.body[i, FIRST_MOMENT_X] + mu
        # Centre of mass times mass, in world axes.
        mx = c.body[i, MASS] * body_poses[i, 0] + cosine * first_moment - sine * s
        my = c.body[i, MASS] * body_poses[i, 1] + sine * first_moment + cosine * s
        # Mass and inertia at the tip.
        tx = body_poses[i, 10]
        ty = body_poses[i, 11]
        tx_dot = body_poses[i, 13]
        ty_dot = body_poses[i, 14]
        carrier = w - state[1, i, 0]
        if len(sizes.tree) > 0 and sizes.joints[i, 1] > 0:
            carrier = w
        kinetic += rotor_energy(sizes, c, i, carrier, state[1, i, 0])
        tip_rate = w + body_poses[i, 9]
        kinetic += 0.5 * c.body[i, TIP_MASS] * (tx_dot * tx_dot + ty_dot * ty_dot)
        kinetic += 0.5 * c.body[i, TIP_INERTIA] * tip_rate * tip_rate
        mx += c.body[i, TIP_MASS] * tx
        my += c.body[i, TIP_MASS] * ty
        potential -= c.arm[GRAVITY_X] * mx + c.arm[GRAVITY_Y] * my
    energy[0] = kinetic
    energy[1] = strain
    energy[2] = potential


@unlocked
def observe_many(
    sizes: Sizes,
    constants: ArmConstants,
    states: Array,
    body_poses: Array,
    tips: Array,
    energy: Array,
) -> None:
    """Fill poses (k, n, 16), tips (k, 6) and energies (k, 3) of states (k, 2, n, 1 + m)."""
    for k in range(states.shape[0]):
        energies(sizes, constants, states[k], body_poses[k], tips[k], energy[k])
