"""Forces that close the loops of a mechanism, and their effect on its accelerations.

Theory page "mechanisms", (M.10) to (M.16), (M.25). A row is one equation ``g = 0`` of a closure
between two tip sections, or one and the ground. Its wrenches on both are a row of the Jacobian
``J``. They travel inwards through the bodies as biases do, and give ``J M^-1 J'`` as a sum over the
bodies, without a sum over modes. The modes stay eliminated.

=============  =================================================================================
symbol         meaning
=============  =================================================================================
``d``, ``n``   first point minus second point; direction of the row (world axes)
``o``          point from the axis of its section (world axes)
``k``, ``h``   bias of a row at the tip of a body, at its root (axes of the body)
``m``          ``(1 - Y N) k``: what the modes pass on of ``k``
``drive``      effect of the row on the joint, ``-s . h``
``lambda``     multiplier: force of the closure on the first point, N or N m
=============  =================================================================================
"""

from __future__ import annotations

import math
from typing import Any

from flexarm.kernels.compilation.cache import apart, compiled, merged
from flexarm.kernels.compilation.numbers import cos, real, sin
from flexarm.kernels.forces.contact import place_bodies
from flexarm.kernels.forces.surface import nearest
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.outward import spread
from flexarm.kernels.recursion.symmetric import read_symmetric

# isort: off
from flexarm.kernels.columns import (
    BENT_N_XX, BIAS_KW, BIAS_KX, BIAS_KY, CARRIED_XX, CLOSURE_ANGLE, COSINE, CURVE_CURVATURE,
    DRIFT_W, DRIFT_X, DRIFT_Y, EXTRA, FIRST_WRENCH_W, FIRST_WRENCH_X, FIRST_WRENCH_Y, FIRST_X,
    FIRST_Y, FLEX_BIAS, GAIN_WK, GAIN_XK, GAIN_YK, GAP, GAP_RATE, GRAVITY_X, GRAVITY_Y,
    JOINT_BIAS_X, JOINT_BIAS_Y, JOINT_DRIVE, JOINT_GIVEN, JOINT_INVERSE, JOINT_UW, JOINT_UX,
    JOINT_UY, MEAN_LAG, MULTIPLIER, N_WW, N_YW, N_YY, PASSED_DRIVE, PASSED_W, PASSED_X, PASSED_Y,
    RELATIVE, ROOT_FROM_X, ROOT_FROM_Y, SECOND_WRENCH_W, SECOND_WRENCH_X, SECOND_WRENCH_Y,
    SECOND_X, SECOND_Y, SINE, SLIDES, SLIDE_X, SLIDE_Y, TIP_RATE, TIP_SLOPE, TRANSFER_WW,
    TRANSFER_WX, TRANSFER_WY, TRANSFER_XW, TRANSFER_XX, TRANSFER_XY, TRANSFER_YW, TRANSFER_YX,
    TRANSFER_YY, WORLD_COSINE, WORLD_SINE, WORLD_TIP_ANGLE,
    WORLD_TIP_X, WORLD_TIP_X_RATE, WORLD_TIP_Y, WORLD_TIP_Y_RATE,
)  # fmt: skip
# isort: on

#: Kinds of rows in ``Sizes.ends``: equal x or y of both points, equal angles, a point on a line or
#: on a curve.
ROW_X, ROW_Y, ROW_ANGLE, ROW_LINE, ROW_CURVE = range(5)
#: Rows of each kind of closure.
ROWS = {
    "pin": (ROW_X, ROW_Y),
    "weld": (ROW_X, ROW_Y, ROW_ANGLE),
    "line": (ROW_LINE,),
    "curve": (ROW_CURVE,),
}


