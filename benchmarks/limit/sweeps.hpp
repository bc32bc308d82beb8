// The three sweeps over the bodies: rates outwards, inertia inwards, accelerations outwards.

#pragma once

#include "recursion.hpp"

// (R.1) to (R.3), (L.27).
template <class Sizes>
inline void rates(const Sizes& sizes, const double* arm, const double* q, const double* qd,
                  Scratch<Sizes>* scratch) {
    const int m = sizes.m();
    double slope = 0.0, rate = 0.0;
    for (int i = 0; i < sizes.n(); ++i) {
        const Body<Sizes> body{arm + i * Body<Sizes>::stride(sizes), sizes};
        Scratch<Sizes>& t = scratch[i];
        const double *eta = q + i * (1 + m) + 1, *eta_dot = qd + i * (1 + m) + 1;
        const double alpha = slope + body[ANGLE] + eta[-1];
        t.cosine = std::cos(alpha);
        t.sine = std::sin(alpha);
        const double w = rate + eta_dot[-1];
        double phi = 0, phi_dot = 0, v = 0, v_dot = 0, s = body[FIRST_MOMENT_Y], s_dot = 0;
        double spread = 0, spread_dot = 0;
        double u = 0, u_dot = 0, u_rates = 0, mu = 0, mu_dot = 0, mu_rates = 0;
        double chi = 0, chi_dot = 0, a_dot = 0;
        for (int j = 0; j < m; ++j) {
            const double e = eta[j], f = eta_dot[j];
            phi += body.row(ROW_DP)[j] * e;
            phi_dot += body.row(ROW_DP)[j] * f;
            v += body.row(ROW_P)[j] * e;
            v_dot += body.row(ROW_P)[j] * f;
            s += body.row(ROW_S)[j] * e;
            s_dot += body.row(ROW_S)[j] * f;
            if constexpr (Sizes::second_order) {
                double G_e = 0, G_f = 0, D_e = 0, D_f = 0, D1_e = 0;
                for (int k = 0; k < m; ++k) {
                    D1_e += body.square(SQUARE_D1)[j * m + k] * eta[k];
                    G_e += body.square(SQUARE_G)[j * m + k] * eta[k];
                    G_f += body.square(SQUARE_G)[j * m + k] * eta_dot[k];
                    D_e += body.square(SQUARE_D0)[j * m + k] * eta[k];
                    D_f += body.square(SQUARE_D0)[j * m + k] * eta_dot[k];
                }
                u -= 0.5 * e * G_e;
                u_dot -= f * G_e;
                u_rates += f * G_f;
                mu -= 0.5 * e * D_e;
                mu_dot -= f * D_e;
                mu_rates += f * D_f;
                t.F_x[j] = -G_e;
                t.D0_eta[j] = D_e;
                t.D1_eta[j] = D1_e;
                chi -= 0.5 * e * D1_e;
                chi_dot -= f * D1_e;
                a_dot += body.row(ROW_A)[j] * f;
            }
            spread += e * e;
            spread_dot += f * e;
            t.h_f[j] = body.row(ROW_W2)[j] * e + body.row(ROW_DELTA)[j] * f - w * w * e;
        }
        t.mu_rates = mu_rates;
        t.tip_x = body[LENGTH] + u;
        t.tip_y = v;
        t.bias_x = -w * w * t.tip_x - 2.0 * w * v_dot - u_rates;
        t.bias_y = -w * w * v + 2.0 * w * u_dot;
        t.s = s;
        t.spread = spread;
        t.root_bias.x = -2.0 * w * s_dot - w * w * (body[FIRST_MOMENT_X] + mu) - mu_rates;
        t.root_bias.y = -w * w * s + 2.0 * w * mu_dot;
        t.root_bias.w = 2.0 * w * spread_dot;
        if constexpr (Sizes::second_order) {
            // The rigid motion that stands for the shortening, (L.44).
            const double mc = body[FIRST_MOMENT_X], mean = body[INVERSE_MASS];
            const double per = 2.0 * body[INVERSE_INERTIA];
            const double central = chi - mean * mu * (mc + 0.5 * mu), y = per * central;
            const double y_dot = per * (chi_dot - mean * mu_dot * (mc + mu));
            const double turn = std::sqrt(1.0 + y + 0.125 * y * y * y * y);
            const double by_y = (0.5 + 0.25 * y * y * y) / turn, beta_dot = by_y * y_dot;
            t.beta = turn - 1.0;
            t.alpha = mean * (mu - mc * t.beta);
            const double alpha_dot = mean * (mu_dot - mc * beta_dot);
            const double across = w * (mc + mu) + s_dot;
            const double about = w * (mc * t.alpha + (body[INERTIA] - body[HUB]) * turn) + a_dot;
            const double left = by_y * per * (about - mean * mc * across);
            t.mu_rates += w * (s_dot + across - (mc + mu) * left);
            t.spread -= mean * s * s;
            t.root_bias.w += 2.0 * w * (chi_dot + 0.5 * y * y * central * y_dot);
            t.root_bias.w += alpha_dot * s_dot + beta_dot * a_dot;
            t.root_bias.w += mean * (s * mu_rates - mu_dot * s_dot);
            for (int j = 0; j < m; ++j)
                t.h_f[j] += w * ((alpha_dot + mean * mu_dot) * body.row(ROW_S)[j] +
                                 beta_dot * body.row(ROW_A)[j] + left * t.D1_eta[j]);
        }
        slope = phi;
        rate = w + phi_dot;
    }
}

