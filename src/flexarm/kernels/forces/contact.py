"""Contact of points of the arm with fixed surfaces: theory page "contact".

Where a point penetrates a surface, the surface pushes along its normal by the law of Hunt and
Crossley, and friction acts across the normal.

=============  =================================================================================
symbol         meaning
=============  =================================================================================
``gap``        distance of the point from the surface, negative for a penetration, m
``n``          unit normal of the surface, pointing away from the solid
``bend``       curvature of the surface, 1/m, positive if it is convex towards the point
``depth``      max(-gap, 0), with a rounded corner
=============  =================================================================================

Only ``BY_SIGN`` and the nearest point of a table branch on the state, by real parts alone.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.columns import (
    COSINE,
    FX,
    JOINT_ANGLE,
    RATE,
    ROOT_FROM_X,
    ROOT_FROM_Y,
    SINE,
    SLIDE_X,
    SLIDE_Y,
    SLIDES,
    TIP_RATE,
    TIP_SLOPE,
    TIP_X,
    TIP_Y,
    WORLD_COSINE,
    WORLD_SINE,
    WORLD_TIP_ANGLE,
    WORLD_TIP_X,
    WORLD_TIP_X_RATE,
    WORLD_TIP_Y,
    WORLD_TIP_Y_RATE,
    WORLD_X,
    WORLD_X_RATE,
    WORLD_Y,
    WORLD_Y_RATE,
    P,
)
from flexarm.kernels.compilation.cache import apart, compiled, merged
from flexarm.kernels.compilation.numbers import exp, log, positive_part, real, tanh
from flexarm.kernels.forces.push import push_at
from flexarm.kernels.forces.surface import nearest
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Array, Contacts, Sizes, Workspace

#: Columns of a row of ``Contacts.law``. WEIGHT 0 removes the force. The columns of
#: ``forces.surface`` begin at SURFACE. MOBILITY of the arm at the point, 1/kg: integrators estimate
#: the duration of a contact from it. CORNER: rounding radius of the depth, m.
WEIGHT, LEVER = 0, 1
STIFFNESS, EXPONENT, DAMPING, FRICTION, FRICTION_SPEED = 2, 3, 4, 5, 6
SURFACE, MOBILITY, CORNER = 7, 14, 15

#: Columns of the result of ``look_many``: world position and velocity of the point, force on it,
#: gap, curvature of the surface, energy stored in the contact.
POSITION, VELOCITY, FORCE, GAP, BEND, ENERGY = 0, 2, 4, 6, 7, 8
#: More columns of ``Contacts.seen``: speed of penetration, and the branch of the law.
CLOSING, BRANCH = 9, 10
#: Branches of the law. Integrators fix one for a step: no force, or that of a spring, which the
#: law continues smoothly beyond the surface; or the one of both by the signs of gap and push.
ROUNDED, BY_SIGN, PUSHING, OPEN = 0.0, 1.0, 2.0, 3.0

#: Rounding radius of the depth relative to the reach: far below any measurable length, far above
#: rounding errors.
CORNER_SHARE = 1e-9
#: Rounding radius of the relative increase of the force by damping.
PUSH = 1e-6
_TINY = 1e-300


@merged
def _power(depth: Any, exponent: Any) -> Any:
    """Return depth |depth|^(exponent - 1) for an exponent >= 1; exactly the depth for 1."""
    return depth * exp(0.5 * (exponent - 1.0) * log(depth * depth + _TINY))


@merged
def place_bodies(sizes: Sizes, constants: ArmConstants, state: Array, work: Workspace) -> None:
    """Fill the WORLD columns: angle, position and velocity of each body's root in world axes."""
    cosine = 1.0 + 0.0 * work.body[0, COSINE]
    sine = 0.0 * cosine
    x = 0.0 * cosine
    y = 0.0 * cosine
    x_dot = 0.0 * cosine
    y_dot = 0.0 * cosine
    for i in range(len(sizes.bodies)):
        if len(sizes.tree) > 0:
            cosine, sine = world_section(sizes, i, work)
        turned = cosine * work.body[i, COSINE] - sine * work.body[i, SINE]
        sine = sine * work.body[i, COSINE] + cosine * work.body[i, SINE]
        cosine = turned
        if len(sizes.tree) > 0:
            x, y, x_dot, y_dot = _world_root(sizes, constants, i, state, cosine, sine, work)
        work.body[i, WORLD_COSINE] = cosine
        work.body[i, WORLD_SINE] = sine
        work.body[i, WORLD_X] = x
        work.body[i, WORLD_Y] = y
        work.body[i, WORLD_X_RATE] = x_dot
        work.body[i, WORLD_Y_RATE] = y_dot
        u_dot = 0.0
        v_dot = 0.0
        for j in range(len(sizes.modes)):
            v_dot += constants.mode[i, j, P] * state[1, i, 1 + j]
        for j in range(len(sizes.geometric)):
            u_dot += work.mode[i, j, FX] * state[1, i, 1 + j]
        vx = u_dot - work.body[i, RATE] * work.body[i, TIP_Y]
        vy = v_dot + work.body[i, RATE] * work.body[i, TIP_X]
        x = x + cosine * work.body[i, TIP_X] - sine * work.body[i, TIP_Y]
        y = y + sine * work.body[i, TIP_X] + cosine * work.body[i, TIP_Y]
        x_dot = x_dot + cosine * vx - sine * vy
        y_dot = y_dot + sine * vx + cosine * vy
        if len(sizes.tree) > 0:
            work.body[i, WORLD_TIP_X], work.body[i, WORLD_TIP_Y] = x, y
            work.body[i, WORLD_TIP_ANGLE] = _section_angle(sizes, constants, i, state, work)
            work.body[i, WORLD_TIP_X_RATE], work.body[i, WORLD_TIP_Y_RATE] = x_dot, y_dot


