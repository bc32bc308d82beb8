"""Forward dynamics: comparison with C++ templates and dense algebra, and scaling."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

import flexarm as fa
from benchmarks.arms import chain, moving_state
from benchmarks.compiled_loop import ForwardDynamics
from benchmarks.limit import Limit, compiler
from benchmarks.measure import in_turns


class Comparison(NamedTuple):
    """Microseconds per evaluation for two links of four modes; None without a compiler."""

    theory: str
    compile_time_sizes: float
    run_time_sizes: float
    from_python: float
    scipy_dense: float
    limit: float | None  # C++, sizes as template arguments
    limit_run_time_sizes: float | None


def compare(theory: str, calls: int = 2_000, repeats: int = 200) -> Comparison:
    """Time one arm of two links with four modes each."""
    arm = chain(2, theory=theory)
    q, qd, torque = moving_state(arm)
    loop = ForwardDynamics(arm, q, qd, torque)
    fixed, free = loop.compile_time_sizes(), loop.run_time_sizes()
    candidates = {"fixed": lambda: loop(fixed, calls), "free": lambda: loop(free, calls)}
    if compiler() is not None:
        limit = checked_limit(arm, q, qd, torque)
        candidates["limit"] = lambda: limit.compile_time_sizes(calls)
        candidates["limit free"] = lambda: limit.run_time_sizes(calls)
    inside = {name: 1e6 * time / calls for name, time in in_turns(candidates, repeats).items()}

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
        theory,
        inside["fixed"],
        inside["free"],
        1e6 * outside["python"],
        1e6 * outside["dense"],
        inside.get("limit"),
        inside.get("limit free"),
    )


def checked_limit(arm: fa.Arm, q: np.ndarray, qd: np.ndarray, torque: np.ndarray) -> Limit:
    """Return the C++ templates for an arm after verifying their accelerations."""
    limit = Limit(arm, q, qd, torque)
    expected = arm.forward_dynamics(q, qd, torque)
    for repeat in (limit.compile_time_sizes, limit.run_time_sizes):
        repeat(1)
        # The state of the second call differs by 1e-12 rad from that of the first.
        found = arm.unpadded(limit.acceleration)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    return limit


def scaling_in_links(
    counts: tuple[int, ...] = (2, 4, 8, 16, 32, 64, 128, 256), repeats: int = 50
) -> dict[int, float]:
    """Return microseconds per link for one evaluation, with four modes per link."""
    calls = {links: max(4000 // links, 20) for links in counts}
    times = _times_in_turns({links: chain(links) for links in counts}, calls, repeats)
    return {links: time / links for links, time in times.items()}


def scaling_in_modes(
    counts: tuple[int, ...] = (2, 4, 8, 16, 32, 64), repeats: int = 50
) -> dict[int, float]:
    """Return microseconds per evaluation of two links by modes per link (linear theory)."""
    arms = {modes: chain(2, modes=modes, elements=max(modes // 2, 2)) for modes in counts}
    return _times_in_turns(arms, dict.fromkeys(counts, 2000), repeats)


def _times_in_turns(
    arms: Mapping[int, fa.Arm], calls: Mapping[int, int], repeats: int
) -> dict[int, float]:
    """Return microseconds per evaluation of each arm, with ``calls`` evaluations per turn."""
    candidates = {}
    for count, arm in arms.items():
        loop = ForwardDynamics(arm, *moving_state(arm))
        candidates[str(count)] = partial(loop, loop.run_time_sizes(), calls[count])
    seconds = in_turns(candidates, repeats)
    return {count: 1e6 * seconds[str(count)] / calls[count] for count in arms}