@merged
def _point(i: int, x: Any, y: Any, work: Workspace) -> Any:
    """Return place, velocity, ``o``, angle and rate of a point at (x, y) in the axes of the tip
    section of body i; for the ground (i < 0), of the fixed point (x, y)."""
    place_x, place_y = x, y
    vx, vy, ox, oy, angle, rate = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if i >= 0:
        slope_cosine = cos(work.body[i, TIP_SLOPE])
        slope_sine = sin(work.body[i, TIP_SLOPE])
        along = slope_cosine * x - slope_sine * y
        across = slope_sine * x + slope_cosine * y
        ox = work.body[i, WORLD_COSINE] * along - work.body[i, WORLD_SINE] * across
        oy = work.body[i, WORLD_SINE] * along + work.body[i, WORLD_COSINE] * across
        rate = work.body[i, TIP_RATE]
        angle = work.body[i, WORLD_TIP_ANGLE]
        place_x = work.body[i, WORLD_TIP_X] + ox
        place_y = work.body[i, WORLD_TIP_Y] + oy
        vx = work.body[i, WORLD_TIP_X_RATE] - rate * oy
        vy = work.body[i, WORLD_TIP_Y_RATE] + rate * ox
    return place_x, place_y, vx, vy, ox, oy, angle, rate


@apart
def _curve(constants: ArmConstants, c: int, cosine: Any, sine: Any, dx: Any, dy: Any) -> Any:
    """Return gap, normal and curvature of a curve through the first point of row c.

    The axes of the curve are turned by an angle with ``cosine`` and ``sine``; d and n are in world
    axes. At a gap, the curvature is that of the parallel curve through the point.
    """
    x, y = cosine * dx + sine * dy, cosine * dy - sine * dx
    gap, nx, ny, bend = nearest(constants.closure, c, CURVE_CURVATURE, constants.knots, x, y)
    return (
        gap,
        cosine * nx - sine * ny,
        sine * nx + cosine * ny,
        bend / (1.0 + bend * gap),
    )


@merged
def closure_rows(sizes: Sizes, constants: ArmConstants, work: Workspace) -> None:
    """Fill gaps, their rates, velocity products and wrenches, after ``place_bodies``."""
    for c in range(len(sizes.closures)):
        row = work.closure
        kind = sizes.ends[c, 0]
        ax, ay, avx, avy, aox, aoy, a_angle, wa = _point(
            sizes.ends[c, 1], constants.closure[c, FIRST_X], constants.closure[c, FIRST_Y], work
        )
        bx, by, bvx, bvy, box, boy, b_angle, wb = _point(
            sizes.ends[c, 2], constants.closure[c, SECOND_X], constants.closure[c, SECOND_Y], work
        )
        if kind == ROW_ANGLE:
            turned = a_angle - b_angle - constants.closure[c, CLOSURE_ANGLE]
            row[c, GAP] = turned - 2.0 * math.pi * round(real(turned) / (2.0 * math.pi))
            row[c, GAP_RATE] = wa - wb
            row[c, EXTRA] = 0.0 * wa
            for p in range(6):
                row[c, FIRST_WRENCH_X + p] = 0.0
            row[c, FIRST_WRENCH_W] = 1.0
            row[c, SECOND_WRENCH_W] = -1.0
            continue
        dx, dy, ux, uy = ax - bx, ay - by, avx - bvx, avy - bvy
        nx, ny = 1.0 + 0.0 * wb, 0.0 * wb
        turn = 0.0 * wb  # rate of the direction
        if kind == ROW_Y:
            nx, ny = ny, nx
        elif kind == ROW_LINE:
            nx = -sin(b_angle + constants.closure[c, CLOSURE_ANGLE])
            ny = cos(b_angle + constants.closure[c, CLOSURE_ANGLE])
            turn = wb
        bend = 0.0 * wb
        if kind == ROW_CURVE:
            angle = b_angle + constants.closure[c, CLOSURE_ANGLE]
            row[c, GAP], nx, ny, bend = _curve(constants, c, cos(angle), sin(angle), dx, dy)
            turn = wb
        lever = nx * dy - ny * dx  # (z x n) . d
        along = nx * dx + ny * dy
        if kind != ROW_CURVE:
            row[c, GAP] = along
        row[c, GAP_RATE] = nx * ux + ny * uy + turn * lever
        extra = nx * (wb * wb * box - wa * wa * aox) + ny * (wb * wb * boy - wa * wa * aoy)
        extra += 2.0 * turn * (nx * uy - ny * ux) - turn * turn * along
        if kind == ROW_CURVE:
            slide = nx * uy - ny * ux - turn * along  # along the curve
            extra += bend * slide * slide
        row[c, EXTRA] = extra
        row[c, FIRST_WRENCH_X] = nx
        row[c, FIRST_WRENCH_Y] = ny
        row[c, FIRST_WRENCH_W] = aox * ny - aoy * nx
        row[c, SECOND_WRENCH_X] = -nx
        row[c, SECOND_WRENCH_Y] = -ny
        row[c, SECOND_WRENCH_W] = boy * nx - box * ny
        if kind >= ROW_LINE:
            row[c, SECOND_WRENCH_W] += lever


