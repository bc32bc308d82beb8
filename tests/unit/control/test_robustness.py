"""Structured singular values against closed forms, and robust loops against sets of plants."""

import numpy as np
import pytest
from test_loop_margins import STEP, D, K, returned, robust_arm, turntable

import flexarm as fa
from flexarm.control.analysis.margins import loop_at
from flexarm.control.analysis.robustness import covering_ball, fitted_weight
from flexarm.control.analysis.structured import structured_bound


def complex_normal(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def test_bound_of_rank_one_matrices_has_a_closed_form():
    """For scalar blocks and M = a c' it is the sum of |a_i c_i|, without a gap."""
    rng = np.random.default_rng(0)
    a, c = complex_normal(rng, 6, 4), complex_normal(rng, 6, 4)
    found = structured_bound(a[:, :, None] * c[:, None, :], [1] * 4)
    np.testing.assert_allclose(found, np.abs(a * c).sum(axis=1), rtol=1e-5)  # balanced only


def test_bound_for_three_blocks_is_the_structured_singular_value():
    """It equals the largest spectral radius of M U over unitary diagonal U, by search."""
    M = complex_normal(np.random.default_rng(5), 1, 3, 3)
    angles = np.linspace(0.0, 2.0 * np.pi, 241)
    turns = np.stack(np.meshgrid(angles, angles), axis=-1).reshape(-1, 2)
    U = np.exp(1j * np.column_stack([np.zeros(len(turns)), turns]))
    wanted = np.abs(np.linalg.eigvals(M[0] * U[:, None, :])).max()
    # The steps of the search, 1.5 degrees, have second-order errors.
    assert structured_bound(M, [1, 1, 1])[0] == pytest.approx(wanted, rel=2e-4)


def test_bound_is_between_spectral_radius_and_norm():
    M = complex_normal(np.random.default_rng(2), 20, 4, 4)
    found = structured_bound(M, [2, 2])
    assert np.all(found >= np.abs(np.linalg.eigvals(M)).max(axis=1))
    assert np.all(found <= np.linalg.norm(M, 2, axis=(1, 2)) * (1.0 + 1e-12))
    np.testing.assert_allclose(structured_bound(M, [4]), np.linalg.norm(M, 2, axis=(1, 2)))


@pytest.mark.parametrize("blocks", [[1] * 5, [1, 1, 3], [2, 3]])
def test_largest_bound_is_that_of_slicot(blocks):
    slycot = pytest.importorskip("slycot")
    M = complex_normal(np.random.default_rng(1), 8, 5, 5)
    kinds = np.full(len(blocks), 2)
    wanted = [slycot.ab13md(each, np.array(blocks), kinds)[0] for each in M]
    assert structured_bound(M, blocks).max() == pytest.approx(max(wanted), rel=1e-6)


@pytest.mark.parametrize(
    ("matrix", "wanted"),
    [
        (np.eye(2), 1.0),
        ([[1.0, 0.5], [0.0, 1.0]], 1.0),
        ([[1.0, 1e-9], [1e-9, 1.0]], 1.0 + 1e-9),
        (np.zeros((2, 2)), 0.0),
    ],
)
def test_blocks_with_little_coupling_have_closed_forms(matrix, wanted):
    """mu of [[1, b], [c, 1]] is 1 + sqrt(b c)."""
    found = structured_bound(np.array([matrix], dtype=complex), [1, 1])
    assert found[0] == pytest.approx(wanted, abs=1e-6)  # zeros are replaced by 1e-12 of the norm


def test_ball_covers_the_samples_and_touches_one():
    samples = complex_normal(np.random.default_rng(3), 9, 5, 2, 2)
    centre, left, right = covering_ball(samples)
    inside = np.linalg.solve(left, samples - centre) @ np.linalg.inv(right)
    np.testing.assert_allclose(np.linalg.norm(inside, 2, axis=(2, 3)).max(axis=0), 1.0, rtol=1e-9)


def test_bounds_of_one_joint_and_two_plants_have_closed_forms():
    """(C.147): half the distance of both loops, relative to their mean return difference."""
    arm, inertia = turntable()
    heavy = arm.spec.replace(joints=[fa.Joint(hub_inertia=0.05 + 0.5 * inertia)])
    plants = [arm, fa.Arm(heavy).rigid()]
    controller = fa.JointPD(K, D, sample_time=STEP)
    found = fa.robustness(controller, plants, sensitivity=3.0)
    omega = found.frequency.values
    first, second = (returned(omega, inertia * factor) for factor in (1.0, 1.5))
    wanted = np.abs(first - second) / np.abs(2.0 + first + second)
    np.testing.assert_allclose(found.stability_mu.values, wanted, rtol=1e-5)
    # Robust performance of one loop: mu is the sum of both parts.
    wanted = wanted + 2.0 / 3.0 / np.abs(2.0 + first + second)
    np.testing.assert_allclose(found.performance_mu.values, wanted, rtol=1e-2)
    k = int(np.argmax(wanted))
    assert float(found.worst_performance_mu) == pytest.approx(wanted[k], rel=1e-6)
    # The plants differ by their inertia alone, so the relative change is 1 / 1.5 - 1.
    np.testing.assert_allclose(found.uncertainty.values, 1.0 / 3.0, rtol=1e-5)
    assert np.all(found.weight.values >= found.uncertainty.values * (1.0 - 1e-9))


def test_bound_of_nearly_equal_plants_is_the_norm_of_the_sensitivity():
    """(C.148): the norm is that of torques in N m at the motors, not of normalised ones."""
    arm, posture = robust_arm(gravity=(0.0, 0.0)).rigid(), [0.8, 0.9]
    controller = fa.JointPD([100.0, 5.0], [20.0, 1.0])
    plants = [fa.varied(arm, mass_factor=factor) for factor in (1.0, 1.0 + 1e-6)]
    found = fa.robustness(controller, plants, posture, sensitivity=2.0)
    angles = found.frequency.values * controller.sample_time
    S = loop_at(controller, arm, np.array(posture), None).sensitivity(np.exp(1j * angles))
    wanted = np.linalg.norm(S, 2, axis=(1, 2)).max() / 2.0
    assert float(found.worst_performance_mu) == pytest.approx(wanted, rel=1e-3)


@pytest.mark.sampled("one", "twice")
@pytest.mark.parametrize("kind", ["one", "none", "twice"])
def test_equal_plants_have_no_uncertainty(kind):
    arm, posture = robust_arm(gravity=(0.0, 0.0)), [0.8, 0.9]
    controller = fa.LQG(arm, posture) if kind == "none" else fa.JointPD([60.0, 20.0], [12.0, 4.0])
    plants = {"one": arm, "none": None, "twice": [arm, arm]}[kind]
    found = fa.robustness(controller, plants, posture)
    assert float(found.worst_stability_mu) == pytest.approx(0.0, abs=1e-6)
    angles = found.frequency.values * controller.sample_time
    S = loop_at(controller, arm, np.array(posture), None).sensitivity(np.exp(1j * angles))
    wanted = np.linalg.norm(S, 2, axis=(1, 2)).max() / 2.0
    assert float(found.worst_performance_mu) == pytest.approx(wanted, rel=1e-6)


def test_weight_of_first_order_is_found_again():
    omega = np.geomspace(0.01, 1000.0, 300)
    size = np.abs((0.2 + 0.3j * omega) / (1.0 + 0.1j * omega))
    numbers, weight = fitted_weight(omega, size)
    np.testing.assert_allclose(weight, size, rtol=1e-3)
    assert numbers == pytest.approx({"low": 0.2, "high": 3.0, "time": 0.3}, rel=1e-2)


@pytest.mark.thorough
def test_robust_loop_is_stable_for_plants_between_the_samples():
    arm, posture = robust_arm(gravity=(0.0, 0.0)), [0.8, 0.9]
    controller = fa.JointPD([60.0, 20.0], [12.0, 4.0])
    plants = [
        fa.varied(arm, flexural_rigidity_factor=factor) for factor in np.linspace(0.98, 1.02, 7)
    ]
    found = fa.robustness(controller, plants, posture, sensitivity=4.0)
    assert float(found.worst_stability_mu) < 1.0
    between = [fa.varied(arm, flexural_rigidity_factor=factor) for factor in (0.985, 0.995, 1.01)]
    assert float(fa.loop_margins(controller, between, posture).growth.max()) < 0.0


def test_an_unstable_sample_has_infinite_bounds():
    arm, _ = turntable()
    found = fa.robustness(fa.JointPD(30.0, 0.0, sample_time=STEP), arm)
    assert np.isinf(found.worst_stability_mu)
    assert np.isinf(found.worst_performance_mu)


def test_wrong_arguments_are_rejected():
    arm, _ = turntable()
    controller = fa.JointPD(K, D, sample_time=STEP)
    with pytest.raises(fa.InputError, match="sensitivity must be greater than 1"):
        fa.robustness(controller, arm, sensitivity=1.0)
    with pytest.raises(fa.InputError, match="posture must be one posture"):
        fa.robustness(controller, arm, [[0.0], [1.0]])
    hanging, upright = ([fa.Arm(arm.spec.replace(gravity=(g, 0.0)))] for g in (9.81, -9.81))
    with pytest.raises(fa.InputError, match="same number of unstable poles"):
        fa.robustness(controller, [*hanging, *upright], [0.0])
