"""Compile-time and run-time sizes give the same numbers from one source.

Each size is compiled again, so all tests here and the benchmark of forward dynamics share one.
"""

import numpy as np
import pytest

import flexarm as fa
from arm_states import parts, state_array, tip_loads
from arms import chain
from flexarm.kernels.layout import compile_time_sizes, new_workspace, run_time_sizes
from flexarm.kernels.recursion.articulated_body import forward_dynamics


def two_link_arm(theory="second_order"):
    """Return links of two and four modes, so that padding matters."""
    rod = {"flexural_rigidity": [20.0, 9.0], "mass_per_length": [0.5, 0.4], "elements": [1, 2]}
    joints = [{"hub_inertia": 0.01, "damping": 0.1}, {"mass": 0.3}]
    more = {"payload": fa.Payload(mass=0.2, inertia=0.001), "gravity": (1.0, -9.0)}
    return chain((0.8, 0.6), joints, theory=theory, **rod, **more)


def test_sizes_count_bodies_and_modes():
    arm = two_link_arm()
    for sizes in (
        run_time_sizes(arm.assembly.constants),
        compile_time_sizes(arm.assembly.constants),
    ):
        assert [len(part) for part in sizes] == [2, 4, 0, 4, 0, 0, 0, 0, 2, 0]
    sizes = run_time_sizes(two_link_arm("linear").assembly.constants)
    assert [len(part) for part in sizes] == [2, 4, 0, 0, 0, 0, 0, 0, 2, 0]


def test_compile_time_sizes_give_the_same_numbers():
    """For the forward dynamics, the kernel that runs with them, in the second-order theory.

    In the linear theory loops that are tested here are empty.
    """
    arm = two_link_arm()
    sizes, constants, work = parts(arm)
    fixed, other = compile_time_sizes(constants), new_workspace(constants)
    rng = np.random.default_rng(2)
    q, qd = rng.normal(size=(2, arm.dof)) * [[0.02], [0.5]]
    state = state_array(arm, q, qd)
    torque, loads = rng.normal(size=2), tip_loads(arm, rng.normal(size=3))
    forward_dynamics(sizes, constants, state, torque, loads, work)
    forward_dynamics(fixed, constants, state, torque, loads, other)
    # Unrolled sums may have another order and be fused: rounding of a few dozen terms.
    np.testing.assert_allclose(other.acceleration, work.acceleration, rtol=1e-11)


@pytest.mark.thorough
@pytest.mark.compiled
def test_compile_time_sizes_give_the_same_motion():
    arm = two_link_arm()
    free, fixed = (fa.simulate(arm, 0.3, specialized=given) for given in (False, True))
    assert abs(free.tip - free.tip[0]).max() > 0.1
    # The same formulas, with sums in another order: rounding grows over the run.
    np.testing.assert_allclose(fixed.tip, free.tip, atol=1e-9)
