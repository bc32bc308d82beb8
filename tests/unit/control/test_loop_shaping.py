"""H-infinity loop shaping against closed forms, other syntheses and sweeps over frequency."""

import numpy as np
import pytest
from test_loop_margins import robust_arm, turntable

import flexarm as fa
from flexarm.control.design.loop_shaping import bilinear, coprime_controller
from flexarm.control.design.rigid_model import RigidModel

POSTURE = [0.8, 0.9]


def test_margin_of_a_double_integrator_has_its_closed_form():
    """The least bound for 1/s^2 is sqrt(4 + 2 sqrt(2)): X and Z are known in closed form."""
    A, B, C = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    *_, margin, best = coprime_controller(A, B, C, np.zeros((1, 1)), 1.25)
    assert 1.0 / best == pytest.approx(np.sqrt(4.0 + 2.0 * np.sqrt(2.0)), rel=1e-12)
    assert margin == pytest.approx(best / 1.25, rel=1e-12)


def four_block(G, K):
    """Return the norms of (K; 1) (1 - G K)^-1 (1, G) for positive feedback, at each frequency."""
    p, m = G.shape[1:]
    inner = np.linalg.inv(np.eye(p) - G @ K)
    whole = np.concatenate([K, np.broadcast_to(np.eye(p), (len(G), p, p))], axis=1)
    ahead = np.concatenate([np.broadcast_to(np.eye(p), (len(G), p, p)), G], axis=2)
    assert m == K.shape[1]
    return np.linalg.svd(whole @ inner @ ahead, compute_uv=False)[:, 0]


@pytest.mark.parametrize("direct", [0.0, 0.3])
def test_margin_is_the_norm_of_the_loop(direct):
    """The largest of a sweep over frequency is at most the bound, and near it; also with D."""
    rng = np.random.default_rng(4)
    A, B, C = rng.normal(size=(5, 5)), rng.normal(size=(5, 2)), rng.normal(size=(3, 5))
    D = direct * rng.normal(size=(3, 2))
    *K, margin, best = coprime_controller(A, B, C, D, 1.02)
    omega = np.concatenate([[0.0], np.geomspace(1e-4, 1e5, 20_001)])
    norms = four_block(*(response(*one, omega) for one in ((A, B, C, D), K)))
    # The controller is near the optimal one, for which the norm is the same at all frequencies.
    assert 1.0 / best * (1.0 - 1e-9) <= norms.max() <= 1.0 / margin * (1.0 + 1e-9)
    closed = np.block([[A, np.zeros((5, 5))], [np.zeros((5, 5)), K[0]]])
    between = np.linalg.inv(np.eye(5) - np.block([[np.zeros((2, 2)), K[3]], [D, np.zeros((3, 3))]]))
    outer = np.block([[np.zeros((2, 5)), K[2]], [C, np.zeros((3, 5))]])
    inner = np.block([[B, np.zeros((5, 3))], [np.zeros((5, 2)), K[1]]])
    assert np.linalg.eigvals(closed + inner @ between @ outer).real.max() < 0.0


def response(A, B, C, D, omega):
    shifted = 1j * omega[:, None, None] * np.eye(len(A)) - A
    return C @ np.linalg.solve(shifted, np.broadcast_to(B, (len(omega), *B.shape))) + D


def test_bilinear_model_is_that_of_scipy():
    from scipy.signal import cont2discrete

    rng = np.random.default_rng(1)
    A, B, C = 0.5 * rng.normal(size=(4, 4)), rng.normal(size=(4, 2)), rng.normal(size=(3, 4))
    found = cont2discrete(bilinear(A, B, C, 0.3), 0.3, method="bilinear")
    for one, wanted in zip(found, (A, B, C, np.zeros((3, 2)), 0.3), strict=True):
        np.testing.assert_allclose(one, wanted, atol=1e-13)


@pytest.mark.parametrize("integral", [0.0, 0.8])
def test_margin_is_that_of_the_sampled_loop(integral):
    """A sweep over the sampled models of the loop, with the weights divided out again."""
    arm, bandwidth = robust_arm(), np.array([8.0, 5.0])
    made = fa.LoopShaping(
        arm, POSTURE, bandwidth, integral=integral, rigidity_uncertainty=0.0, sample_time=0.004
    )
    plant, controller = fa.loop_models(made)
    inside = np.pi / 0.004
    omega = np.unique(
        np.concatenate([np.geomspace(1e-2, 0.9999 * inside, 4001), *near_poles(plant)])
    )
    G, K = plant.frequency_response(omega), controller.frequency_response(omega)
    used = [
        plant.outputs.index(f"{name}[{k}]")
        for name in ("joint_angle", "joint_rate")
        for k in (1, 2)
    ]
    shown, through = G[:, used], K[..., used]
    w = 2j / 0.004 * np.tan(0.002 * omega)
    N = np.linalg.cholesky(RigidModel(arm).mass_matrix(np.array(POSTURE))) * np.sqrt(bandwidth)
    weight = N * (1.0 + integral / w)[:, None, None]
    G_s = N.T @ (0.25 * np.diag(bandwidth) @ shown[:, :2] + shown[:, 2:]) @ weight
    # The torque is weight K_s N' (omega / 4 angle + rate): take K_s from the part of the rate.
    K_s = np.linalg.solve(weight, through[..., 2:]) @ np.linalg.inv(N.T)
    norms = four_block(G_s, K_s)
    assert made.margin == pytest.approx(made.designs[0].best_margin / 1.1, rel=1e-12)
    assert 0.99 / made.designs[0].best_margin < norms.max() < 1.0001 / made.margin


