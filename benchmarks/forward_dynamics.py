"""Forward dynamics: against a dense solution with SciPy, against the goals, and how it scales."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from benchmarks.arms import chain, moving_state
from benchmarks.compiled_loop import ForwardDynamics
from benchmarks.measure import in_turns, seconds_per_call


class Comparison(NamedTuple):
    """Microseconds for one evaluation of two links of four modes."""

    compile_time_sizes: float
    run_time_sizes: float
    from_python: float
    scipy_dense: float


def compare(calls: int = 20_000, repeats: int = 7) -> Comparison:
    """Time one arm of two links with four modes each."""
    arm = chain(2)
    q, qd, torque = moving_state(arm)
    loop = ForwardDynamics(arm, q, qd, torque)
    fixed, free = loop.compile_time_sizes(), loop.run_time_sizes()
    inside = in_turns(
        {"fixed": lambda: loop(fixed, calls), "free": lambda: loop(free, calls)}, repeats
    )

    full = np.zeros(arm.dof)
    full[arm.joint_index] = torque

    def dense() -> np.ndarray:
        factor = cho_factor(arm.mass_matrix(q))
        return cho_solve(factor, full - arm.bias_force(q, qd))

    outside = in_turns(
        {"python": lambda: arm.forward_dynamics(q, qd, torque), "dense": dense},
        repeats,
        max(calls // 100, 1),
    )
    return Comparison(
        1e6 * inside["fixed"] / calls,
        1e6 * inside["free"] / calls,
        1e6 * outside["python"],
        1e6 * outside["dense"],
    )


def scaling_in_links(
    counts: tuple[int, ...] = (2, 4, 8, 16, 32, 64, 128, 256), repeats: int = 5
) -> dict[int, float]:
    """Return microseconds per link of one evaluation, four modes a link."""
    times = {}
    for links in counts:
        arm = chain(links)
        loop = ForwardDynamics(arm, *moving_state(arm))
        sizes, calls = loop.run_time_sizes(), max(4000 // links, 20)
        once = seconds_per_call(lambda: loop(sizes, calls), repeats, 1)  # noqa: B023
        times[links] = 1e6 * once / calls / links
    return times


def scaling_in_modes(
    counts: tuple[int, ...] = (2, 4, 8, 16, 32, 64), repeats: int = 5
) -> dict[int, float]:
    """Return microseconds per evaluation of two links against modes a link (linear theory)."""
    times = {}
    for modes in counts:
        arm = chain(2, modes=modes, elements=max(modes // 2, 2))
        loop = ForwardDynamics(arm, *moving_state(arm))
        sizes, calls = loop.run_time_sizes(), 2000
        once = seconds_per_call(lambda: loop(sizes, calls), repeats, 1)  # noqa: B023
        times[modes] = 1e6 * once / calls
    return times
