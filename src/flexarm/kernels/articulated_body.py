"""Forward dynamics in O(n m): articulated bodies with flexible links.

Theory page "recursion", (R.4) to (R.14). The outboard chain seen at the tip of a body is
``wrench = W A_tip + k`` with a symmetric 3 x 3 ``W``; each body is eliminated in turn, first its
modes, then its joint.

The modal accelerations are counted from those that follow the root's acceleration, ``zeta = eta''
+ C A``. Over these the inertia of the body is block diagonal, and the rest of its rigid inertia and
of its transfer from root to tip are constants with full precision. Eliminating ``eta''`` itself
would subtract a.a from I, which agree in all but the last digits on a fine mesh.

=============  =================================================================================
symbol         meaning; all in the axes of the body at hand, wrenches and accelerations (x, y, w)
=============  =================================================================================
``W``, ``k``   outboard chain at the tip: six entries xx, xy, yy, xw, yw, ww, and three
``F``          tip acceleration per modal acceleration: rows -G eta, P, dP
``C``          columns -D0 eta, S, a: modal acceleration that follows a root acceleration
``H``, ``h``   residual inertia and bias of the root, then with all that hangs on it
``T``          residual transfer T - F C
``N``, ``z``   F F', F times the modal biases
``d``          D0 eta: what the modes shorten the body by, in the mean over its mass
``alpha``      translation and, ``beta``, turn that stand for the shortening, (L.44)
``kappa``      the inverse of the modal inertia 1 + d d' / m is 1 - kappa d d', (R.44)
``Y``          (1 + W N)^-1 W: the outboard chain behind the springs of the modes
``g``          Y T: tip force per root acceleration
``U``, ``D``   what the joint's equation takes per acceleration of its root, and of itself
``J``, ``r``   rotary inertia of a motor's rotor, and its gear ratio
``1/Delta``    ``mobility``: one, or less in an implicit step, (R.27), where F, C and the modal
               biases meet it once in each product, (R.28)
=============  =================================================================================
"""

from __future__ import annotations

from flexarm.kernels.cache import compiled, merged
from flexarm.kernels.external import apply_loads
from flexarm.kernels.joint_law import passive_torque
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.woodbury import softened


@merged
def forward_dynamics(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
) -> None:
    """Write the accelerations of a state under joint torques into ``work.acceleration``.

    ``state`` (2, n, 1 + m); ``torque`` (n,) N m on the relative joint angles; of a joint that is
    not free its acceleration, rad/s^2 (zero for a fixed one).
    """
    accelerate(sizes, constants, state, torque, loads, work)


@merged
def accelerate(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
) -> None:
    """``forward_dynamics`` merged into its caller: a call hands over a hundred arrays."""
    link_terms(sizes, constants, state, work)
    apply_loads(sizes, constants.P, loads, state, work)
    _inward(sizes, constants, state, torque, work)
    _outward(sizes, constants, loads, work)


@merged
def solve_implicit(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    force: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
) -> None:
    """Write x of (M + added) x = torque + force - bias into ``work.acceleration``, (R.27).

    ``constants`` come from ``implicit_step.add_to_diagonal``: they hold what is added. ``force``
    (n, 1 + m) acts on the modes, its first column on nothing: what acts on joints is in
    ``torque``. The rest is as in ``forward_dynamics``.
    """
    link_terms(sizes, constants, state, work)
    apply_loads(sizes, constants.P, loads, state, work)
    for i in range(len(sizes.bodies)):
        for j in range(len(sizes.modes)):
            work.flex_bias[i, j] -= force[i, 1 + j]
    _inward(sizes, constants, state, torque, work)
    _outward(sizes, constants, loads, work)


@compiled
def implicit_dynamics(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    force: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
) -> None:
    """``solve_implicit`` as a call of its own, for places that are not hot."""
    solve_implicit(sizes, constants, state, force, torque, loads, work)


