// Forward dynamics of a chain of flexible links: docs/theory/recursion.md, sections 1 to 3.
//
// What a careful C++ programmer would write by hand for one arm: sizes as template arguments, scratch on
// the stack, and terms that the linear theory does not have removed by their type. It is the limit that
// the package's kernels are measured against, and no part of the package.
//
// Symbols are the book's: W, k the outboard chain; F, C the modes' rows and columns; H, h the root;
// T, N, z, Y as in (R.6) to (R.9). Wrenches and accelerations are (x, y, w) in the axes of the body.

#pragma once

#include <cmath>
#include <type_traits>

// Numbers known without computing. IEEE arithmetic may not drop 0 * x, which could be NaN; types may.
struct Zero {};
struct One {};
constexpr Zero operator*(Zero, Zero) { return {}; }
constexpr Zero operator*(Zero, double) { return {}; }
constexpr Zero operator*(double, Zero) { return {}; }
constexpr Zero operator*(Zero, One) { return {}; }
constexpr Zero operator*(One, Zero) { return {}; }
constexpr double operator*(One, double x) { return x; }
constexpr double operator*(double x, One) { return x; }
constexpr Zero operator+(Zero, Zero) { return {}; }
constexpr double operator+(Zero, double x) { return x; }
constexpr double operator+(double x, Zero) { return x; }
constexpr double operator-(Zero, double x) { return -x; }
constexpr double operator-(double x, Zero) { return x; }
constexpr Zero operator-(Zero, Zero) { return {}; }
constexpr double operator-(double x, One) { return x - 1.0; }

template <bool second_order>
using Geometric = std::conditional_t<second_order, double, Zero>;

// Lengths of the loops, part of the type or known at run time only. Both theories are types.
template <int n_, int m_, bool second_order_>
struct FixedSizes {
    static constexpr bool second_order = second_order_;
    static constexpr int most_modes = m_;
    static constexpr int n() { return n_; }
    static constexpr int m() { return m_; }
};

template <int most_modes_, bool second_order_>
struct FreeSizes {
    static constexpr bool second_order = second_order_;
    static constexpr int most_modes = most_modes_;
    int bodies, modes;
    int n() const { return bodies; }
    int m() const { return modes; }
};

// Numbers of one body, in the order of benchmarks/limit/limit.py: scalars, six rows of m, three m x m.
enum Scalar {
    MASS, INVERSE_MASS, FIRST_MOMENT_X, FIRST_MOMENT_Y, LENGTH, INERTIA, HUB, INVERSE_INERTIA,
    H_YY, H_YW, H_WW, T_YY, T_YW, T_WY, T_WW,
    N_YY, N_YW, N_WW, TIP_MASS, TIP_INERTIA, DAMPING, STIFFNESS, REST, ANGLE, SCALARS
};
enum Row { ROW_S, ROW_A, ROW_P, ROW_DP, ROW_W2, ROW_DELTA, ROWS };
enum Square { SQUARE_D0, SQUARE_D1, SQUARE_G, SQUARES };

template <class Sizes>
struct Body {
    const double* data;
    const Sizes& sizes;
    double operator[](Scalar name) const { return data[name]; }
    const double* row(Row name) const { return data + SCALARS + name * sizes.m(); }
    const double* square(Square name) const {
        return data + SCALARS + (ROWS + name * sizes.m()) * sizes.m();
    }
    static int stride(const Sizes& sizes) {
        return SCALARS + (ROWS + (Sizes::second_order ? SQUARES * sizes.m() : 0)) * sizes.m();
    }
};

struct Vector { double x, y, w; };
struct Symmetric { double xx, xy, yy, xw, yw, ww; };

// What one sweep leaves for the next, of one body.
template <class Sizes>
struct Scratch {
    using G = Geometric<Sizes::second_order>;
    double cosine, sine;
    double tip_x, tip_y, bias_x, bias_y;
    double s, spread;
    G alpha, beta;
    Vector root_bias;
    double h_f[Sizes::most_modes];
    double D0_eta[Sizes::second_order ? Sizes::most_modes : 1];
    double D1_eta[Sizes::second_order ? Sizes::most_modes : 1];
    double F_x[Sizes::second_order ? Sizes::most_modes : 1];
    // Left by the inward sweep.
    std::conditional_t<Sizes::second_order, double, One> Txx;
    G Txy, Tyx, Twx, Nxx, Nxy, Nxw;
    double Txw, Tyw;
    double Tyy, Twy, Tww, Nyy, Nyw, Nww;
    double mu_rates, kappa;  // (R.46), (R.44), of the second-order theory
    Vector drift, k, gx, gy, gw;  // rows of the gain
    double Hxw, Hyw, inverse, drive;
};

// Y = (1 + W N)^-1 W, (R.8).
template <class G>
inline Symmetric soften(const Symmetric& W, G Nxx, G Nxy, double Nyy, G Nxw, double Nyw, double Nww) {
    const double axx = 1.0 + (W.xx * Nxx + W.xy * Nxy + W.xw * Nxw);
    const double axy = W.xx * Nxy + W.xy * Nyy + W.xw * Nyw;
    const double axw = W.xx * Nxw + W.xy * Nyw + W.xw * Nww;
    const G ayx = W.xy * Nxx + W.yy * Nxy + W.yw * Nxw;
    const double ayy = 1.0 + (W.xy * Nxy + W.yy * Nyy + W.yw * Nyw);
    const double ayw = W.xy * Nxw + W.yy * Nyw + W.yw * Nww;
    const G awx = W.xw * Nxx + W.yw * Nxy + W.ww * Nxw;
    const double awy = W.xw * Nxy + W.yw * Nyy + W.ww * Nyw;
    const double aww = 1.0 + (W.xw * Nxw + W.yw * Nyw + W.ww * Nww);
    const double cxx = ayy * aww - ayw * awy;
    const double cxy = axw * awy - axy * aww;
    const double cxw = axy * ayw - axw * ayy;
    const G cyx = ayw * awx - ayx * aww;
    const double cyy = axx * aww - axw * awx;
    const double cyw = axw * ayx - axx * ayw;
    const G cwx = ayx * awy - ayy * awx;
    const double cwy = axy * awx - axx * awy;
    const double cww = axx * ayy - axy * ayx;
    const double d = 1.0 / (axx * cxx + axy * cyx + axw * cwx);
    return {d * (cxx * W.xx + cxy * W.xy + cxw * W.xw), d * (cxx * W.xy + cxy * W.yy + cxw * W.yw),
            d * (cyx * W.xy + cyy * W.yy + cyw * W.yw), d * (cxx * W.xw + cxy * W.yw + cxw * W.ww),
            d * (cyx * W.xw + cyy * W.yw + cyw * W.ww), d * (cwx * W.xw + cwy * W.yw + cww * W.ww)};
}