// Eliminate one body behind (W, k): (R.5) to (R.11).
template <class Sizes>
inline void eliminate(const Body<Sizes>& body, double theta, double theta_dot, double torque,
                      Scratch<Sizes>& t, Symmetric& W, Vector& k) {
    using G = Geometric<Sizes::second_order>;
    const int m = body.sizes.m();
    W.xx += body[TIP_MASS];
    W.yy += body[TIP_MASS];
    W.ww += body[TIP_INERTIA];
    k.x += W.xx * t.bias_x + W.xy * t.bias_y;
    k.y += W.xy * t.bias_x + W.yy * t.bias_y;
    k.w += W.xw * t.bias_x + W.yw * t.bias_y;

    double Sh = 0, ah = 0, zy = 0, zw = 0;
    for (int j = 0; j < m; ++j) {
        const double h = t.h_f[j];
        Sh += body.row(ROW_S)[j] * h;
        ah += body.row(ROW_A)[j] * h;
        zy += body.row(ROW_P)[j] * h;
        zw += body.row(ROW_DP)[j] * h;
    }
    double Hxx = body[MASS], Hyy = body[H_YY], Hyw = body[H_YW], Hww = body[H_WW];
    double Tyy = body[T_YY], Tyw = body[T_YW], Twy = body[T_WY], Tww = body[T_WW];
    double Nyy = body[N_YY], Nyw = body[N_YW], Nww = body[N_WW];
    G dh{}, dS{}, da{}, zx{}, FS{}, Fa{};
    if constexpr (Sizes::second_order) {
        double dd = 0.0, Fd = 0.0, dP = 0.0, ddP = 0.0;
        t.Nxx = t.Nxy = t.Nxw = 0.0;
        for (int j = 0; j < m; ++j) {
            const double d = t.D0_eta[j], F = t.F_x[j], h = t.h_f[j];
            const double S = body.row(ROW_S)[j], a = body.row(ROW_A)[j];
            const double P = body.row(ROW_P)[j], slope = body.row(ROW_DP)[j];
            dh += d * h;
            dd += d * d;
            dS += d * S;
            da += d * a;
            zx += F * h;
            FS += F * S;
            Fa += F * a;
            Fd += F * d;
            dP += d * P;
            ddP += d * slope;
            t.Nxx += F * F;
            t.Nxy += F * P;
            t.Nxw += F * slope;
        }
        // The rigid motion that stands for the shortening goes with that of the root, (R.46).
        const double alpha = t.alpha, beta = t.beta;
        da += alpha * dS + beta * da - t.s;
        ah += alpha * Sh + beta * ah;
        Fa += alpha * FS + beta * Fa;
        Tyw += alpha * (Tyy - 1.0) + beta * (Tyw - body[LENGTH]);
        Tww += alpha * Twy + beta * (Tww - 1.0);
        Hww += alpha * (alpha * Hyy + 2.0 * (1.0 + beta) * Hyw) + beta * (2.0 + beta) * (Hww - body[HUB]);
        Hyw += alpha * Hyy + beta * Hyw;
        // The inertia of the mean shortening, (R.44).
        const double left = 1.0 / (1.0 + body[INVERSE_MASS] * dd);
        const double kappa = t.kappa = body[INVERSE_MASS] * left;
        const double lag = kappa * (dh - t.mu_rates);
        Sh -= dS * lag;
        ah += body[INVERSE_MASS] * t.s * t.mu_rates - da * lag;
        zx -= Fd * lag;
        zy -= dP * lag;
        zw -= ddP * lag;
        FS -= kappa * Fd * dS;
        Fa -= kappa * Fd * da;
        t.Nxx -= kappa * Fd * Fd;
        t.Nxy -= kappa * Fd * dP;
        t.Nxw -= kappa * Fd * ddP;
        Nyy -= kappa * dP * dP;
        Nyw -= kappa * dP * ddP;
        Nww -= kappa * ddP * ddP;
        Hxx *= left;
        Hyy += kappa * dS * dS;
        Hyw += kappa * dS * da;
        Hww += kappa * da * da;
        Tyy += kappa * dP * dS;
        Tyw += kappa * dP * da;
        Twy += kappa * ddP * dS;
        Tww += kappa * ddP * da;
        dh = t.mu_rates + left * (dh - t.mu_rates);
        dS *= left;
        da *= left;
        t.Txx = 1.0 + left * Fd;
        t.Tyx = left * dP;
        t.Twx = left * ddP;
        t.Txy = -FS;
        t.Tyy = Tyy;
        t.Twy = Twy;
        t.Tww = Tww;
        t.Nyy = Nyy;
        t.Nyw = Nyw;
        t.Nww = Nww;
    }
    double Hxw_own = -t.s;
    if constexpr (Sizes::second_order) Hxw_own = da;
    t.Txw = Zero{} - t.tip_y - Fa;
    Tyw += t.tip_x - body[LENGTH];
    t.Tyw = Tyw;
    const auto Txx = t.Txx;
    const G Txy = t.Txy, Tyx = t.Tyx, Twx = t.Twx;
    const double Txw = t.Txw;

    const Symmetric Y = soften<G>(W, t.Nxx, t.Nxy, Nyy, t.Nxw, Nyw, Nww);
    const double ex = zx + (t.Nxx * k.x + t.Nxy * k.y + t.Nxw * k.w) + 0.0;
    const double ey = zy + (t.Nxy * k.x + Nyy * k.y + Nyw * k.w);
    const double ew = zw + (t.Nxw * k.x + Nyw * k.y + Nww * k.w);
    if constexpr (Sizes::second_order) {
        k = {k.x - Y.xx * ex - Y.xy * ey - Y.xw * ew, k.y - Y.xy * ex - Y.yy * ey - Y.yw * ew,
             k.w - Y.xw * ex - Y.yw * ey - Y.ww * ew};
    } else {
        k = {k.x - Y.xy * ey - Y.xw * ew, k.y - Y.yy * ey - Y.yw * ew, k.w - Y.yw * ey - Y.ww * ew};
    }
    t.k = k;
    t.gx = {Y.xx * Txx + Y.xy * Tyx + Y.xw * Twx, Y.xx * Txy + Y.xy * Tyy + Y.xw * Twy,
            Y.xx * Txw + Y.xy * Tyw + Y.xw * Tww};
    t.gy = {Y.xy * Txx + Y.yy * Tyx + Y.yw * Twx, Y.xy * Txy + Y.yy * Tyy + Y.yw * Twy,
            Y.xy * Txw + Y.yy * Tyw + Y.yw * Tww};
    t.gw = {Y.xw * Txx + Y.yw * Tyx + Y.ww * Twx, Y.xw * Txy + Y.yw * Tyy + Y.ww * Twy,
            Y.xw * Txw + Y.yw * Tyw + Y.ww * Tww};
    Hxx += (Txx * t.gx.x + Tyx * t.gy.x + Twx * t.gw.x);
    const double Hxy = dS + (Txx * t.gx.y + Tyx * t.gy.y + Twx * t.gw.y);
    Hyy += (Txy * t.gx.y + Tyy * t.gy.y + Twy * t.gw.y);
    const double Hxw = Hxw_own + (Txx * t.gx.w + Tyx * t.gy.w + Twx * t.gw.w);
    Hyw += (Txy * t.gx.w + Tyy * t.gy.w + Twy * t.gw.w);
    Hww += t.spread + (Txw * t.gx.w + Tyw * t.gy.w + Tww * t.gw.w);
    const double hx = t.root_bias.x + dh + (Txx * k.x + Tyx * k.y + Twx * k.w);
    const double hy = t.root_bias.y - Sh + (Txy * k.x + Tyy * k.y + Twy * k.w);
    const double hw = t.root_bias.w - ah + (Txw * k.x + Tyw * k.y + Tww * k.w);
    t.drift = {t.bias_x - zx, t.bias_y - zy, -zw};

    // A revolute joint passes no moment but the motor's.
    const double own = -body[DAMPING] * theta_dot - body[STIFFNESS] * (theta - body[REST]);
    t.inverse = 1.0 / Hww;
    t.drive = torque + own - hw;
    t.Hxw = Hxw;
    t.Hyw = Hyw;
    const double Rxx = Hxx - Hxw * Hxw * t.inverse;
    const double Rxy = Hxy - Hxw * Hyw * t.inverse;
    const double Ryy = Hyy - Hyw * Hyw * t.inverse;
    const double lift = t.drive * t.inverse;
    const double rx = hx + Hxw * lift, ry = hy + Hyw * lift;
    const double C = t.cosine, S = t.sine;
    const double cross = 2.0 * C * S * Rxy;
    W = {C * C * Rxx - cross + S * S * Ryy, C * S * (Rxx - Ryy) + (C * C - S * S) * Rxy,
         S * S * Rxx + cross + C * C * Ryy, 0.0, 0.0, 0.0};
    k = {C * rx - S * ry, S * rx + C * ry, torque + own};
}

