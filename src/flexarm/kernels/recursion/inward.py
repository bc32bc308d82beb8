"""Forward dynamics from the last body to the first: (R.5) to (R.11).

Symbols as in ``articulated_body``.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.compilation.cache import merged
from flexarm.kernels.forces.joint_law import bristle_rate, passive_torque
from flexarm.kernels.layout import ArmConstants, Array, Sizes, Workspace
from flexarm.kernels.recursion.symmetric import (
    add_symmetric,
    product,
    read_symmetric,
    shifted,
    softened,
    softened_by_factors,
    transformed,
    turned,
    write_full,
    write_symmetric,
)

# isort: off
from flexarm.kernels.columns import (
    A, ALPHA, BENT_N_XX, BENT_RESIDUAL, BETA, CARRIED_KW, CARRIED_KX, CARRIED_KY, CARRIED_XX,
    COSINE, D0_ETA, DP, DRIFT_W, DRIFT_X, DRIFT_Y, FLEX_BIAS, FREE, FX, GAIN_WK, GAIN_XK, GAIN_XX,
    GAIN_YK, GEAR_RATIO, HUB, INVERSE_MASS, JOINT_ADDED, JOINT_BIAS_X, JOINT_BIAS_Y, JOINT_DRIVE,
    JOINT_GIVEN, JOINT_INERTIA, JOINT_INVERSE, JOINT_UW, JOINT_UX, JOINT_UY,
    LENGTH, MASS, MEAN_FX, MEAN_LAG,
    MEAN_LEFT, MEAN_RATES, MEAN_W, MEAN_Y, MODE_MOBILITY, MOMENT_S, N_WW, N_YW, N_YY, P,
    RESIDUAL_TIP_WW, RESIDUAL_TIP_WY, RESIDUAL_TIP_YW, RESIDUAL_TIP_YY, RESIDUAL_WW, RESIDUAL_YW,
    RESIDUAL_YY, ROOT_BIAS_W, ROOT_BIAS_X, ROOT_BIAS_Y, ROOT_FROM_X, ROOT_FROM_Y, ROTOR_INERTIA, S,
    SINE, SLIDE_X, SLIDE_Y, TIP_BIAS_X, TIP_BIAS_Y, TIP_INERTIA, TIP_MASS, TIP_X, TIP_Y,
    TRANSFER_XX,
)  # fmt: skip
# isort: on


@merged
def _without_modes(sizes: Sizes, constants: ArmConstants, i: int, work: Workspace) -> Any:
    """Return H, h, T, N and z of body i, whose modes are eliminated."""
    c = constants
    # Sums over the modes: effect of the modal biases on root and tip.
    Sh = 0.0
    ah = 0.0
    zy = 0.0
    zw = 0.0
    for j in range(len(sizes.modes)):
        h = c.mode[i, j, MODE_MOBILITY] * work.mode[i, j, FLEX_BIAS]
        Sh += c.mode[i, j, S] * h
        ah += c.mode[i, j, A] * h
        zy += c.mode[i, j, P] * h
        zw += c.mode[i, j, DP] * h
    dh, dd, dS, dP, ddP = 0.0, 0.0, 0.0, 0.0, 0.0
    da = -work.body[i, MOMENT_S]  # d.a - s
    FS, Fa, Fd, zx = 0.0, 0.0, 0.0, 0.0
    Nxx, Nxy, Nxw = 0.0, 0.0, 0.0
    for j in range(len(sizes.geometric)):
        h = work.mode[i, j, FLEX_BIAS]
        d = c.mode[i, j, MODE_MOBILITY] * work.mode[i, j, D0_ETA]
        Fx = c.mode[i, j, MODE_MOBILITY] * work.mode[i, j, FX]
        dh += d * h
        dd += d * work.mode[i, j, D0_ETA]
        dS += d * c.mode[i, j, S]
        da += d * c.mode[i, j, A]
        dP += d * c.mode[i, j, P]
        ddP += d * c.mode[i, j, DP]
        FS += Fx * c.mode[i, j, S]
        Fa += Fx * c.mode[i, j, A]
        Fd += Fx * work.mode[i, j, D0_ETA]
        zx += Fx * h
        Nxx += Fx * work.mode[i, j, FX]
        Nxy += Fx * c.mode[i, j, P]
        Nxw += Fx * c.mode[i, j, DP]
    Nyy = c.body[i, N_YY]
    Nyw = c.body[i, N_YW]
    Nww = c.body[i, N_WW]

    # The body without its modes: residual inertia, bias, and transfer from root to tip.
    u_tip = work.body[i, TIP_X] - c.body[i, LENGTH]
    v_tip = work.body[i, TIP_Y]
    Hxx = c.body[i, MASS]
    Hyy = c.body[i, RESIDUAL_YY]
    Hyw = c.body[i, RESIDUAL_YW]
    Hww = c.body[i, RESIDUAL_WW] + work.body[i, BENT_RESIDUAL]
    Tyy = c.body[i, RESIDUAL_TIP_YY]
    Tyw = c.body[i, RESIDUAL_TIP_YW] + u_tip
    Twy = c.body[i, RESIDUAL_TIP_WY]
    Tww = c.body[i, RESIDUAL_TIP_WW]
    if len(sizes.geometric) > 0:
        # The rigid motion equivalent to the shortening follows the root motion, (R.46).
        alpha = work.body[i, ALPHA]
        beta = work.body[i, BETA]
        da += alpha * dS + beta * (da + work.body[i, MOMENT_S])
        ah += alpha * Sh + beta * ah
        Fa += alpha * FS + beta * Fa
        Tyw += alpha * (Tyy - 1.0) + beta * (c.body[i, RESIDUAL_TIP_YW] - c.body[i, LENGTH])
        Tww += alpha * Twy + beta * (Tww - 1.0)
        Hww += alpha * (alpha * Hyy + 2.0 * (1.0 + beta) * Hyw)
        Hww += beta * (2.0 + beta) * (c.body[i, RESIDUAL_WW] - c.body[i, HUB])
        Hyw += alpha * Hyy + beta * Hyw
        # With the inertia of the mean shortening the products x.y over the modes become
        # x.y - kappa (x.d) (y.d), and those with d itself are multiplied by ``left``.
        left = 1.0 / (1.0 + c.body[i, INVERSE_MASS] * dd)
        kappa = c.body[i, INVERSE_MASS] * left
        rates = work.body[i, MEAN_RATES]
        lag = kappa * (dh - rates)
        Sh -= dS * lag
        ah += c.body[i, INVERSE_MASS] * work.body[i, MOMENT_S] * rates - da * lag
        zx -= Fd * lag
        zy -= dP * lag
        zw -= ddP * lag
        FS -= kappa * Fd * dS
        Fa -= kappa * Fd * da
        Nxx -= kappa * Fd * Fd
        Nxy -= kappa * Fd * dP
        Nxw -= kappa * Fd * ddP
        Nyy -= kappa * dP * dP
        Nyw -= kappa * dP * ddP
        Nww -= kappa * ddP * ddP
        Hxx *= left
        Hyy += kappa * dS * dS
        Hyw += kappa * dS * da
        Hww += kappa * da * da
        Tyy += kappa * dP * dS
        Tyw += kappa * dP * da
        Twy += kappa * ddP * dS
        Tww += kappa * ddP * da
        dh = rates + left * (dh - rates)
        dS *= left
        da *= left
        dP *= left
        ddP *= left
        Fd *= left
        work.body[i, MEAN_LEFT], work.body[i, MEAN_LAG] = left, lag
        work.body[i, MEAN_Y], work.body[i, MEAN_W] = dS, da
        work.body[i, MEAN_FX] = Fd
        write_symmetric(work.body, i, BENT_N_XX, (Nxx, Nxy, Nyy, Nxw, Nyw, Nww))
    Txx = 1.0 + Fd
    hx = work.body[i, ROOT_BIAS_X] + dh
    hy = work.body[i, ROOT_BIAS_Y] - Sh
    hw = work.body[i, ROOT_BIAS_W] - ah
    H = (Hxx, dS, Hyy, da, Hyw, Hww)
    T = (Txx, -FS, -v_tip - Fa, dP, Tyy, Tyw, ddP, Twy, Tww)
    N = (Nxx, Nxy, Nyy, Nxw, Nyw, Nww)
    return H, (hx, hy, hw), T, N, (zx, zy, zw)


@merged
def _past_joint(
    sizes: Sizes, constants: ArmConstants, i: int, state: Array, torque: Array, H: Any, h: Any,
    work: Workspace,
) -> Any:  # fmt: skip
    """Return inertia and bias of the chain from body i, in its axes, after its joint.

    A joint that is not free transmits all forces.
    """
    if len(sizes.tree) > 0 and sizes.joints[i, 1] > 0:
        return _past_slide(sizes, constants, i, state, torque, H, h, work)
    c = constants
    Hxx, Hxy, Hyy, Hxw, Hyw, Hww = H
    hx, hy, hw = h
    free = c.body[i, FREE]
    added = c.body[i, JOINT_ADDED]
    Uw = Hww
    D = Hww + added
    lag = added  # D - Uw
    if len(sizes.joint_laws) > 0:
        J = c.body[i, ROTOR_INERTIA]
        r = c.body[i, GEAR_RATIO]
        Uw += r * J
        D += r * r * J
        lag += r * (r - 1.0) * J
    inverse = free / (D + (1.0 - free))
    held = (1.0 - free) + lag * inverse
    given = torque[i] * (1.0 - free)
    passive = passive_torque(sizes, c, i, state, work)
    drive = torque[i] + passive - hw
    work.body[i, JOINT_UX] = Hxw
    work.body[i, JOINT_UY] = Hyw
    work.body[i, JOINT_UW] = Uw
    work.body[i, JOINT_INERTIA] = Uw
    work.body[i, JOINT_INVERSE] = inverse
    work.body[i, JOINT_DRIVE] = drive
    work.body[i, JOINT_GIVEN] = given
    Rxx = Hxx - Hxw * Hxw * inverse
    Rxy = Hxy - Hxw * Hyw * inverse
    Ryy = Hyy - Hyw * Hyw * inverse
    # This form avoids the difference of the large numbers Hww and Uw^2 / D.
    turned_inertia = Hww * (1.0 - free) + Hww * added * inverse
    if len(sizes.joint_laws) > 0:
        J = c.body[i, ROTOR_INERTIA]
        r = c.body[i, GEAR_RATIO]
        turned_inertia += J * (1.0 - free) + J * ((r - 1.0) * (r - 1.0) * Hww + added) * inverse
    hx += Hxw * (drive * inverse + given)
    hy += Hyw * (drive * inverse + given)
    hw = hw + Uw * given + drive * (free - lag * inverse)
    return (Rxx, Rxy, Ryy, Hxw * held, Hyw * held, turned_inertia), (hx, hy, hw)


@merged
def _past_slide(
    sizes: Sizes, constants: ArmConstants, i: int, state: Array, torque: Array, H: Any, h: Any,
    work: Workspace,
) -> Any:  # fmt: skip
    """Return the same after a joint that slides, (M.6): in axes along and across it, and back."""
    c = constants
    along_x = c.body[i, SLIDE_X]
    along_y = c.body[i, SLIDE_Y]
    Gxx, Gxy, Gyy, Gxw, Gyw, Gww = turned(H, along_x, -along_y)
    hx, hy, hw = h
    gx = along_x * hx + along_y * hy
    gy = along_x * hy - along_y * hx
    free = c.body[i, FREE]
    lag = c.body[i, JOINT_ADDED]  # D - Gxx
    rJ = 0.0
    J = 0.0
    rotor = 0.0
    if len(sizes.joint_laws) > 0:
        J = c.body[i, ROTOR_INERTIA]
        rJ = c.body[i, GEAR_RATIO] * J
        rotor = c.body[i, GEAR_RATIO] * rJ
        lag += rotor
    inverse = free / (Gxx + lag + (1.0 - free))
    held = (1.0 - free) + lag * inverse
    given = torque[i] * (1.0 - free)
    passive = passive_torque(sizes, c, i, state, work)
    drive = torque[i] + passive - gx
    Uw = Gxw + rJ
    work.body[i, JOINT_UX] = along_x * Gxx - along_y * Gxy
    work.body[i, JOINT_UY] = along_y * Gxx + along_x * Gxy
    work.body[i, JOINT_UW] = Uw
    work.body[i, JOINT_INERTIA] = Gxx + rotor  # behind a free spring, the link has none
    work.body[i, JOINT_INVERSE] = inverse
    work.body[i, JOINT_DRIVE] = drive
    work.body[i, JOINT_GIVEN] = given
    # Along the joint, products avoid the difference of the large numbers Gxx and Gxx^2 / D.
    R = (
        Gxx * held,
        Gxy * held,
        Gyy - Gxy * Gxy * inverse,
        Gxw * held - Gxx * rJ * inverse,
        Gyw - Gxy * Uw * inverse,
        Gww + J - Uw * Uw * inverse,
    )
    moved = drive * inverse + given
    kx = gx + Gxx * given + drive * (free - lag * inverse)
    ky = gy + Gxy * moved
    rx = along_x * kx - along_y * ky
    ry = along_y * kx + along_x * ky
    return turned(R, along_x, along_y), (rx, ry, hw + Uw * moved)


@merged
def _biased(H: Any, h: Any, i: int, work: Workspace) -> Any:
    """Return the bias h with the velocity products of the joint of body i."""
    Hxx, Hxy, Hyy, Hxw, Hyw, _ = H
    hx, hy, hw = h
    x = work.body[i, JOINT_BIAS_X]
    y = work.body[i, JOINT_BIAS_Y]
    return hx + Hxx * x + Hxy * y, hy + Hxy * x + Hyy * y, hw + Hxw * x + Hyw * y


@merged
def inward(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    torque: Array,
    work: Workspace,
) -> None:
    """Eliminate the modes and the joint of each body, from the last to the first."""
    c = constants
    last = len(sizes.bodies) - 1
    Wxx, Wxy, Wyy, Wxw, Wyw, Www = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    kx, ky, kw = 0.0, 0.0, 0.0
    if len(sizes.tree) > 0:
        for i in range(len(sizes.bodies)):
            write_symmetric(work.body, i, CARRIED_XX, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
            work.body[i, CARRIED_KX] = 0.0
            work.body[i, CARRIED_KY] = 0.0
            work.body[i, CARRIED_KW] = 0.0
    for back in range(len(sizes.bodies)):
        i = last - back
        if len(sizes.tree) > 0:
            Wxx, Wxy, Wyy, Wxw, Wyw, Www = read_symmetric(work.body, i, CARRIED_XX)
            kx, ky = work.body[i, CARRIED_KX], work.body[i, CARRIED_KY]
            kw = work.body[i, CARRIED_KW]
        Wxx = Wxx + c.body[i, TIP_MASS]
        Wyy = Wyy + c.body[i, TIP_MASS]
        Www = Www + c.body[i, TIP_INERTIA]
        bias_x = work.body[i, TIP_BIAS_X]
        bias_y = work.body[i, TIP_BIAS_Y]
        kx = kx + Wxx * bias_x + Wxy * bias_y
        ky = ky + Wxy * bias_x + Wyy * bias_y
        kw = kw + Wxw * bias_x + Wyw * bias_y

        if len(sizes.bristles) > 0:
            work.mode[i, len(sizes.modes) - 1, FLEX_BIAS] -= bristle_rate(sizes, c, i, state)

        H, h, T, N, z = _without_modes(sizes, c, i, work)
        hx, hy, hw = h
        Txx, Txy, Txw, Tyx, Tyy, Tyw, Twx, Twy, Tww = T
        Nxx, Nxy, Nyy, Nxw, Nyw, Nww = N
        zx, zy, zw = z

        # The outboard chain in series with the modes, moved to the root.
        W_tip = (Wxx, Wxy, Wyy, Wxw, Wyw, Www)
        Y = softened_by_factors(W_tip, N) if len(sizes.tree) > 0 else softened(W_tip, N)
        Yxx, Yxy, Yyy, Yxw, Yyw, Yww = Y
        ex = zx + Nxx * kx + Nxy * ky + Nxw * kw
        ey = zy + Nxy * kx + Nyy * ky + Nyw * kw
        ew = zw + Nxw * kx + Nyw * ky + Nww * kw
        kx = kx - Yxx * ex - Yxy * ey - Yxw * ew
        ky = ky - Yxy * ex - Yyy * ey - Yyw * ew
        kw = kw - Yxw * ex - Yyw * ey - Yww * ew
        g = product(Y, T)
        hx += Txx * kx + Tyx * ky + Twx * kw
        hy += Txy * kx + Tyy * ky + Twy * kw
        hw += Txw * kx + Tyw * ky + Tww * kw
        write_full(work.body, i, GAIN_XX, g)
        write_full(work.body, i, TRANSFER_XX, T)
        work.body[i, GAIN_XK], work.body[i, GAIN_YK], work.body[i, GAIN_WK] = kx, ky, kw
        work.body[i, DRIFT_X] = bias_x - zx
        work.body[i, DRIFT_Y] = bias_y - zy
        work.body[i, DRIFT_W] = -zw

        H_all = transformed(H, T, g)
        h_all = (hx, hy, hw)
        if len(sizes.tree) > 0:
            h_all = _biased(H_all, h_all, i, work)
        R, r = _past_joint(sizes, c, i, state, torque, H_all, h_all, work)
        rx, ry, kw = r
        if len(sizes.tree) > 0:
            x = work.body[i, ROOT_FROM_X]
            y = work.body[i, ROOT_FROM_Y]
            R = shifted(R, x, y)
            kw = kw + x * ry - y * rx
        if len(sizes.closures) > 0:
            write_symmetric(work.body, i, CARRIED_XX, Y)
        cosine, sine = work.body[i, COSINE], work.body[i, SINE]
        Wxx, Wxy, Wyy, Wxw, Wyw, Www = turned(R, cosine, sine)
        kx = cosine * rx - sine * ry
        ky = sine * rx + cosine * ry
        if len(sizes.tree) > 0 and sizes.joints[i, 0] >= 0:
            carrier = sizes.joints[i, 0]
            add_symmetric(work.body, carrier, CARRIED_XX, (Wxx, Wxy, Wyy, Wxw, Wyw, Www))
            work.body[carrier, CARRIED_KX] += kx
            work.body[carrier, CARRIED_KY] += ky
            work.body[carrier, CARRIED_KW] += kw