def near_poles(plant):
    z = np.linalg.eigvals(plant.A)
    poles = np.log(z[np.abs(z) > 1e-3]) / plant.sample_time
    return [np.abs(p.imag) + np.abs(p.real) * np.linspace(-3, 3, 61) + 1e-3 for p in poles]


@pytest.mark.sampled("change2")
@pytest.mark.parametrize("change", [{"rigidity": 0.7}, {"rigidity": 1.3}, {"payload": 0.2}])
def test_design_for_an_uncertain_rigidity_is_stable_on_other_arms(change):
    arm, options = robust_arm(), {"bandwidth": 12.0, "integral": 1.0}
    made = fa.LoopShaping(arm, POSTURE, rigidity_uncertainty=0.3, **options)
    margins = fa.loop_margins(made, [arm, robust_arm(**change)])
    assert float(margins.growth.max()) < -0.1
    if "rigidity" in change:
        plain = fa.LoopShaping(arm, POSTURE, **options)
        assert float(fa.loop_margins(plain, robust_arm(**change)).growth.max()) > 0.1


@pytest.mark.thorough
def test_integral_feedback_removes_the_effect_of_a_constant_torque():
    arm, _ = turntable()
    for integral in (0.0, 0.8):
        made = fa.LoopShaping(arm, integral=integral, feedforward=lambda t: [0.3])
        angle = fa.simulate(arm, 12.0, controller=made, rate=10.0).joint_angle.values[-1, 0]
        # 0.19 rad without integral, of which the decay of exp(-0.8 t) leaves 1e-5.
        assert abs(angle) < 1e-4 if integral else abs(angle) > 0.1


def test_schedule_interpolates_the_controllers():
    made = fa.LoopShaping(robust_arm(), POSTURE, schedule=[None, [0.5, 1.3]])
    assert [list(item.posture) for item in made.designs] == [[0.8, 0.5], [0.8, 1.3]]
    assert made.margin == min(item.margin for item in made.designs)
    middle, ends = fa.loop_models(made, posture=[0.8, 0.7]).controller, made.designs
    joined = 0.75 * ends[0].A + 0.25 * ends[1].A
    np.testing.assert_allclose(middle.A, joined, rtol=1e-6, atol=1e-9 * np.abs(joined).max())


def test_another_sample_time_repeats_the_design():
    arm = robust_arm()
    made, wanted = (fa.LoopShaping(arm, POSTURE, sample_time=step) for step in (1e-3, 4e-3))
    made.sample_time = 0.004
    np.testing.assert_array_equal(made.designs[0].A, wanted.designs[0].A)
    with pytest.raises(fa.InputError, match="sample_time"):
        made.sample_time = 0.0


def test_synthesis_of_slycot_has_the_same_least_bound():
    """The general H-infinity synthesis reaches the closed-form bound, and no lower one."""
    control = pytest.importorskip("control")
    pytest.importorskip("slycot")
    A, B = np.array([[0.0, 1.0], [-4.0, -0.1]]), np.array([[0.0], [1.0]])
    C = np.array([[3.0, 1.0]])
    *_, best = coprime_controller(A, B, C, np.zeros((1, 1)), 1.1)
    # From (disturbance of y, disturbance of u, u) to (u, y, y); the norm is that of (C.143).
    whole = control.ss(
        A,
        np.hstack([np.zeros((2, 1)), B, B]),
        np.vstack([np.zeros((1, 2)), C, C]),
        [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
    )
    *_, gamma, _ = control.hinfsyn(whole, 1, 1)
    assert gamma == pytest.approx(1.0 / best, rel=1e-3)


def test_design_that_does_not_stabilise_the_arm_itself_warns():
    """With this much added damping the controller relies on damping that the links do not have."""
    gauge_free = {"material": "aluminium", "elements": 2, "damping": fa.ModalDamping(ratio=0.0)}
    links = [
        fa.Link(length=0.8, section=fa.Rectangle(width=0.05, height=0.006), **gauge_free),
        fa.Link(length=0.6, section=fa.Rectangle(width=0.04, height=0.004), **gauge_free),
    ]
    joints = [fa.Joint(hub_inertia=0.05), fa.Joint(mass=0.8, hub_inertia=0.01)]
    arm = fa.Arm(links=links, joints=joints, payload=fa.Payload(mass=0.3))
    with pytest.warns(fa.UnstableLoopWarning, match="The loop with the arm itself is unstable"):
        made = fa.LoopShaping(arm, [0.5, 0.7], bandwidth=10.0, rigidity_uncertainty=1.0)
    growth = float(fa.loop_margins(made, arm, [0.5, 0.7]).growth.max())
    assert growth > 0.1
    assert made.designs[0].growth == pytest.approx(growth, rel=1e-3)


@pytest.mark.parametrize("kind", [fa.LoopShaping, fa.LQG, fa.Composite])
def test_rigidity_uncertainty_is_a_fraction(kind):
    with pytest.raises(fa.InputError, match="rigidity_uncertainty must be at most 1, got 30"):
        kind(robust_arm(), POSTURE, rigidity_uncertainty=30)


@pytest.mark.parametrize("bandwidth", [1e6, [8.0, 785.4]])
def test_bandwidth_that_is_too_high_for_the_sample_time(bandwidth):
    with pytest.raises(fa.InputError, match="bandwidth must be at most 250 rad/s") as got:
        fa.LoopShaping(robust_arm(), POSTURE, bandwidth, sample_time=0.004)
    assert "or the sample_time of 0.004 s" in str(got.value)