@merged
def _inward(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    torque: Array,
    work: Workspace,
) -> None:
    """From the last body to the first: (R.5) to (R.11)."""
    c = constants
    last = len(sizes.bodies) - 1
    Wxx, Wxy, Wyy = 0.0, 0.0, 0.0
    Wxw, Wyw, Www = 0.0, 0.0, 0.0
    kx, ky, kw = 0.0, 0.0, 0.0
    for back in range(len(sizes.bodies)):
        i = last - back
        Wxx = Wxx + c.tip_mass[i]
        Wyy = Wyy + c.tip_mass[i]
        Www = Www + c.tip_inertia[i]
        bias_x = work.tip_bias[i, 0]
        bias_y = work.tip_bias[i, 1]
        kx = kx + Wxx * bias_x + Wxy * bias_y
        ky = ky + Wxy * bias_x + Wyy * bias_y
        kw = kw + Wxw * bias_x + Wyw * bias_y

        # Sums over the modes: what the modal biases do to root and tip.
        Sh = 0.0
        ah = 0.0
        zy = 0.0
        zw = 0.0
        for j in range(len(sizes.modes)):
            h = c.mobility[i, j] * work.flex_bias[i, j]
            Sh += c.S[i, j] * h
            ah += c.a[i, j] * h
            zy += c.P[i, j] * h
            zw += c.dP[i, j] * h
        dh, dd, dS, dP, ddP = 0.0, 0.0, 0.0, 0.0, 0.0
        da = -work.moment[i, 0]  # d.a - s
        FS, Fa, Fd, zx = 0.0, 0.0, 0.0, 0.0
        Nxx, Nxy, Nxw = 0.0, 0.0, 0.0
        for j in range(len(sizes.geometric)):
            h = work.flex_bias[i, j]
            d = c.mobility[i, j] * work.shortening[i, j]
            Fx = c.mobility[i, j] * work.Fx[i, j]
            dh += d * h
            dd += d * work.shortening[i, j]
            dS += d * c.S[i, j]
            da += d * c.a[i, j]
            dP += d * c.P[i, j]
            ddP += d * c.dP[i, j]
            FS += Fx * c.S[i, j]
            Fa += Fx * c.a[i, j]
            Fd += Fx * work.shortening[i, j]
            zx += Fx * h
            Nxx += Fx * work.Fx[i, j]
            Nxy += Fx * c.P[i, j]
            Nxw += Fx * c.dP[i, j]
        Nyy = c.N[i, 0]
        Nyw = c.N[i, 1]
        Nww = c.N[i, 2]

        # The body without its modes: residual inertia, bias, and transfer from root to tip.
        u_tip = work.tip[i, 0] - c.length[i]
        v_tip = work.tip[i, 1]
        Hxx = c.mass[i]
        Hyy = c.residual_inertia[i, 0]
        Hyw = c.residual_inertia[i, 1]
        Hww = c.residual_inertia[i, 2] + work.moment[i, 3]
        Tyy = c.residual_tip[i, 0]
        Tyw = c.residual_tip[i, 1] + u_tip
        Twy = c.residual_tip[i, 2]
        Tww = c.residual_tip[i, 3]
        for _ in range(min(len(sizes.geometric), 1)):
            # The rigid motion that stands for the shortening goes with that of the root, (R.46).
            alpha = work.rigid_shortening[i, 0]
            beta = work.rigid_shortening[i, 1]
            da += alpha * dS + beta * (da + work.moment[i, 0])
            ah += alpha * Sh + beta * ah
            Fa += alpha * FS + beta * Fa
            Tyw += alpha * (Tyy - 1.0) + beta * (c.residual_tip[i, 1] - c.length[i])
            Tww += alpha * Twy + beta * (Tww - 1.0)
            Hww += alpha * (alpha * Hyy + 2.0 * (1.0 + beta) * Hyw)
            Hww += beta * (2.0 + beta) * (c.residual_inertia[i, 2] - c.hub[i])
            Hyw += alpha * Hyy + beta * Hyw
            # With the inertia of the mean shortening the products x.y over the modes become
            # x.y - kappa (x.d) (y.d), and those with d itself are multiplied by ``left``.
            left = 1.0 / (1.0 + c.inverse_mass[i] * dd)
            kappa = c.inverse_mass[i] * left
            rates = work.mean_shortening[i, 0]
            lag = kappa * (dh - rates)
            Sh -= dS * lag
            ah += c.inverse_mass[i] * work.moment[i, 0] * rates - da * lag
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
            work.mean_shortening[i, 1], work.mean_shortening[i, 2] = left, lag
            work.mean_shortening[i, 3], work.mean_shortening[i, 4] = dS, da
            work.mean_shortening[i, 5] = Fd
            work.N[i, 0], work.N[i, 1], work.N[i, 2] = Nxx, Nxy, Nxw
            work.N[i, 3], work.N[i, 4], work.N[i, 5] = Nyy, Nyw, Nww
        Hxy = dS
        Hxw = da
        hx = work.root_bias[i, 0] + dh
        hy = work.root_bias[i, 1] - Sh
        hw = work.root_bias[i, 2] - ah
        Txx = 1.0 + Fd
        Txy = -FS
        Txw = -v_tip - Fa
        Tyx = dP
        Twx = ddP

        # The outboard chain, softened by the modes, moved to the root.
        Yxx, Yxy, Yyy, Yxw, Yyw, Yww = softened(
            Wxx, Wxy, Wyy, Wxw, Wyw, Www, Nxx, Nxy, Nyy, Nxw, Nyw, Nww
        )
        ex = zx + Nxx * kx + Nxy * ky + Nxw * kw
        ey = zy + Nxy * kx + Nyy * ky + Nyw * kw
        ew = zw + Nxw * kx + Nyw * ky + Nww * kw
        kx = kx - Yxx * ex - Yxy * ey - Yxw * ew
        ky = ky - Yxy * ex - Yyy * ey - Yyw * ew
        kw = kw - Yxw * ex - Yyw * ey - Yww * ew
        gxx = Yxx * Txx + Yxy * Tyx + Yxw * Twx
        gxy = Yxx * Txy + Yxy * Tyy + Yxw * Twy
        gxw = Yxx * Txw + Yxy * Tyw + Yxw * Tww
        gyx = Yxy * Txx + Yyy * Tyx + Yyw * Twx
        gyy = Yxy * Txy + Yyy * Tyy + Yyw * Twy
        gyw = Yxy * Txw + Yyy * Tyw + Yyw * Tww
        gwx = Yxw * Txx + Yyw * Tyx + Yww * Twx
        gwy = Yxw * Txy + Yyw * Tyy + Yww * Twy
        gww = Yxw * Txw + Yyw * Tyw + Yww * Tww
        Hxx += Txx * gxx + Tyx * gyx + Twx * gwx
        Hxy += Txx * gxy + Tyx * gyy + Twx * gwy
        Hyy += Txy * gxy + Tyy * gyy + Twy * gwy
        Hxw += Txx * gxw + Tyx * gyw + Twx * gww
        Hyw += Txy * gxw + Tyy * gyw + Twy * gww
        Hww += Txw * gxw + Tyw * gyw + Tww * gww
        hx += Txx * kx + Tyx * ky + Twx * kw
        hy += Txy * kx + Tyy * ky + Twy * kw
        hw += Txw * kx + Tyw * ky + Tww * kw
        work.gain[i, 0, 0], work.gain[i, 0, 1], work.gain[i, 0, 2] = gxx, gxy, gxw
        work.gain[i, 0, 3] = kx
        work.gain[i, 1, 0], work.gain[i, 1, 1], work.gain[i, 1, 2] = gyx, gyy, gyw
        work.gain[i, 1, 3] = ky
        work.gain[i, 2, 0], work.gain[i, 2, 1], work.gain[i, 2, 2] = gwx, gwy, gww
        work.gain[i, 2, 3] = kw
        work.transfer[i, 0, 0], work.transfer[i, 0, 1], work.transfer[i, 0, 2] = Txx, Txy, Txw
        work.transfer[i, 1, 0], work.transfer[i, 1, 1], work.transfer[i, 1, 2] = Tyx, Tyy, Tyw
        work.transfer[i, 2, 0], work.transfer[i, 2, 1], work.transfer[i, 2, 2] = Twx, Twy, Tww
        work.drift[i, 0], work.drift[i, 1], work.drift[i, 2] = bias_x - zx, bias_y - zy, -zw

        # Eliminate the joint (one that is not free passes everything on), then turn inboard.
        free = c.free[i]
        added = c.joint_added[i]
        Uw = Hww
        D = Hww + added
        lag = added  # D - Uw
        for _ in range(len(sizes.joint_laws)):
            J = c.rotor[i, 0]
            r = c.rotor[i, 1]
            Uw += r * J
            D += r * r * J
            lag += r * (r - 1.0) * J
        inverse = free / (D + (1.0 - free))
        held = (1.0 - free) + lag * inverse
        given = torque[i] * (1.0 - free)
        passive = passive_torque(sizes, c, i, state[0, i, 0], state[1, i, 0])
        drive = torque[i] + passive - hw
        work.joint[i, 0] = Hxw
        work.joint[i, 1] = Hyw
        work.joint[i, 2] = Uw
        work.joint[i, 3] = inverse
        work.joint[i, 4] = drive
        work.joint[i, 5] = given
        Rxx = Hxx - Hxw * Hxw * inverse
        Rxy = Hxy - Hxw * Hyw * inverse
        Ryy = Hyy - Hyw * Hyw * inverse
        # Written without the difference of the large numbers Hww and Uw^2 / D.
        turned = Hww * (1.0 - free) + Hww * added * inverse
        for _ in range(len(sizes.joint_laws)):
            J = c.rotor[i, 0]
            r = c.rotor[i, 1]
            turned += J * (1.0 - free) + J * ((r - 1.0) * (r - 1.0) * Hww + added) * inverse
        Rxw = Hxw * held
        Ryw = Hyw * held
        Rww = turned
        hx += Hxw * (drive * inverse + given)
        hy += Hyw * (drive * inverse + given)
        kw = hw + Uw * given + drive * (free - lag * inverse)
        cosine = work.rotation[i, 0]
        sine = work.rotation[i, 1]
        cross = 2.0 * cosine * sine * Rxy
        Wxx = cosine * cosine * Rxx - cross + sine * sine * Ryy
        Wyy = sine * sine * Rxx + cross + cosine * cosine * Ryy
        Wxy = cosine * sine * (Rxx - Ryy) + (cosine * cosine - sine * sine) * Rxy
        Wxw = cosine * Rxw - sine * Ryw
        Wyw = sine * Rxw + cosine * Ryw
        Www = Rww
        kx = cosine * hx - sine * hy
        ky = sine * hx + cosine * hy