@compiled
def closure_gaps(sizes: Sizes, constants: ArmConstants, state: Array, work: Workspace) -> None:
    """Fill the rows of ``work.closure`` up to SECOND_WRENCH, without RELATIVE and MULTIPLIER."""
    link_terms(sizes, constants, state, work)
    place_bodies(sizes, constants, state, work)
    closure_rows(sizes, constants, work)


@merged
def _start_columns(sizes: Sizes, work: Workspace) -> None:
    """Write the wrenches of all rows as biases of the bodies on whose tips they act."""
    for c in range(len(sizes.closures)):
        for i in range(len(sizes.bodies)):
            for p in range(3):
                work.column[c, i, BIAS_KX + p] = 0.0
        for end in range(2):
            i = sizes.ends[c, 1 + end]
            if i >= 0:
                fx = work.closure[c, FIRST_WRENCH_X + 3 * end]
                fy = work.closure[c, FIRST_WRENCH_Y + 3 * end]
                cosine, sine = work.body[i, WORLD_COSINE], work.body[i, WORLD_SINE]
                work.column[c, i, BIAS_KX] -= cosine * fx + sine * fy
                work.column[c, i, BIAS_KY] -= cosine * fy - sine * fx
                work.column[c, i, BIAS_KW] -= work.closure[c, FIRST_WRENCH_W + 3 * end]


@merged
def closure_wrench(sizes: Sizes, c: int, i: int, work: Workspace) -> Any:
    """Return the wrench of row c with its multiplier on the tip of body i, axes of the body."""
    fx, fy, moment = 0.0, 0.0, 0.0
    for end in range(2):
        if sizes.ends[c, 1 + end] == i:
            force = work.closure[c, MULTIPLIER]
            x = force * work.closure[c, FIRST_WRENCH_X + 3 * end]
            y = force * work.closure[c, FIRST_WRENCH_Y + 3 * end]
            fx += work.body[i, WORLD_COSINE] * x + work.body[i, WORLD_SINE] * y
            fy += work.body[i, WORLD_COSINE] * y - work.body[i, WORLD_SINE] * x
            moment += force * work.closure[c, FIRST_WRENCH_W + 3 * end]
    return fx, fy, moment


@merged
def _compliance(sizes: Sizes, constants: ArmConstants, i: int, work: Workspace) -> Any:
    """Return N of body i."""
    b = constants.body
    N = (0.0, 0.0, b[i, N_YY], 0.0, b[i, N_YW], b[i, N_WW])
    if len(sizes.geometric) > 0:
        N = read_symmetric(work.body, i, BENT_N_XX)
    return N


@merged
def _times(N: Any, x: Any, y: Any, w: Any) -> Any:
    """Return the product of a symmetric matrix and a vector."""
    Nxx, Nxy, Nyy, Nxw, Nyw, Nww = N
    return (
        Nxx * x + Nxy * y + Nxw * w,
        Nxy * x + Nyy * y + Nyw * w,
        Nxw * x + Nyw * y + Nww * w,
    )


