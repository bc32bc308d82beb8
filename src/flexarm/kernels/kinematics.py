"""Outward pass that every algorithm shares: rates, tip positions and velocity products.

=================  ============================================================  ==========
symbol             meaning                                                       theory
=================  ============================================================  ==========
``w``              angular rate of the body axes                                 (L.3)
``phi``, ``v_L``   slope and deflection of the tip, dP.eta, P.eta                (R.1)
``u_L``            shortening of the tip along x, -1/2 eta' G eta                (R.1)
``s``              first moment about x, s_0 + S.eta                             (L.11)
``mu``             loss of first moment by shortening, -1/2 eta' D0 eta          (L.11)
``Gamma``          1 - R - D1, the centrifugal matrix                            (L.20)
=================  ============================================================  ==========
"""

from __future__ import annotations

from flexarm.kernels.cache import merged
from flexarm.kernels.layout import ArmConstants, Array, Sizes, Workspace
from flexarm.kernels.numbers import cos, sin


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
        spread = 0.0  # eta' Gamma eta
        spread_dot = 0.0  # eta' Gamma eta_dot
        for j in range(len(sizes.modes)):
            eta = state[0, i, 1 + j]
            eta_dot = state[1, i, 1 + j]
            phi += c.dP[i, j] * eta
            phi_dot += c.dP[i, j] * eta_dot
            v_tip += c.P[i, j] * eta
            v_tip_dot += c.P[i, j] * eta_dot
            s += c.S[i, j] * eta
            s_dot += c.S[i, j] * eta_dot
            gamma_eta = eta
            for k in range(len(sizes.centrifugal)):
                gamma_eta += c.centrifugal[i, j, k] * state[0, i, 1 + k]
            spread += eta * gamma_eta
            spread_dot += eta_dot * gamma_eta
            work.flex_bias[i, j] = c.w2[i, j] * eta + c.damping[i, j] * eta_dot - w * w * gamma_eta

        u_tip = 0.0
        u_tip_dot = 0.0
        u_tip_rates = 0.0  # eta_dot' G eta_dot
        mu = 0.0
        mu_dot = 0.0
        mu_rates = 0.0  # eta_dot' D0 eta_dot
        for j in range(len(sizes.geometric)):
            G_eta = 0.0
            G_eta_dot = 0.0
            D0_eta = 0.0
            D0_eta_dot = 0.0
            for k in range(len(sizes.geometric)):
                G_eta += c.G[i, j, k] * state[0, i, 1 + k]
                G_eta_dot += c.G[i, j, k] * state[1, i, 1 + k]
                D0_eta += c.D0[i, j, k] * state[0, i, 1 + k]
                D0_eta_dot += c.D0[i, j, k] * state[1, i, 1 + k]
            eta = state[0, i, 1 + j]
            eta_dot = state[1, i, 1 + j]
            u_tip -= 0.5 * eta * G_eta
            u_tip_dot -= eta_dot * G_eta
            u_tip_rates += eta_dot * G_eta_dot
            mu -= 0.5 * eta * D0_eta
            mu_dot -= eta_dot * D0_eta
            mu_rates += eta_dot * D0_eta_dot
            work.Fx[i, j] = -G_eta
            work.shortening[i, j] = D0_eta

        x_tip = c.length[i] + u_tip
        first_moment = c.first_moment_x[i] + mu
        work.tip[i, 0] = x_tip
        work.tip[i, 1] = v_tip
        work.tip_bias[i, 0] = -w * w * x_tip - 2.0 * w * v_tip_dot - u_tip_rates
        work.tip_bias[i, 1] = -w * w * v_tip + 2.0 * w * u_tip_dot
        work.moment[i, 0] = s
        work.moment[i, 1] = mu
        work.moment[i, 2] = spread
        work.mean_shortening[i, 0] = mu_rates
        work.root_bias[i, 0] = -2.0 * w * s_dot - w * w * first_moment - mu_rates
        work.root_bias[i, 1] = -w * w * s + 2.0 * w * mu_dot
        work.root_bias[i, 2] = 2.0 * w * spread_dot
        inboard_slope = phi
        inboard_rate = w + phi_dot
