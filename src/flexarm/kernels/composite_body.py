"""Mass matrix by composite bodies: M of the kinetic energy 1/2 qd' M qd.

Theory page "recursion", (R.18) and (R.19). The outboard chain, frozen, is one 3 x 3 inertia ``W``
at the tip of a body. A unit acceleration of a coordinate takes a wrench at the root of its own
body; carried towards the base, that wrench gives the row of every coordinate further in.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.cache import compiled, merged
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Array, Sizes, Workspace


@compiled
def mass_matrix(
    sizes: Sizes, constants: ArmConstants, state: Array, work: Workspace, M: Array
) -> None:
    """Write M into an array (n, 1 + m, n, 1 + m). Padded and fixed coordinates get unit mass."""
    c = constants
    link_terms(sizes, constants, state, work)
    last = len(sizes.bodies) - 1
    Wxx = 0.0
    Wxy = 0.0
    Wyy = 0.0
    Wxw = 0.0
    Wyw = 0.0
    Www = 0.0
    for back in range(len(sizes.bodies)):
        i = last - back
        Wxx = Wxx + c.tip_mass[i]
        Wyy = Wyy + c.tip_mass[i]
        Www = Www + c.tip_inertia[i]
        x_tip = work.tip[i, 0]
        v_tip = work.tip[i, 1]
        tx = x_tip * Wxy - v_tip * Wxx + Wxw
        ty = x_tip * Wyy - v_tip * Wxy + Wyw
        tw = x_tip * Wyw - v_tip * Wxw + Www
        Hxx = c.mass[i] + Wxx
        Hxy = Wxy
        Hyy = c.mass[i] + Wyy
        Hxw = tx - work.moment[i, 0]
        Hyw = ty + c.first_moment_x[i] + work.moment[i, 1]
        Hww = c.inertia[i] + work.moment[i, 2] + x_tip * ty - v_tip * tx + tw
        free = c.free[i]
        # The rotor turns with its carrier, and with its own joint in its gear's ratio.
        rotor = 0.0
        geared = 0.0
        for _ in range(len(sizes.joint_laws)):
            rotor = c.rotor[i, 0]
            geared = c.rotor[i, 0] * c.rotor[i, 1]
        M[i, 0, i, 0] = free * (Hww + geared * c.rotor[i, 1]) + (1.0 - free)
        _carry(sizes, c, work, M, i, 0, Hxw * free, Hyw * free, (Hww + geared) * free)
        for j in range(len(sizes.modes)):
            P = c.P[i, j]
            dP = c.dP[i, j]
            # Wrench at the tip of a unit modal acceleration, then at the root.
            px = Wxy * P + Wxw * dP
            py = Wyy * P + Wyw * dP
            pw = Wyw * P + Www * dP
            bx = px
            turning = c.a[i, j]
            for k in range(len(sizes.geometric)):
                if k == j:
                    turning += work.rigid_shortening[i, 0] * c.S[i, k]
                    turning += work.rigid_shortening[i, 1] * c.a[i, k]
                    turning += c.inverse_mass[i] * work.moment[i, 0] * work.shortening[i, k]
                    Fx = work.Fx[i, k]
                    px += Wxx * Fx
                    py += Wxy * Fx
                    pw += Wxw * Fx
                    bx = px - work.shortening[i, k]
            by = py + c.S[i, j]
            bw = x_tip * py - v_tip * px + pw + turning
            M[i, 1 + j, i, 0] = free * bw
            M[i, 0, i, 1 + j] = free * bw
            for k in range(len(sizes.modes)):
                M[i, 1 + k, i, 1 + j] = c.P[i, k] * py + c.dP[i, k] * pw
            for k in range(len(sizes.geometric)):
                mean = c.inverse_mass[i] * work.shortening[i, k]
                M[i, 1 + k, i, 1 + j] += work.Fx[i, k] * px + mean * work.shortening[i, j]
            M[i, 1 + j, i, 1 + j] += 1.0
            _carry(sizes, c, work, M, i, 1 + j, bx, by, bw)
        cosine = work.rotation[i, 0]
        sine = work.rotation[i, 1]
        cross = 2.0 * cosine * sine * Hxy
        Wxx = cosine * cosine * Hxx - cross + sine * sine * Hyy
        Wyy = sine * sine * Hxx + cross + cosine * cosine * Hyy
        Wxy = cosine * sine * (Hxx - Hyy) + (cosine * cosine - sine * sine) * Hxy
        Wxw = cosine * Hxw - sine * Hyw
        Wyw = sine * Hxw + cosine * Hyw
        Www = Hww + rotor


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
    """Carry the root wrench (rx, ry, rw) of one coordinate to the base, filling M on the way."""
    c = constants
    for back in range(body):
        outer = body - back
        i = outer - 1
        cosine = work.rotation[outer, 0]
        sine = work.rotation[outer, 1]
        kx = cosine * rx - sine * ry
        ky = sine * rx + cosine * ry
        kw = rw
        for j in range(len(sizes.modes)):
            M[i, 1 + j, body, column] = c.P[i, j] * ky + c.dP[i, j] * kw
        for j in range(len(sizes.geometric)):
            M[i, 1 + j, body, column] += work.Fx[i, j] * kx
        rx = kx
        ry = ky
        rw = kw + work.tip[i, 0] * ky - work.tip[i, 1] * kx
        M[i, 0, body, column] = c.free[i] * rw
        M[body, column, i, 0] = M[i, 0, body, column]
        for j in range(len(sizes.modes)):
            M[body, column, i, 1 + j] = M[i, 1 + j, body, column]