@merged
def _pass_body(
    sizes: Sizes, constants: ArmConstants, c: int, i: int, ground_x: Any, ground_y: Any,
    work: Workspace,
) -> Any:  # fmt: skip
    """Carry row c from the tip of body i to that of its carrier; return its part of J q''."""
    b = work.body
    column = work.column
    N = _compliance(sizes, constants, i, work)
    kx = column[c, i, BIAS_KX]
    ky = column[c, i, BIAS_KY]
    kw = column[c, i, BIAS_KW]
    ex, ey, ew = _times(N, kx, ky, kw)
    yx, yy, yw = _times(read_symmetric(b, i, CARRIED_XX), ex, ey, ew)
    mx, my, mw = kx - yx, ky - yy, kw - yw
    hx = b[i, TRANSFER_XX] * mx + b[i, TRANSFER_YX] * my + b[i, TRANSFER_WX] * mw
    hy = b[i, TRANSFER_XY] * mx + b[i, TRANSFER_YY] * my + b[i, TRANSFER_WY] * mw
    hw = b[i, TRANSFER_XW] * mx + b[i, TRANSFER_YW] * my + b[i, TRANSFER_WW] * mw
    turns = 1.0 - constants.body[i, SLIDES]
    drive = -(constants.body[i, SLIDE_X] * hx + constants.body[i, SLIDE_Y] * hy + turns * hw)
    # The part of J q'' of the forces without closures: (force part of the row) . acceleration.
    ax, ay, aw = _times(N, b[i, GAIN_XK], b[i, GAIN_YK], b[i, GAIN_WK])
    moved = b[i, JOINT_DRIVE] * b[i, JOINT_INVERSE] + b[i, JOINT_GIVEN]
    relative = kx * (ax - b[i, DRIFT_X]) + ky * (ay - b[i, DRIFT_Y]) + kw * (aw - b[i, DRIFT_W])
    relative += drive * moved - hx * b[i, JOINT_BIAS_X] - hy * b[i, JOINT_BIAS_Y]
    column[c, i, PASSED_X] = mx
    column[c, i, PASSED_Y] = my
    column[c, i, PASSED_W] = mw
    column[c, i, PASSED_DRIVE] = drive
    step = drive * b[i, JOINT_INVERSE]
    hx += b[i, JOINT_UX] * step
    hy += b[i, JOINT_UY] * step
    hw += b[i, JOINT_UW] * step + b[i, ROOT_FROM_X] * hy - b[i, ROOT_FROM_Y] * hx
    rx = b[i, COSINE] * hx - b[i, SINE] * hy
    ry = b[i, SINE] * hx + b[i, COSINE] * hy
    carrier = sizes.joints[i, 0]
    if carrier >= 0:
        column[c, carrier, BIAS_KX] += rx
        column[c, carrier, BIAS_KY] += ry
        column[c, carrier, BIAS_KW] += hw
    else:
        relative -= rx * ground_x + ry * ground_y
    return relative


@merged
def _add_products(sizes: Sizes, constants: ArmConstants, i: int, work: Workspace) -> None:
    """Add the part of body i to J M^-1 J', lower triangle."""
    column = work.column
    N = _compliance(sizes, constants, i, work)
    for c in range(len(sizes.closures)):
        ex, ey, ew = _times(
            N, column[c, i, PASSED_X], column[c, i, PASSED_Y], column[c, i, PASSED_W]
        )
        step = column[c, i, PASSED_DRIVE] * work.body[i, JOINT_INVERSE]
        for d in range(c + 1):
            work.reaction[c, d] += (
                column[d, i, BIAS_KX] * ex
                + column[d, i, BIAS_KY] * ey
                + column[d, i, BIAS_KW] * ew
                + column[d, i, PASSED_DRIVE] * step
            )


@merged
def factorise(sizes: Sizes, matrix: Array) -> None:
    """Replace the lower triangle of a symmetric matrix by L and D of L D L'."""
    for c in range(len(sizes.closures)):
        for d in range(c):
            left = matrix[c, d]
            for e in range(d):
                left -= matrix[c, e] * matrix[d, e] * matrix[e, e]
            matrix[c, d] = left / matrix[d, d]
        for d in range(c):
            matrix[c, c] -= matrix[c, d] * matrix[c, d] * matrix[d, d]


