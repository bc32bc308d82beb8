// Entry points for ctypes: repeat the forward dynamics, as an integrator would.

#include <vector>

#include "sweeps.hpp"

#ifndef BODIES
#define BODIES 2
#define MODES 4
#endif

namespace {

template <class Sizes>
void repeat(const Sizes& sizes, const double* arm, const double* gravity, double* q, const double* qd,
            const double* torque, Scratch<Sizes>* scratch, double* qdd, long calls) {
    for (long call = 0; call < calls; ++call) {
        forward_dynamics(sizes, arm, gravity, q, qd, torque, scratch, qdd);
        // Fed back, or the compiler could drop all calls but one.
        q[0] += 1e-12 * qdd[0];
    }
}

template <bool second_order>
void fixed(const double* arm, const double* gravity, double* q, const double* qd, const double* torque,
           double* qdd, long calls) {
    using Sizes = FixedSizes<BODIES, MODES, second_order>;
    Scratch<Sizes> scratch[BODIES];
    repeat(Sizes{}, arm, gravity, q, qd, torque, scratch, qdd, calls);
}

template <bool second_order>
void free_sizes(int n, int m, const double* arm, const double* gravity, double* q, const double* qd,
                const double* torque, double* qdd, long calls) {
    using Sizes = FreeSizes<64, second_order>;
    std::vector<Scratch<Sizes>> scratch(n);
    repeat(Sizes{n, m}, arm, gravity, q, qd, torque, scratch.data(), qdd, calls);
}

}  // namespace

extern "C" void repeat_fixed(int second_order, const double* arm, const double* gravity, double* q,
                             const double* qd, const double* torque, double* qdd, long calls) {
    if (second_order)
        fixed<true>(arm, gravity, q, qd, torque, qdd, calls);
    else
        fixed<false>(arm, gravity, q, qd, torque, qdd, calls);
}

extern "C" void repeat_free(int second_order, int n, int m, const double* arm, const double* gravity,
                            double* q, const double* qd, const double* torque, double* qdd, long calls) {
    if (second_order)
        free_sizes<true>(n, m, arm, gravity, q, qd, torque, qdd, calls);
    else
        free_sizes<false>(n, m, arm, gravity, q, qd, torque, qdd, calls);
}
