"""Labels, buffers and numbers that are kept between calls do not connect their results."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import flexarm as fa
from flexarm.arm.bending import LARGEST_ERROR, BendingErrors
from flexarm.simulation.run.tolerance import fastest_frequency


def an_arm(**options: object) -> fa.Arm:
    link = fa.Link(length=1.0, flexural_rigidity=100.0, mass_per_length=0.6, elements=2)
    return fa.Arm(links=[link, link], **options)


def run(arm: fa.Arm, **options: object):
    return fa.simulate(arm, 0.05, initial=arm.rest([0.3, -0.5]), progress=False, **options)


def test_results_of_one_arm_share_no_mutable_data() -> None:
    arm = an_arm()
    first, again = run(arm), run(arm)
    assert first.drop_attrs(deep=False).identical(again.drop_attrs(deep=False))
    for name, variable in first.variables.items():
        if variable.values.flags.writeable:
            variable.values[...] = 7.0
        variable.attrs["long_name"] = "changed"
        assert name == "time" or "changed" not in again.variables[name].attrs.values()
    first.attrs["arm"] = "changed"
    later = run(arm)
    assert again.drop_attrs(deep=False).identical(later.drop_attrs(deep=False))
    assert later.attrs["arm"] == again.attrs["arm"] != "changed"


@pytest.mark.parametrize("options", [{"rate": 200.0}, {"stations": 3}, {"tip_force": [0.1, 0.0]}])
def test_another_run_between_two_equal_ones_has_no_effect(options: dict[str, object]) -> None:
    arm = an_arm()
    run(arm)
    between = run(arm, **options)
    fresh = run(an_arm(), **options)
    assert list(between.variables) == list(fresh.variables)
    assert between.drop_attrs(deep=False).identical(fresh.drop_attrs(deep=False))


def test_frequency_depends_on_the_posture() -> None:
    arm = an_arm()
    states = [arm.padded(np.stack([arm.rest(angles), np.zeros(arm.dof)])) for angles in
              ([0.0, 0.0], [0.0, 2.0])]  # fmt: skip
    found = [fastest_frequency(arm, state) for state in (*states, states[0])]
    fresh = [fastest_frequency(an_arm(), state) for state in states]
    assert found[0] != found[1]
    assert found == [*fresh, fresh[0]]


def test_evaluations_return_separate_arrays() -> None:
    arm = an_arm()
    q, zero = arm.rest([0.3, -0.5]), np.zeros(arm.dof)
    for call in (
        lambda torque: arm.forward_dynamics(q, zero, torque),
        lambda torque: arm.inverse_dynamics(q, zero, arm.rest(torque)),
        lambda torque: arm.derivatives(q, arm.rest(torque), torque).q,
    ):
        first = call(np.array([1.0, 2.0]))
        kept = first.copy()
        assert np.any(call(np.array([3.0, -4.0])) != first)
        np.testing.assert_array_equal(first, kept)


def test_a_failed_evaluation_does_not_affect_the_next_one() -> None:
    arm = an_arm()
    q, zero, torque = arm.rest([0.3, -0.5]), np.zeros(arm.dof), np.ones(2)
    wanted = an_arm().forward_dynamics(q, zero, torque)
    with pytest.raises(fa.InputError, match="qd"):
        arm.forward_dynamics(q, np.full(arm.dof, np.nan), torque)
    with pytest.raises(fa.InputError, match="finite"):
        arm.forward_dynamics(q, np.full(arm.dof, 1e200), torque)
    np.testing.assert_array_equal(arm.forward_dynamics(q, zero, torque), wanted)


def test_numbers_whose_squares_overflow_are_used_without_a_warning() -> None:
    arm = an_arm()
    q, zero, torque = arm.rest([0.3, -0.5]), np.zeros(arm.dof), np.array([1e200, 0.0])
    found = arm.forward_dynamics(q, zero, torque)
    np.testing.assert_allclose(found, 1e200 * arm.forward_dynamics(q, zero, [1.0, 0.0]), rtol=1e-9)


def test_constants_of_equal_links_are_computed_once() -> None:
    arm = an_arm()
    equal = an_arm()
    other = fa.Link(length=1.1, **arm.spec.links[0].model_dump(exclude={"length"}))
    assert equal.assembly.links[0] is arm.assembly.links[1]
    changed = fa.Arm(links=[arm.spec.links[0], other])
    assert changed.assembly.links[0] is arm.assembly.links[0]
    assert changed.assembly.links[1].length == 1.1


def test_threads_may_share_one_arm() -> None:
    arm = an_arm()
    zero = np.zeros(arm.dof)
    postures = [arm.rest([0.1 * k, -0.2 * k]) for k in range(20)]

    def evaluated(q: np.ndarray) -> np.ndarray:
        return np.array([arm.forward_dynamics(q, zero, [1.0, 2.0]) for _ in range(50)])

    with ThreadPoolExecutor(4) as pool:
        for q, found in zip(postures, pool.map(evaluated, postures), strict=True):
            wanted = an_arm().forward_dynamics(q, zero, [1.0, 2.0])
            np.testing.assert_array_equal(found, np.broadcast_to(wanted, found.shape))


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_bound_excludes_no_large_error(theory: str) -> None:
    """If the bound accepts a state, its estimated error is small; some states are accepted."""
    arm = an_arm(theory=theory)
    errors = BendingErrors(arm)
    rng = np.random.default_rng(3)
    passed = 0
    for size in np.geomspace(1e-4, 1.0, 200):
        state = np.zeros((1, 2, 2, 5))
        state[0, 0, :, 1:] = size * rng.normal(size=(2, 4)) * rng.integers(0, 2, size=(2, 4))
        if errors.surely_small(state[0, 0, :, 1:]):
            passed += 1
            assert np.all(errors.of_links(state)[0][0] < LARGEST_ERROR * arm.lengths)
    assert passed > 20