@merged
def solve_rows(sizes: Sizes, work: Workspace, right: int) -> None:
    """Write -(J M^-1 J')^-1 b to MULTIPLIER, b: column ``right`` of the rows."""
    matrix, rows = work.reaction, work.closure
    for c in range(len(sizes.closures)):
        value = -rows[c, right]
        for d in range(c):
            value -= matrix[c, d] * rows[d, MULTIPLIER]
        rows[c, MULTIPLIER] = value
    for c in range(len(sizes.closures)):
        rows[c, MULTIPLIER] /= matrix[c, c]
    for back in range(len(sizes.closures)):
        c = len(sizes.closures) - 1 - back
        for d in range(c + 1, len(sizes.closures)):
            rows[c, MULTIPLIER] -= matrix[d, c] * rows[d, MULTIPLIER]


@apart
def meet_closures(
    sizes: Sizes, constants: ArmConstants, loads: Loads, state: Array, work: Workspace
) -> None:
    """Add the closure forces to the biases that ``inward`` has left, before ``outward``."""
    ground_x = loads.base_acceleration[0] - constants.arm[GRAVITY_X]
    ground_y = loads.base_acceleration[1] - constants.arm[GRAVITY_Y]
    place_bodies(sizes, constants, state, work)
    closure_rows(sizes, constants, work)
    _start_columns(sizes, work)
    last = len(sizes.bodies) - 1
    for c in range(len(sizes.closures)):
        # All accelerations contain minus gravity; the ground does not move, so give it back.
        fx = work.closure[c, FIRST_WRENCH_X] + work.closure[c, SECOND_WRENCH_X]
        fy = work.closure[c, FIRST_WRENCH_Y] + work.closure[c, SECOND_WRENCH_Y]
        if sizes.ends[c, 2] < 0:
            fx = work.closure[c, FIRST_WRENCH_X]
            fy = work.closure[c, FIRST_WRENCH_Y]
        work.closure[c, RELATIVE] = work.closure[c, EXTRA] - fx * ground_x - fy * ground_y
        for d in range(c + 1):
            work.reaction[c, d] = 0.0
    for back in range(len(sizes.bodies)):
        i = last - back
        for c in range(len(sizes.closures)):
            work.closure[c, RELATIVE] += _pass_body(
                sizes, constants, c, i, ground_x, ground_y, work
            )
        _add_products(sizes, constants, i, work)
    factorise(sizes, work.reaction)
    solve_rows(sizes, work, RELATIVE)
    _add_forces(sizes, work)


@merged
def _add_forces(sizes: Sizes, work: Workspace) -> None:
    """Add the effect of the multipliers to the biases."""
    for i in range(len(sizes.bodies)):
        for c in range(len(sizes.closures)):
            force = work.closure[c, MULTIPLIER]
            work.body[i, GAIN_XK] += force * work.column[c, i, PASSED_X]
            work.body[i, GAIN_YK] += force * work.column[c, i, PASSED_Y]
            work.body[i, GAIN_WK] += force * work.column[c, i, PASSED_W]
            work.body[i, JOINT_DRIVE] += force * work.column[c, i, PASSED_DRIVE]


@merged
def closure_response(sizes: Sizes, constants: ArmConstants, work: Workspace) -> None:
    """Write M^-1 J' times the multipliers to ``work.acceleration``; all biases are lost."""
    for i in range(len(sizes.bodies)):
        for j in range(len(sizes.modes)):
            work.mode[i, j, FLEX_BIAS] = 0.0
        b = work.body
        b[i, DRIFT_X] = b[i, DRIFT_Y] = b[i, DRIFT_W] = 0.0
        b[i, GAIN_XK] = b[i, GAIN_YK] = b[i, GAIN_WK] = 0.0
        b[i, JOINT_DRIVE] = b[i, JOINT_GIVEN] = b[i, MEAN_LAG] = 0.0
        b[i, JOINT_BIAS_X] = b[i, JOINT_BIAS_Y] = 0.0
    _add_forces(sizes, work)
    spread(sizes, constants, 0.0, 0.0, work)
