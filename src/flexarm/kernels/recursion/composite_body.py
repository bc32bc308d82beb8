"""Mass matrix by composite bodies: M of the kinetic energy 1/2 qd' M qd.

Theory page "recursion", (R.18) and (R.19). The outboard chain, moving as one rigid body, is a 3 x 3
inertia ``W`` at the tip of a body. A unit acceleration of a coordinate requires a wrench at the
root of its own body. Transmitted towards the base, that wrench gives the entries of all inboard
coordinates.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.columns import (
    ALPHA,
    BENT_INERTIA,
    BETA,
    CARRIED_XX,
    COSINE,
    D0_ETA,
    DP,
    FIRST_MOMENT_X,
    FREE,
    FX,
    GEAR_RATIO,
    INERTIA,
    INVERSE_MASS,
    MASS,
    MOMENT_MU,
    MOMENT_S,
    ROOT_FROM_X,
    ROOT_FROM_Y,
    ROTOR_INERTIA,
    SINE,
    SLIDE_X,
    SLIDE_Y,
    TIP_INERTIA,
    TIP_MASS,
    TIP_X,
    TIP_Y,
    A,
    P,
    S,
)
from flexarm.kernels.compilation.cache import compiled, merged
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Array, Sizes, Workspace
from flexarm.kernels.recursion.symmetric import (
    add_symmetric,
    read_symmetric,
    shifted,
    turned,
    write_symmetric,
)


@compiled
def mass_matrix(
    sizes: Sizes, constants: ArmConstants, state: Array, work: Workspace, M: Array
) -> None:
    """Write M into an array (n, 1 + m, n, 1 + m); padded and fixed coordinates get unit mass."""
    c = constants
    link_terms(sizes, constants, state, work)
    last = len(sizes.bodies) - 1
    Wxx, Wxy, Wyy, Wxw, Wyw, Www = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if len(sizes.tree) > 0:
        for i in range(len(sizes.bodies)):
            write_symmetric(work.body, i, CARRIED_XX, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    for back in range(len(sizes.bodies)):
        i = last - back
        if len(sizes.tree) > 0:
            Wxx, Wxy, Wyy, Wxw, Wyw, Www = read_symmetric(work.body, i, CARRIED_XX)
        Wxx = Wxx + c.body[i, TIP_MASS]
        Wyy = Wyy + c.body[i, TIP_MASS]
        Www = Www + c.body[i, TIP_INERTIA]
        x_tip = work.body[i, TIP_X]
        v_tip = work.body[i, TIP_Y]
        tx = x_tip * Wxy - v_tip * Wxx + Wxw
        ty = x_tip * Wyy - v_tip * Wxy + Wyw
        tw = x_tip * Wyw - v_tip * Wxw + Www
        Hxx = c.body[i, MASS] + Wxx
        Hxy = Wxy
        Hyy = c.body[i, MASS] + Wyy
        Hxw = tx - work.body[i, MOMENT_S]
        Hyw = ty + c.body[i, FIRST_MOMENT_X] + work.body[i, MOMENT_MU]
        Hww = c.body[i, INERTIA] + work.body[i, BENT_INERTIA] + x_tip * ty - v_tip * tx + tw
        free = c.body[i, FREE]
        # The rotor turns with its carrier, plus the gear ratio times the joint rate.
        rotor = 0.0
        geared = 0.0
        if len(sizes.joint_laws) > 0:
            rotor = c.body[i, ROTOR_INERTIA]
            geared = c.body[i, ROTOR_INERTIA] * c.body[i, GEAR_RATIO]
        # Wrench of a unit acceleration of the joint, and the inertia that the joint moves.
        jx, jy, jw, moved = Hxw, Hyw, Hww, Hww
        if len(sizes.tree) > 0 and sizes.joints[i, 1] > 0:
            jx = c.body[i, SLIDE_X] * Hxx + c.body[i, SLIDE_Y] * Hxy
            jy = c.body[i, SLIDE_X] * Hxy + c.body[i, SLIDE_Y] * Hyy
            jw = c.body[i, SLIDE_X] * Hxw + c.body[i, SLIDE_Y] * Hyw
            moved = c.body[i, SLIDE_X] * jx + c.body[i, SLIDE_Y] * jy
        M[i, 0, i, 0] = free * (moved + geared * c.body[i, GEAR_RATIO]) + (1.0 - free)
        _carry(sizes, c, work, M, i, 0, jx * free, jy * free, (jw + geared) * free)
        for j in range(len(sizes.modes)):
            deflection = c.mode[i, j, P]
            slope = c.mode[i, j, DP]
            # Wrench of a unit modal acceleration at the tip, then at the root.
            px = Wxy * deflection + Wxw * slope
            py = Wyy * deflection + Wyw * slope
            pw = Wyw * deflection + Www * slope
            bx = px
            turning = c.mode[i, j, A]
            for k in range(len(sizes.geometric)):
                if k == j:
                    turning += work.body[i, ALPHA] * c.mode[i, k, S]
                    turning += work.body[i, BETA] * c.mode[i, k, A]
                    turning += (
                        c.body[i, INVERSE_MASS] * work.body[i, MOMENT_S] * work.mode[i, k, D0_ETA]
                    )
                    Fx = work.mode[i, k, FX]
                    px += Wxx * Fx
                    py += Wxy * Fx
                    pw += Wxw * Fx
                    bx = px - work.mode[i, k, D0_ETA]
            by = py + c.mode[i, j, S]
            bw = x_tip * py - v_tip * px + pw + turning
            M[i, 0, i, 1 + j] = free * _along_joint(sizes, c, i, bx, by, bw)
            M[i, 1 + j, i, 0] = M[i, 0, i, 1 + j]
            for k in range(len(sizes.modes)):
                M[i, 1 + k, i, 1 + j] = c.mode[i, k, P] * py + c.mode[i, k, DP] * pw
            for k in range(len(sizes.geometric)):
                mean = c.body[i, INVERSE_MASS] * work.mode[i, k, D0_ETA]
                M[i, 1 + k, i, 1 + j] += work.mode[i, k, FX] * px + mean * work.mode[i, j, D0_ETA]
            M[i, 1 + j, i, 1 + j] += 1.0
            _carry(sizes, c, work, M, i, 1 + j, bx, by, bw)
        H = (Hxx, Hxy, Hyy, Hxw, Hyw, Hww + rotor)
        if len(sizes.tree) > 0:
            H = shifted(H, work.body[i, ROOT_FROM_X], work.body[i, ROOT_FROM_Y])
        W = turned(H, work.body[i, COSINE], work.body[i, SINE])
        Wxx, Wxy, Wyy, Wxw, Wyw, Www = W
        if len(sizes.tree) > 0 and sizes.joints[i, 0] >= 0:
            add_symmetric(work.body, sizes.joints[i, 0], CARRIED_XX, W)


@merged
def _along_joint(sizes: Sizes, constants: ArmConstants, i: int, x: Any, y: Any, moment: Any) -> Any:
    """Return the generalised force on the joint of body i of a wrench at its root."""
    force = moment
    if len(sizes.tree) > 0 and sizes.joints[i, 1] > 0:
        force = constants.body[i, SLIDE_X] * x + constants.body[i, SLIDE_Y] * y
    return force


@merged
def _carry(
    sizes: Sizes,
    constants: ArmConstants,
    work: Workspace,
    M: Array,
    body: int,
    column: int,
    rx: Any,
    ry: Any,
    rw: Any,
) -> None:
    """Transmit the root wrench (rx, ry, rw) of one coordinate to the base and fill M."""
    c = constants
    outer = body
    for back in range(body):
        i = body - back - 1
        if len(sizes.tree) > 0:
            i = sizes.joints[outer, 0]
            if i < 0:
                break
            rw = rw + work.body[outer, ROOT_FROM_X] * ry - work.body[outer, ROOT_FROM_Y] * rx
        cosine = work.body[outer, COSINE]
        sine = work.body[outer, SINE]
        kx = cosine * rx - sine * ry
        ky = sine * rx + cosine * ry
        kw = rw
        for j in range(len(sizes.modes)):
            M[i, 1 + j, body, column] = c.mode[i, j, P] * ky + c.mode[i, j, DP] * kw
        for j in range(len(sizes.geometric)):
            M[i, 1 + j, body, column] += work.mode[i, j, FX] * kx
        rx = kx
        ry = ky
        rw = kw + work.body[i, TIP_X] * ky - work.body[i, TIP_Y] * kx
        M[i, 0, body, column] = c.body[i, FREE] * _along_joint(sizes, c, i, rx, ry, rw)
        M[body, column, i, 0] = M[i, 0, body, column]
        for j in range(len(sizes.modes)):
            M[body, column, i, 1 + j] = M[i, 1 + j, body, column]
        outer = i
