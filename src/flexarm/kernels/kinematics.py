"""Kinematics of the links: the outward pass shared by every algorithm.

=================  ============================================================  ==========
symbol             meaning                                                       theory
=================  ============================================================  ==========
``w``              angular rate of the body axes                                 (L.3)
``phi``, ``v_L``   slope and deflection of the tip, dP.eta, P.eta                (R.1)
``u_L``            shortening of the tip along x, -1/2 eta' G eta                (R.1)
``s``              first moment about x, s_0 + S.eta                             (L.11)
``mu``             change of first moment by shortening, -1/2 eta' D0 eta        (L.11)
``chi``            change of half the inertia by shortening, -1/2 eta' D1 eta    (L.11)
``alpha, beta``    rigid motion alpha + beta x equivalent to the shortening      (L.44)
=================  ============================================================  ==========
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.columns import (
    ALPHA,
    BENT_INERTIA,
    BENT_RESIDUAL,
    BETA,
    COSINE,
    D0,
    D0_ETA,
    D1,
    D1_ETA,
    DP,
    FIRST_MOMENT_X,
    FIRST_MOMENT_Y,
    FLEX_BIAS,
    FX,
    HUB,
    INERTIA,
    INVERSE_INERTIA,
    INVERSE_MASS,
    JOINT_ANGLE,
    JOINT_BIAS_X,
    JOINT_BIAS_Y,
    LENGTH,
    MASS,
    MEAN_RATES,
    MODE_DAMPING,
    MOMENT_MU,
    MOMENT_S,
    PLACE_X,
    PLACE_Y,
    RATE,
    ROOT_BIAS_W,
    ROOT_BIAS_X,
    ROOT_BIAS_Y,
    ROOT_FROM_X,
    ROOT_FROM_Y,
    SINE,
    SLIDE_X,
    SLIDE_Y,
    SLIDES,
    TIP_BIAS_X,
    TIP_BIAS_Y,
    TIP_RATE,
    TIP_SLOPE,
    TIP_X,
    TIP_Y,
    W2,
    A,
    G,
    P,
    S,
)
from flexarm.kernels.compilation.cache import merged
from flexarm.kernels.compilation.numbers import cos, sin, sqrt
from flexarm.kernels.layout import ArmConstants, Array, Sizes, Workspace


@merged
def link_terms(sizes: Sizes, constants: ArmConstants, state: Array, work: Workspace) -> None:
    """Fill the columns of ``work`` up to MEAN_RATES, and of its modes, for a state (2, n, 1 + m).

    The biases contain only products of rates, and no position or velocity of the origin, because
    the equations are the same in every inertial frame.
    """
    c = constants
    inboard_slope = 0.0
    inboard_rate = 0.0
    for i in range(len(sizes.bodies)):
        turned = state[0, i, 0]
        turning = state[1, i, 0]
        if len(sizes.tree) > 0:
            inboard_slope, inboard_rate = _section_below(sizes, i, work)
            _place_root(sizes, c, i, state, inboard_rate, work)
            turned = turned * (1.0 - c.body[i, SLIDES])
            turning = turning * (1.0 - c.body[i, SLIDES])
        alpha = inboard_slope + c.body[i, JOINT_ANGLE] + turned
        work.body[i, COSINE] = cos(alpha)
        work.body[i, SINE] = sin(alpha)
        w = inboard_rate + turning
        work.body[i, RATE] = w

        phi = 0.0
        phi_dot = 0.0
        v_tip = 0.0
        v_tip_dot = 0.0
        s = c.body[i, FIRST_MOMENT_Y]
        s_dot = 0.0
        spread = 0.0  # eta' (1 - R) eta
        spread_dot = 0.0  # eta' (1 - R) eta_dot
        for j in range(len(sizes.modes)):
            eta = state[0, i, 1 + j]
            eta_dot = state[1, i, 1 + j]
            phi += c.mode[i, j, DP] * eta
            phi_dot += c.mode[i, j, DP] * eta_dot
            v_tip += c.mode[i, j, P] * eta
            v_tip_dot += c.mode[i, j, P] * eta_dot
            s += c.mode[i, j, S] * eta
            s_dot += c.mode[i, j, S] * eta_dot
            spread_eta = eta
            for k in range(len(sizes.centrifugal)):
                spread_eta += c.centrifugal[i, j, k] * state[0, i, 1 + k]
            spread += eta * spread_eta
            spread_dot += eta_dot * spread_eta
            work.mode[i, j, FLEX_BIAS] = (
                c.mode[i, j, W2] * eta + c.mode[i, j, MODE_DAMPING] * eta_dot - w * w * spread_eta
            )

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
                G_eta += c.shortening[i, j, k, G] * state[0, i, 1 + k]
                G_eta_dot += c.shortening[i, j, k, G] * state[1, i, 1 + k]
                D0_eta += c.shortening[i, j, k, D0] * state[0, i, 1 + k]
                D0_eta_dot += c.shortening[i, j, k, D0] * state[1, i, 1 + k]
                D1_eta += c.shortening[i, j, k, D1] * state[0, i, 1 + k]
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
            a_dot += c.mode[i, j, A] * eta_dot
            work.mode[i, j, FX] = -G_eta
            work.mode[i, j, D0_ETA] = D0_eta
            work.mode[i, j, D1_ETA] = D1_eta

        x_tip = c.body[i, LENGTH] + u_tip
        first_moment = c.body[i, FIRST_MOMENT_X] + mu
        work.body[i, TIP_X] = x_tip
        work.body[i, TIP_Y] = v_tip
        work.body[i, TIP_BIAS_X] = -w * w * x_tip - 2.0 * w * v_tip_dot - u_tip_rates
        work.body[i, TIP_BIAS_Y] = -w * w * v_tip + 2.0 * w * u_tip_dot
        work.body[i, MOMENT_S] = s
        work.body[i, MOMENT_MU] = mu
        work.body[i, BENT_INERTIA] = spread
        work.body[i, BENT_RESIDUAL] = spread
        work.body[i, ROOT_BIAS_X] = -2.0 * w * s_dot - w * w * first_moment - mu_rates
        work.body[i, ROOT_BIAS_Y] = -w * w * s + 2.0 * w * mu_dot
        work.body[i, ROOT_BIAS_W] = 2.0 * w * spread_dot
        if len(sizes.geometric) > 0:
            # The rigid lateral motion equivalent to the shortening, and its derivatives.
            m = c.body[i, MASS]
            mc = c.body[i, FIRST_MOMENT_X]
            mean = c.body[i, INVERSE_MASS]
            per = 2.0 * c.body[i, INVERSE_INERTIA]
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
            about = w * (mc * alpha + (c.body[i, INERTIA] - c.body[i, HUB]) * turn) + a_dot
            along_D0 = w * (mean * across + beta_mu * (about - mean * mc * across))
            along_D1 = w * beta_chi * (about - mean * mc * across)
            work.body[i, ALPHA] = alpha
            work.body[i, BETA] = beta
            work.body[i, MEAN_RATES] = mu_rates + w * s_dot + m * along_D0
            extra = 0.5 * y * y * central
            work.body[i, BENT_INERTIA] += 2.0 * chi + 0.5 * extra * y
            work.body[i, BENT_RESIDUAL] -= mean * s * s
            work.body[i, ROOT_BIAS_W] += 2.0 * w * (chi_dot + extra * y_dot)
            work.body[i, ROOT_BIAS_W] += alpha_dot * s_dot + beta_dot * a_dot
            work.body[i, ROOT_BIAS_W] += mean * (s * mu_rates - mu_dot * s_dot)
            along_S = w * (alpha_dot + mean * mu_dot)
            along_a = w * beta_dot
            for j in range(len(sizes.geometric)):
                work.mode[i, j, FLEX_BIAS] += (
                    along_S * c.mode[i, j, S]
                    + along_a * c.mode[i, j, A]
                    + along_D1 * work.mode[i, j, D1_ETA]
                )
        inboard_slope = phi
        inboard_rate = w + phi_dot
        if len(sizes.tree) > 0:
            work.body[i, TIP_SLOPE] = phi
            work.body[i, TIP_RATE] = w + phi_dot


@merged
def _section_below(sizes: Sizes, i: int, work: Workspace) -> Any:
    """Return slope and rate of the section that carries body i; zero for the ground."""
    slope, rate = 0.0, 0.0
    carrier = sizes.joints[i, 0]
    if carrier >= 0:
        slope, rate = work.body[carrier, TIP_SLOPE], work.body[carrier, TIP_RATE]
    return slope, rate


@merged
def root_from_section(sizes: Sizes, constants: ArmConstants, i: int, state: Array) -> Any:
    """Return the root of body i from the section that carries it, axes of the body, (M.2)."""
    c = constants
    angle = c.body[i, JOINT_ANGLE] + state[0, i, 0] * (1.0 - c.body[i, SLIDES])
    cosine = cos(angle)
    sine = sin(angle)
    x = (
        cosine * c.body[i, PLACE_X]
        + sine * c.body[i, PLACE_Y]
        + c.body[i, SLIDE_X] * state[0, i, 0]
    )
    y = (
        cosine * c.body[i, PLACE_Y]
        - sine * c.body[i, PLACE_X]
        + c.body[i, SLIDE_Y] * state[0, i, 0]
    )
    return x, y


@merged
def _place_root(
    sizes: Sizes, constants: ArmConstants, i: int, state: Array, rate: Any, work: Workspace
) -> None:
    """Write the place of the root and its velocity products; ``rate``: of the section, (M.3)."""
    c = constants
    x, y = root_from_section(sizes, c, i, state)
    work.body[i, ROOT_FROM_X] = x
    work.body[i, ROOT_FROM_Y] = y
    slide = 2.0 * rate * state[1, i, 0]
    work.body[i, JOINT_BIAS_X] = -rate * rate * x - slide * c.body[i, SLIDE_Y]
    work.body[i, JOINT_BIAS_Y] = -rate * rate * y + slide * c.body[i, SLIDE_X]