// (R.12) to (R.14).
template <class Sizes>
inline void accelerate(const Sizes& sizes, const double* arm, const double* gravity,
                       const Scratch<Sizes>* scratch, double* qdd) {
    const int m = sizes.m();
    double Ax = -gravity[0], Ay = -gravity[1], Aw = 0.0;
    for (int i = 0; i < sizes.n(); ++i) {
        const Body<Sizes> body{arm + i * Body<Sizes>::stride(sizes), sizes};
        const Scratch<Sizes>& t = scratch[i];
        double* eta_ddot = qdd + i * (1 + m) + 1;
        const double x = t.cosine * Ax + t.sine * Ay;
        Ay = t.cosine * Ay - t.sine * Ax;
        Ax = x;
        // The pivot is the moment per angular acceleration itself.
        const double lag = (t.drive - t.Hxw * Ax - t.Hyw * Ay) * t.inverse;
        eta_ddot[-1] = lag - Aw;
        Aw = lag;
        const double fx = t.gx.x * Ax + t.gx.y * Ay + t.gx.w * Aw + t.k.x;
        const double fy = t.gy.x * Ax + t.gy.y * Ay + t.gy.w * Aw + t.k.y;
        const double fw = t.gw.x * Ax + t.gw.y * Ay + t.gw.w * Aw + t.k.w;
        const double rising = Ay + t.alpha * Aw, turning = Aw + t.beta * Aw;
        for (int j = 0; j < m; ++j) {
            double total = t.h_f[j] + body.row(ROW_S)[j] * rising + body.row(ROW_A)[j] * turning +
                           body.row(ROW_P)[j] * fy + body.row(ROW_DP)[j] * fw;
            if constexpr (Sizes::second_order) total -= t.D0_eta[j] * Ax - t.F_x[j] * fx;
            eta_ddot[j] = -total;
        }
        double Tyy = body[T_YY], Twy = body[T_WY], Tww = body[T_WW];
        double yy = body[N_YY], yw = body[N_YW], ww = body[N_WW];
        if constexpr (Sizes::second_order) {
            double shortened = 0.0;
            for (int j = 0; j < m; ++j) shortened += t.D0_eta[j] * eta_ddot[j];
            const double lag = t.kappa * (shortened + t.mu_rates + t.s * Aw);
            for (int j = 0; j < m; ++j) eta_ddot[j] -= lag * t.D0_eta[j];
            Tyy = t.Tyy, Twy = t.Twy, Tww = t.Tww;
            yy = t.Nyy, yw = t.Nyw, ww = t.Nww;
        }
        const double tx = (t.Txx * Ax + t.Txy * Ay) + t.Txw * Aw - (t.Nxx * fx + t.Nxy * fy + t.Nxw * fw);
        const double ty = t.Tyx * Ax + Tyy * Ay + t.Tyw * Aw - (t.Nxy * fx + yy * fy + yw * fw);
        const double tw = t.Twx * Ax + Twy * Ay + Tww * Aw - (t.Nxw * fx + yw * fy + ww * fw);
        Ax = tx + t.drift.x;
        Ay = ty + t.drift.y;
        Aw = tw + t.drift.w;
    }
}

template <class Sizes>
inline void forward_dynamics(const Sizes& sizes, const double* arm, const double* gravity,
                             const double* q, const double* qd, const double* torque,
                             Scratch<Sizes>* scratch, double* qdd) {
    rates(sizes, arm, q, qd, scratch);
    Symmetric W{};
    Vector k{};
    for (int i = sizes.n() - 1; i >= 0; --i) {
        const Body<Sizes> body{arm + i * Body<Sizes>::stride(sizes), sizes};
        const int joint = i * (1 + sizes.m());
        eliminate(body, q[joint], qd[joint], torque[i], scratch[i], W, k);
    }
    accelerate(sizes, arm, gravity, scratch, qdd);
}