@merged
def world_section(sizes: Sizes, i: int, work: Workspace) -> Any:
    """Return cosine and sine of the axes to which the rotation of body i in a tree refers."""
    cosine, sine = 1.0, 0.0
    carrier = sizes.joints[i, 0]
    if carrier >= 0:
        cosine, sine = work.body[carrier, WORLD_COSINE], work.body[carrier, WORLD_SINE]
    return cosine, sine


@merged
def _section_angle(
    sizes: Sizes, constants: ArmConstants, i: int, state: Array, work: Workspace
) -> Any:
    """Return the absolute angle of the tip section of body i of a tree."""
    angle = 0.0
    carrier = sizes.joints[i, 0]
    if carrier >= 0:
        angle = work.body[carrier, WORLD_TIP_ANGLE]
    turned = state[0, i, 0] * (1.0 - constants.body[i, SLIDES])
    return angle + constants.body[i, JOINT_ANGLE] + turned + work.body[i, TIP_SLOPE]


@merged
def _world_root(
    sizes: Sizes, constants: ArmConstants, i: int, state: Array, cosine: Any, sine: Any,
    work: Workspace,
) -> Any:  # fmt: skip
    """Return world position and velocity of the root of body i of a tree, whose axes are known."""
    x, y, x_dot, y_dot, rate = 0.0, 0.0, 0.0, 0.0, 0.0
    carrier = sizes.joints[i, 0]
    if carrier >= 0:
        x, y = work.body[carrier, WORLD_TIP_X], work.body[carrier, WORLD_TIP_Y]
        x_dot = work.body[carrier, WORLD_TIP_X_RATE]
        y_dot = work.body[carrier, WORLD_TIP_Y_RATE]
        rate = work.body[carrier, TIP_RATE]
    along = cosine * work.body[i, ROOT_FROM_X] - sine * work.body[i, ROOT_FROM_Y]
    across = sine * work.body[i, ROOT_FROM_X] + cosine * work.body[i, ROOT_FROM_Y]
    slide_x = cosine * constants.body[i, SLIDE_X] - sine * constants.body[i, SLIDE_Y]
    slide_y = sine * constants.body[i, SLIDE_X] + cosine * constants.body[i, SLIDE_Y]
    x_dot = x_dot - rate * across + slide_x * state[1, i, 0]
    y_dot = y_dot + rate * along + slide_y * state[1, i, 0]
    return x + along, y + across, x_dot, y_dot


@merged
def motion_of_point(
    sizes: Sizes, contacts: Contacts, k: int, state: Array, work: Workspace
) -> tuple[Any, Any, Any, Any]:
    """Return world position and velocity of the point of contact k, after ``place_bodies``."""
    i = contacts.body[k]
    v = 0.0
    v_dot = 0.0
    for j in range(len(sizes.modes)):
        v += contacts.rows[k, j] * state[0, i, 1 + j]
        v_dot += contacts.rows[k, j] * state[1, i, 1 + j]
    x = contacts.law[k, LEVER]
    u_dot = 0.0
    for j in range(len(sizes.geometric)):
        drawn = 0.0
        for p in range(len(sizes.geometric)):
            drawn += contacts.shortening[k, j, p] * state[0, i, 1 + p]
        x -= 0.5 * state[0, i, 1 + j] * drawn
        u_dot -= state[1, i, 1 + j] * drawn
    cosine = work.body[i, WORLD_COSINE]
    sine = work.body[i, WORLD_SINE]
    vx = u_dot - work.body[i, RATE] * v
    vy = v_dot + work.body[i, RATE] * x
    return (
        work.body[i, WORLD_X] + cosine * x - sine * v,
        work.body[i, WORLD_Y] + sine * x + cosine * v,
        work.body[i, WORLD_X_RATE] + cosine * vx - sine * vy,
        work.body[i, WORLD_Y_RATE] + sine * vx + cosine * vy,
    )


