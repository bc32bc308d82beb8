"""MPC against a quadratic programme solved otherwise; composite control against its two limits."""

import numpy as np
import pytest
from linear_arm import POSTURE, arm_with_gauges
from scipy.optimize import lsq_linear

import flexarm as fa
from flexarm.control import mpc as mpc_module

WISHES = {"acceptable": {"tip": 0.002, "joint_rate": 0.3}, "sample_time": 0.005}


@pytest.fixture(scope="module")
def arm():
    return arm_with_gauges()


def test_within_the_limits_it_is_the_regulator(arm):
    motion = fa.joint_motion(arm, [0.2, 0.6], POSTURE, 0.5, start_time=0.2)
    wide = fa.MPC(arm, POSTURE, torque_limit=[500.0, 100.0], **WISHES)
    runs = [
        fa.simulate(arm, 1.0, controller=controller, reference=motion, rate=200.0)
        for controller in (wide, fa.LQG(arm, POSTURE, **WISHES))
    ]
    assert wide.solved == 0
    # Sums of products in another order, of torques of some 10 N m.
    np.testing.assert_allclose(runs[0].torque.values, runs[1].torque.values, rtol=0, atol=1e-9)


def test_beyond_them_it_solves_the_quadratic_programme(arm):
    """SciPy's bounded least squares over the torques themselves, the model rolled out."""
    limit, horizon = np.array([1.5, 0.5]), 25
    controller = fa.MPC(arm, POSTURE, torque_limit=limit, horizon=horizon, **WISHES)
    controller.reset()
    design = controller.designs[0]
    hold = fa.joint_motion(arm, POSTURE, POSTURE, 1.0)
    seen = np.array([0.001, -0.003])
    measurement = fa.Measurement(
        joint_angle=np.add(POSTURE, seen), joint_rate=np.zeros(2), strain=np.array([2e-6, -1e-6])
    )
    torque = controller.update(0.0, measurement, hold)
    assert controller.solved == 1
    x0 = design.estimator @ np.append(seen, measurement.strain)

    def half(weight):
        values, vectors = np.linalg.eigh(weight)
        return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T

    roots = half(design.weight), half(design.torque_weight), half(design.cost)

    def residuals(torques, x):
        parts = []
        for u in torques.reshape(horizon, 2):
            parts += [roots[0] @ x, roots[1] @ u]
            x = design.A @ x + design.B @ u
        return np.concatenate([*parts, roots[2] @ x])

    nothing = residuals(np.zeros(2 * horizon), x0)
    columns = [residuals(unit, 0.0 * x0) for unit in np.eye(2 * horizon)]
    most = np.tile(limit, horizon)
    best = lsq_linear(np.array(columns).T, -nothing, (-most, most), method="bvls", tol=1e-14)
    assert np.any(np.abs(best.x) > 0.999 * most)
    # OSQP's tolerance.
    np.testing.assert_allclose(torque, best.x[:2], rtol=0, atol=1e-3 * limit.max())
    unlimited = -design.gain @ x0
    assert np.abs(torque - np.clip(unlimited, -limit, limit)).max() > 0.01


def test_limits_are_kept_exactly(arm):
    far = fa.joint_motion(arm, [1.0, 1.2], [1.0, 1.2], 1.0)
    limit, rate = np.array([2.0, 0.7]), np.array([100.0, 50.0])
    controller = fa.MPC(arm, POSTURE, torque_limit=limit, torque_rate=rate, **WISHES)
    run = fa.simulate(
        arm, 2.5, controller=controller, reference=far, initial=arm.rest(POSTURE), rate=200.0
    )
    torque = run.torque.values
    assert np.all(np.abs(torque) <= limit)
    assert np.any(np.abs(torque) == limit)
    steps = np.abs(np.diff(torque[:-1], axis=0))
    assert np.all(steps <= 0.005 * rate * (1.0 + 1e-12))
    assert np.any(steps > 0.005 * rate * (1.0 - 1e-9))
    np.testing.assert_allclose(run.joint_angle.values[-1], [1.0, 1.2], atol=5e-3)
    again = fa.simulate(
        arm, 0.3, controller=controller, reference=far, initial=arm.rest(POSTURE), rate=200.0
    )
    np.testing.assert_array_equal(again.torque.values[:-1], torque[:60])


def test_a_programme_that_is_not_solved_ends_the_run_with_its_status(arm, monkeypatch):
    monkeypatch.setattr(mpc_module, "_ITERATIONS", 1)
    controller = fa.MPC(arm, POSTURE, torque_limit=[0.1, 0.1], **WISHES)
    far = fa.joint_motion(arm, [1.0, 1.2], [1.0, 1.2], 1.0)
    with pytest.raises(fa.SimulationError, match=r"no torques within the limits .*iterations"):
        fa.simulate(arm, 0.5, controller=controller, reference=far, initial=arm.rest(POSTURE))


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"horizon": 0}, "horizon"),
        ({"horizon": 2.5}, "horizon"),
        ({"torque_rate": -1.0}, "torque_rate"),
        ({"torque_limit": None}, "torque_limit"),
    ],
    ids=lambda value: str(value),
)
def test_mpc_refuses(arm, options, word):
    with pytest.raises(fa.InputError, match=word):
        fa.MPC(arm, POSTURE, **{"torque_limit": 1.0, **options})


def test_slower_and_slower_joints_leave_the_two_parts_alone(arm):
    """As epsilon goes to zero the poles are those of the two designs: errors fall with it."""
    errors = []
    for bandwidth in (2.0, 1.0, 0.5):
        controller = fa.Composite(arm, POSTURE, bandwidth=bandwidth, damping_ratio=0.6)
        design, fast = controller.designs[0], controller.fast_designs[0]
        assert controller.epsilon == pytest.approx(bandwidth / fast.frequency[0])
        whole = np.linalg.eigvals(design.A - design.B @ design.gain)
        found = np.log(whole.astype(complex)) / controller.sample_time
        slow = bandwidth * (-0.6 + 0.8j)
        quick = np.log(np.linalg.eigvals(fast.A - fast.B @ fast.gain).astype(complex)) / 1e-3
        first = [np.sort(np.abs(found - slow) / bandwidth)[:2].max()]
        first += [np.abs(found - pole).min() / abs(pole) for pole in quick]
        errors.append(max(first))
    assert errors[2] < 0.1
    assert errors[1] < 0.7 * errors[0]
    assert errors[2] < 0.7 * errors[1]


def test_composite_follows_and_damps(arm):
    motion = fa.joint_motion(arm, [0.2, 0.6], POSTURE, 0.6)
    run = fa.simulate(arm, 4.0, controller=fa.Composite(arm, POSTURE), reference=motion, rate=200.0)
    np.testing.assert_allclose(run.joint_angle.values[-1], POSTURE, atol=2e-4)
    bend = np.abs(run.link_tip_deflection.values)
    assert bend[run.time > 3.0].max() < 0.02 * bend.max()


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"bandwidth": 0.0}, "bandwidth"),
        ({"damping_ratio": [1.0, 1.0, 1.0]}, "damping_ratio"),
        ({"acceptable": {"tip": 0.01}}, "tip"),
        ({"integral": True}, "integral"),
    ],
    ids=lambda value: str(value),
)
def test_composite_refuses(arm, options, word):
    with pytest.raises(fa.InputError, match=word):
        fa.Composite(arm, **options)
