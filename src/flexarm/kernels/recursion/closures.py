"""Forces that close the loops of a mechanism, and their effect on its accelerations.

Theory page "mechanisms", (M.10) to (M.16), (M.28). A row is one equation ``g = 0`` of a closure
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
        along, across = 0.0, 0.0
        if x != 0.0 or y != 0.0:  # most points are on the axis
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
    k = constants.closure
    for c in range(len(sizes.closures)):
        kind = sizes.ends[c, 0]
        if kind == ROW_Y:  # written with the row before
            continue
        a = _point(sizes.ends[c, 1], k[c, FIRST_X], k[c, FIRST_Y], work)
        b = _point(sizes.ends[c, 2], k[c, SECOND_X], k[c, SECOND_Y], work)
        if kind == ROW_X:
            _pin_rows(c, a, b, work)
        elif kind == ROW_ANGLE:
            _angle_row(c, k[c, CLOSURE_ANGLE], a, b, work)
        else:
            _path_row(constants, c, kind, a, b, work)


@merged
def _write_row(
    c: int, gap: Any, gap_rate: Any, extra: Any, nx: Any, ny: Any, first: Any, second: Any,
    work: Workspace,
) -> None:  # fmt: skip
    """Write a row with the force n on the first point; ``first``, ``second``: moments."""
    row = work.closure
    row[c, GAP], row[c, GAP_RATE], row[c, EXTRA] = gap, gap_rate, extra
    row[c, FIRST_WRENCH_X], row[c, FIRST_WRENCH_Y], row[c, FIRST_WRENCH_W] = nx, ny, first
    row[c, SECOND_WRENCH_X], row[c, SECOND_WRENCH_Y], row[c, SECOND_WRENCH_W] = -nx, -ny, second


@merged
def _pin_rows(c: int, a: Any, b: Any, work: Workspace) -> None:
    """Write two rows of equal x and equal y."""
    ax, ay, avx, avy, aox, aoy, _, wa = a
    bx, by, bvx, bvy, box, boy, _, wb = b
    x = wb * wb * box - wa * wa * aox
    y = wb * wb * boy - wa * wa * aoy
    _write_row(c, ax - bx, avx - bvx, x, 1.0, 0.0, -aoy, boy, work)
    _write_row(c + 1, ay - by, avy - bvy, y, 0.0, 1.0, aox, -box, work)


@merged
def _angle_row(c: int, angle: Any, a: Any, b: Any, work: Workspace) -> None:
    """Write a row of equal angles of both sections up to ``angle``."""
    turned = a[6] - b[6] - angle
    gap = turned - 2.0 * math.pi * round(real(turned) / (2.0 * math.pi))
    _write_row(c, gap, a[7] - b[7], 0.0, 0.0, 0.0, 1.0, -1.0, work)


@merged
def _path_row(constants: ArmConstants, c: int, kind: int, a: Any, b: Any, work: Workspace) -> None:
    """Write a row of a point on a line or a curve, (M.12), (M.28)."""
    ax, ay, avx, avy, aox, aoy, _, wa = a
    bx, by, bvx, bvy, box, boy, b_angle, wb = b
    dx, dy, ux, uy = ax - bx, ay - by, avx - bvx, avy - bvy
    angle = b_angle + constants.closure[c, CLOSURE_ANGLE]
    nx, ny = -sin(angle), cos(angle)
    gap = nx * dx + ny * dy
    bend = 0.0 * gap
    if kind == ROW_CURVE:
        gap, nx, ny, bend = _curve(constants, c, ny, -nx, dx, dy)
    above = nx * dx + ny * dy  # n . d
    lever = nx * dy - ny * dx  # (z x n) . d
    speed = nx * uy - ny * ux  # (z x n) . (v_a - v_b)
    extra = nx * (wb * wb * box - wa * wa * aox) + ny * (wb * wb * boy - wa * wa * aoy)
    extra += 2.0 * wb * speed - wb * wb * above
    extra += bend * (speed - wb * above) * (speed - wb * above)
    first = aox * ny - aoy * nx
    second = boy * nx - box * ny + lever
    _write_row(c, gap, nx * ux + ny * uy + wb * lever, extra, nx, ny, first, second, work)


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
def _pass_rows(
    sizes: Sizes, constants: ArmConstants, i: int, ground_x: Any, ground_y: Any, work: Workspace
) -> None:
    """Carry all rows from the tip of body i to that of its carrier.

    Add the part of the body to J M^-1 J', lower triangle, and to the J q'' of the forces without
    closures: (force part of the row) . acceleration.
    """
    # Numbers of the body are read once: after each number that a row writes, the compiler would
    # read them again.
    b = work.body
    column = work.column
    N = _compliance(sizes, constants, i, work)
    Y = read_symmetric(b, i, CARRIED_XX)
    Txx, Txy, Txw = b[i, TRANSFER_XX], b[i, TRANSFER_XY], b[i, TRANSFER_XW]
    Tyx, Tyy, Tyw = b[i, TRANSFER_YX], b[i, TRANSFER_YY], b[i, TRANSFER_YW]
    Twx, Twy, Tww = b[i, TRANSFER_WX], b[i, TRANSFER_WY], b[i, TRANSFER_WW]
    slide_x, slide_y = constants.body[i, SLIDE_X], constants.body[i, SLIDE_Y]
    turns = 1.0 - constants.body[i, SLIDES]
    Ux, Uy, Uw = b[i, JOINT_UX], b[i, JOINT_UY], b[i, JOINT_UW]
    inverse = b[i, JOINT_INVERSE]
    moved = b[i, JOINT_DRIVE] * inverse + b[i, JOINT_GIVEN]
    bias_x, bias_y = b[i, JOINT_BIAS_X], b[i, JOINT_BIAS_Y]
    from_x, from_y = b[i, ROOT_FROM_X], b[i, ROOT_FROM_Y]
    cosine, sine = b[i, COSINE], b[i, SINE]
    ax, ay, aw = _times(N, b[i, GAIN_XK], b[i, GAIN_YK], b[i, GAIN_WK])
    ax, ay, aw = ax - b[i, DRIFT_X], ay - b[i, DRIFT_Y], aw - b[i, DRIFT_W]
    carrier = sizes.joints[i, 0]
    for c in range(len(sizes.closures)):
        kx, ky, kw = column[c, i, BIAS_KX], column[c, i, BIAS_KY], column[c, i, BIAS_KW]
        yx, yy, yw = _times(Y, *_times(N, kx, ky, kw))
        mx, my, mw = kx - yx, ky - yy, kw - yw
        hx = Txx * mx + Tyx * my + Twx * mw
        hy = Txy * mx + Tyy * my + Twy * mw
        hw = Txw * mx + Tyw * my + Tww * mw
        drive = -(slide_x * hx + slide_y * hy + turns * hw)
        relative = kx * ax + ky * ay + kw * aw
        relative += drive * moved - hx * bias_x - hy * bias_y
        column[c, i, PASSED_X], column[c, i, PASSED_Y], column[c, i, PASSED_W] = mx, my, mw
        column[c, i, PASSED_DRIVE] = drive
        step = drive * inverse
        ex, ey, ew = _times(N, mx, my, mw)
        for d in range(c + 1):
            work.reaction[c, d] += (
                column[d, i, BIAS_KX] * ex
                + column[d, i, BIAS_KY] * ey
                + column[d, i, BIAS_KW] * ew
                + column[d, i, PASSED_DRIVE] * step
            )
        hx += Ux * step
        hy += Uy * step
        hw += Uw * step + from_x * hy - from_y * hx
        rx = cosine * hx - sine * hy
        ry = sine * hx + cosine * hy
        if carrier >= 0:
            column[c, carrier, BIAS_KX] += rx
            column[c, carrier, BIAS_KY] += ry
            column[c, carrier, BIAS_KW] += hw
        else:
            relative -= rx * ground_x + ry * ground_y
        work.closure[c, RELATIVE] += relative


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


@merged
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
        _pass_rows(sizes, constants, last - back, ground_x, ground_y, work)
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