@merged
def _outward(sizes: Sizes, constants: ArmConstants, loads: Loads, work: Workspace) -> None:
    """From the base to the tip: (R.12) to (R.14). Gravity is an acceleration of the base."""
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
        pull = work.joint[i, 0] * Ax + work.joint[i, 1] * Ay + work.joint[i, 2] * Aw
        joint_acceleration = (work.joint[i, 4] - pull) * work.joint[i, 3] + work.joint[i, 5]
        work.acceleration[i, 0] = joint_acceleration
        Aw = Aw + joint_acceleration

        # What the body gives to the chain at its tip; then its modes, then its tip.
        fx = work.gain[i, 0, 0] * Ax + work.gain[i, 0, 1] * Ay + work.gain[i, 0, 2] * Aw
        fy = work.gain[i, 1, 0] * Ax + work.gain[i, 1, 1] * Ay + work.gain[i, 1, 2] * Aw
        fw = work.gain[i, 2, 0] * Ax + work.gain[i, 2, 1] * Ay + work.gain[i, 2, 2] * Aw
        fx += work.gain[i, 0, 3]
        fy += work.gain[i, 1, 3]
        fw += work.gain[i, 2, 3]
        rising = Ay
        turning = Aw
        for _ in range(min(len(sizes.geometric), 1)):
            rising += work.rigid_shortening[i, 0] * Aw
            turning += work.rigid_shortening[i, 1] * Aw
        for j in range(len(sizes.modes)):
            work.acceleration[i, 1 + j] = -c.mobility[i, j] * (
                work.flex_bias[i, j]
                + c.S[i, j] * rising
                + c.a[i, j] * turning
                + c.P[i, j] * fy
                + c.dP[i, j] * fw
            )
        along = 0.0  # mean acceleration of the body along x, (R.45)
        Nxx, Nxy, Nxw = 0.0, 0.0, 0.0
        Nyy, Nyw, Nww = c.N[i, 0], c.N[i, 1], c.N[i, 2]
        for _ in range(min(len(sizes.geometric), 1)):
            along = work.mean_shortening[i, 3] * Ay + work.mean_shortening[i, 4] * Aw
            along += work.mean_shortening[i, 5] * fx
            along += work.transfer[i, 1, 0] * fy + work.transfer[i, 2, 0] * fw
            along = c.inverse_mass[i] * along + work.mean_shortening[i, 2]
            along += work.mean_shortening[i, 1] * Ax
            Nxx, Nxy, Nxw = work.N[i, 0], work.N[i, 1], work.N[i, 2]
            Nyy, Nyw, Nww = work.N[i, 3], work.N[i, 4], work.N[i, 5]
        for j in range(len(sizes.geometric)):
            work.acceleration[i, 1 + j] += c.mobility[i, j] * (
                work.shortening[i, j] * along - work.Fx[i, j] * fx
            )
        tip_x = work.transfer[i, 0, 0] * Ax + work.transfer[i, 0, 1] * Ay
        tip_y = work.transfer[i, 1, 0] * Ax + work.transfer[i, 1, 1] * Ay
        tip_w = work.transfer[i, 2, 0] * Ax + work.transfer[i, 2, 1] * Ay
        tip_x += work.transfer[i, 0, 2] * Aw - (Nxx * fx + Nxy * fy + Nxw * fw)
        tip_y += work.transfer[i, 1, 2] * Aw - (Nxy * fx + Nyy * fy + Nyw * fw)
        tip_w += work.transfer[i, 2, 2] * Aw - (Nxw * fx + Nyw * fy + Nww * fw)
        Ax = tip_x + work.drift[i, 0]
        Ay = tip_y + work.drift[i, 1]
        Aw = tip_w + work.drift[i, 2]
