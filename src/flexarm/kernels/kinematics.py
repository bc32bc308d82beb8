"""Outward pass that every algorithm shares: rates, tip positions and velocity products.

=================  ============================================================  ==========
symbol             meaning                                                       theory
=================  ============================================================  ==========
``w``              angular rate of the body axes                                 (L.3)
``phi``, ``v_L``   slope and deflection of the tip, dP.eta, P.eta                (R.1)
``u_L``            shortening of the tip along x, -1/2 eta' G eta                (R.1)
``s``              first moment about x, s_0 + S.eta                             (L.11)
``mu``             loss of first moment by shortening, -1/2 eta' D0 eta          (L.11)
``chi``            loss of half the inertia by shortening, -1/2 eta' D1 eta      (L.11)
``alpha, beta``    rigid motion alpha + beta x that stands for the shortening    (L.44)
=================  ============================================================  ==========
"""

from __future__ import annotations

from flexarm.kernels.cache import merged
from flexarm.kernels.layout import ArmConstants, Array, Sizes, Workspace
from flexarm.kernels.numbers import cos, sin, sqrt


@merged
def link_terms(sizes: Sizes, constants: ArmConstants, state: Array, work: Workspace) -> None:
    """Fill the fields of ``work`` from ``rotation`` to ``Fx`` for a state (2, n, 1 + m).

    Only products of rates enter the biases, no position or velocity of the origin: the equations
    are the same for every inertial observer.
    """
    c = constants
    inboard_slope = 0.0
    inboard_rate = 0.0
    for i in range(len(sizes.bodies)):
        alpha = inboard_slope + c.joint_angle[i] + state[0, i, 0]
        work.rotation[i, 0] = cos(alpha)
        work.rotation[i, 1] = sin(alpha)
        w = inboard_rate + state[1, i, 0]
        work.rate[i] = w

        phi = 0.0
        phi_dot = 0.0
        v_tip = 0.0
        v_tip_dot = 0.0
        s = c.first_moment_y[i]
        s_dot = 0.0
        spread = 0.0  # eta' (1 - R) eta
        spread_dot = 0.0  # eta' (1 - R) eta_dot
        for j in range(len(sizes.modes)):
            eta = state[0, i, 1 + j]
            eta_dot = state[1, i, 1 + j]
            phi += c.dP[i, j] * eta
            phi_dot += c.dP[i, j] * eta_dot
            v_tip += c.P[i, j] * eta
            v_tip_dot += c.P[i, j] * eta_dot
            s += c.S[i, j] * eta
            s_dot += c.S[i, j] * eta_dot
            spread_eta = eta
            for k in range(len(sizes.centrifugal)):
                spread_eta += c.centrifugal[i, j, k] * state[0, i, 1 + k]
            spread += eta * spread_eta
            spread_dot += eta_dot * spread_eta
            work.flex_bias[i, j] = c.w2[i, j] * eta + c.damping[i, j] * eta_dot - w * w * spread_eta

        u_tip = 0.0
        u_tip_dot = 0.0
        u_tip_rates = 0.0  # eta_dot' G eta_dot
        mu = 0.0
        mu_dot = 0.0
        mu_rates = 0.0  # eta_dot' D0 eta_dot
        chi = 0.0
        chi_dot = 0.0
        a_dot = 0.0  # a . eta_dot
        for j in range(len(sizes.geometric)):
            G_eta = 0.0
            G_eta_dot = 0.0
            D0_eta = 0.0
            D0_eta_dot = 0.0
            D1_eta = 0.0
            for k in range(len(sizes.geometric)):
                G_eta += c.G[i, j, k] * state[0, i, 1 + k]
                G_eta_dot += c.G[i, j, k] * state[1, i, 1 + k]
                D0_eta += c.D0[i, j, k] * state[0, i, 1 + k]
                D0_eta_dot += c.D0[i, j, k] * state[1, i, 1 + k]
                D1_eta += c.D1[i, j, k] * state[0, i, 1 + k]
            eta = state[0, i, 1 + j]
            eta_dot = state[1, i, 1 + j]
            u_tip -= 0.5 * eta * G_eta
            u_tip_dot -= eta_dot * G_eta
            u_tip_rates += eta_dot * G_eta_dot
            mu -= 0.5 * eta * D0_eta
            mu_dot -= eta_dot * D0_eta
            mu_rates += eta_dot * D0_eta_dot
            chi -= 0.5 * eta * D1_eta
            chi_dot -= eta_dot * D1_eta
            a_dot += c.a[i, j] * eta_dot
            work.Fx[i, j] = -G_eta
            work.shortening[i, j] = D0_eta
            work.spin_shortening[i, j] = D1_eta

        x_tip = c.length[i] + u_tip
        first_moment = c.first_moment_x[i] + mu
        work.tip[i, 0] = x_tip
        work.tip[i, 1] = v_tip
        work.tip_bias[i, 0] = -w * w * x_tip - 2.0 * w * v_tip_dot - u_tip_rates
        work.tip_bias[i, 1] = -w * w * v_tip + 2.0 * w * u_tip_dot
        work.moment[i, 0] = s
        work.moment[i, 1] = mu
        work.moment[i, 2] = spread
        work.moment[i, 3] = spread
        work.root_bias[i, 0] = -2.0 * w * s_dot - w * w * first_moment - mu_rates
        work.root_bias[i, 1] = -w * w * s + 2.0 * w * mu_dot
        work.root_bias[i, 2] = 2.0 * w * spread_dot
        for _ in range(min(len(sizes.geometric), 1)):
            # The rigid motion across the axis that stands for the shortening, and its derivatives.
            m = c.mass[i]
            mc = c.first_moment_x[i]
            mean = c.inverse_mass[i]
            per = 2.0 * c.inverse_inertia[i]
            central = chi - mean * mu * (mc + 0.5 * mu)  # as chi, about the centre of mass
            y = per * central
            y_dot = per * (chi_dot - mean * mu_dot * (mc + mu))
            turn = sqrt(1.0 + y + 0.125 * y * y * y * y)
            slope = (0.5 + 0.25 * y * y * y) / turn
            beta = turn - 1.0
            beta_mu = -slope * per * mean * (mc + mu)
            beta_chi = slope * per
            beta_dot = slope * y_dot
            alpha = mean * (mu - mc * beta)
            alpha_dot = mean * (mu_dot - mc * beta_dot)
            across = w * first_moment + s_dot
            about = w * (mc * alpha + (c.inertia[i] - c.hub[i]) * turn) + a_dot
            along_D0 = w * (mean * across + beta_mu * (about - mean * mc * across))
            along_D1 = w * beta_chi * (about - mean * mc * across)
            work.rigid_shortening[i, 0] = alpha
            work.rigid_shortening[i, 1] = beta
            work.mean_shortening[i, 0] = mu_rates + w * s_dot + m * along_D0
            extra = 0.5 * y * y * central
            work.moment[i, 2] += 2.0 * chi + 0.5 * extra * y
            work.moment[i, 3] -= mean * s * s
            work.root_bias[i, 2] += 2.0 * w * (chi_dot + extra * y_dot)
            work.root_bias[i, 2] += alpha_dot * s_dot + beta_dot * a_dot
            work.root_bias[i, 2] += mean * (s * mu_rates - mu_dot * s_dot)
            along_S = w * (alpha_dot + mean * mu_dot)
            along_a = w * beta_dot
            for j in range(len(sizes.geometric)):
                work.flex_bias[i, j] += (
                    along_S * c.S[i, j]
                    + along_a * c.a[i, j]
                    + along_D1 * work.spin_shortening[i, j]
                )
        inboard_slope = phi
        inboard_rate = w + phi_dot