@merged
def _force(
    contacts: Contacts, k: int, branch: float, gap: Any, closing: Any, nx: Any, ny: Any, vx: Any,
    vy: Any,
) -> tuple[Any, Any]:  # fmt: skip
    """Return the world force on the point of contact k: (T.5) normal, (T.6) tangential."""
    law = contacts.law
    depth = -gap
    push = 1.0 + law[k, DAMPING] * closing
    # A surface never pulls, however fast the point leaves it.
    if branch == ROUNDED:
        depth = positive_part(depth, law[k, CORNER])
        push = positive_part(push, PUSH)
    elif branch == OPEN or (branch == BY_SIGN and (real(gap) >= 0.0 or real(push) <= 0.0)):
        depth = 0.0 * depth
    normal = law[k, STIFFNESS] * _power(depth, law[k, EXPONENT]) * push
    sliding = ny * vx - nx * vy
    rub = -law[k, FRICTION] * normal * tanh(sliding / law[k, FRICTION_SPEED])
    return normal * nx + rub * ny, normal * ny - rub * nx


@merged
def force_on_point(contacts: Contacts, k: int, x: Any, y: Any, vx: Any, vy: Any) -> tuple[Any, Any]:
    """Return the world force on the point of contact k at a world position and velocity.

    The real parts of all but the energy are written to ``seen``.
    """
    gap, nx, ny, bend = nearest(contacts.law, k, SURFACE, contacts.knots, x, y)
    closing = -(nx * vx + ny * vy)
    branch = contacts.seen[1, k, BRANCH]
    fx, fy = _force(contacts, k, branch, gap, closing, nx, ny, vx, vy)
    contacts.seen[1, k, CLOSING] = real(closing)
    contacts.seen[1, k, POSITION] = real(x)
    contacts.seen[1, k, POSITION + 1] = real(y)
    contacts.seen[1, k, FORCE] = real(fx)
    contacts.seen[1, k, FORCE + 1] = real(fy)
    contacts.seen[1, k, GAP] = real(gap)
    contacts.seen[1, k, BEND] = real(bend)
    contacts.seen[1, k, VELOCITY] = real(vx)
    contacts.seen[1, k, VELOCITY + 1] = real(vy)
    return fx, fy


@merged
def push_back(
    sizes: Sizes, contacts: Contacts, k: int, fx: Any, fy: Any, state: Array, work: Workspace
) -> None:
    """Subtract the world force of contact k from the biases, after ``place_bodies``."""
    i = contacts.body[k]
    weight = contacts.law[k, WEIGHT]
    along = weight * (work.body[i, WORLD_COSINE] * fx + work.body[i, WORLD_SINE] * fy)
    across = weight * (work.body[i, WORLD_COSINE] * fy - work.body[i, WORLD_SINE] * fx)
    push_at(
        sizes, contacts.rows, contacts.shortening, k, i, 1.0, contacts.law[k, LEVER], along,
        across, state, work,
    )  # fmt: skip


@apart
def touch(
    sizes: Sizes, constants: ArmConstants, contacts: Contacts, state: Array, work: Workspace
) -> None:
    """Subtract the contact forces from the biases computed by ``link_terms``."""
    place_bodies(sizes, constants, state, work)
    for k in range(contacts.body.shape[0]):
        x, y, vx, vy = motion_of_point(sizes, contacts, k, state, work)
        fx, fy = force_on_point(contacts, k, x, y, vx, vy)
        push_back(sizes, contacts, k, fx, fy, state, work)


@compiled
def look_many(
    sizes: Sizes,
    constants: ArmConstants,
    contacts: Contacts,
    states: Array,
    work: Workspace,
    values: Array,
) -> None:
    """Fill ``values`` (samples, k, 9) for states (samples, 2, n, 1 + m), with the columns above."""
    for sample in range(states.shape[0]):
        state = states[sample]
        link_terms(sizes, constants, state, work)
        place_bodies(sizes, constants, state, work)
        for k in range(contacts.body.shape[0]):
            x, y, vx, vy = motion_of_point(sizes, contacts, k, state, work)
            gap, nx, ny, bend = nearest(contacts.law, k, SURFACE, contacts.knots, x, y)
            closing = -(nx * vx + ny * vy)
            fx, fy = _force(contacts, k, ROUNDED, gap, closing, nx, ny, vx, vy)
            above = contacts.law[k, EXPONENT] + 1.0
            stored = _power(positive_part(-gap, contacts.law[k, CORNER]), above) / above
            values[sample, k, POSITION] = x
            values[sample, k, POSITION + 1] = y
            values[sample, k, VELOCITY] = vx
            values[sample, k, VELOCITY + 1] = vy
            values[sample, k, FORCE] = fx
            values[sample, k, FORCE + 1] = fy
            values[sample, k, GAP] = gap
            values[sample, k, BEND] = bend
            values[sample, k, ENERGY] = contacts.law[k, STIFFNESS] * stored
