"""MPC against a quadratic programme by another solver; composite control in its two limits."""

import warnings
from importlib import import_module

import numpy as np
import pytest
from linear_arm import POSTURE, arm_with_gauges
from scipy.optimize import lsq_linear, minimize

import flexarm as fa
from flexarm.control.laws import mpc as mpc_module
from flexarm.simulation.loop.stability import Stability

WISHES = {
    "acceptable": {"tip": 0.002, "joint_rate": 0.3},
    "acceptable_torque": [8.6, 0.86],
    "sample_time": 0.005,
}


@pytest.fixture(scope="module")
def arm():
    return arm_with_gauges()


def test_within_its_limits_mpc_equals_the_regulator(arm):
    motion = fa.joint_motion(arm, [0.2, 0.6], POSTURE, 0.5, start_time=0.2)
    wide = fa.MPC(arm, POSTURE, torque_limit=[500.0, 100.0], **WISHES)
    runs = [
        fa.simulate(arm, 1.0, controller=controller, reference=motion, rate=200.0)
        for controller in (wide, fa.LQG(arm, POSTURE, **WISHES))
    ]
    assert wide.limited == 0
    # Sums of products in another order, of torques of about 10 N m.
    np.testing.assert_allclose(runs[0].torque.values, runs[1].torque.values, rtol=0, atol=1e-9)


def test_beyond_its_limits_mpc_solves_the_quadratic_programme(arm):
    """SciPy's bounded least squares over the torques, with all steps of the model written out."""
    limit, horizon = np.array([1.5, 0.5]), 25
    controller = fa.MPC(arm, POSTURE, torque_limit=limit, horizon=horizon, **WISHES)
    controller.reset()
    design = controller.designs[0]
    hold = fa.joint_motion(arm, POSTURE, POSTURE, 1.0)
    seen = np.array([0.01, -0.03])
    measurement = fa.Measurement(
        joint_angle=np.add(POSTURE, seen), joint_rate=np.zeros(2), strain=np.array([2e-6, -1e-6])
    )
    torque = controller.update(0.0, measurement, hold)
    assert controller.limited == 1
    first = np.zeros(2 * arm.dof)  # the first prediction has the measured joint angles
    first[arm.joint_index] = seen
    readings = np.append(seen, measurement.strain)
    x0 = first + design.estimator @ (readings - design.C @ first)

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
    # Both are exact up to rounding, which the square roots of the weights amplify.
    np.testing.assert_allclose(torque, best.x[:2], rtol=0, atol=1e-6 * limit.max())
    unlimited = -design.gain @ x0
    assert np.abs(torque - np.clip(unlimited, -limit, limit)).max() > 0.01


@pytest.mark.thorough
def test_limits_are_never_exceeded(arm):
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


@pytest.mark.thorough
def test_every_sample_has_a_plan_within_low_torque_rates(capfd):
    """A constant torque is always allowed, so no limit may end a run."""
    rod = {"mass_per_length": 0.61732, "flexural_rigidity": 105.0, "elements": 1}
    gauges, damping = [fa.Gauge(station=0.05, distance=0.005)], fa.ModalDamping(ratio=0.01)
    arm = fa.Arm(
        links=[
            fa.Link(length=length, gauges=gauges, damping=damping, **rod)
            for length in (1.4142, 1.0)
        ],
        joints=[
            fa.Joint(hub_inertia=0.1),
            fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02),
        ],
    )
    motion = fa.line_motion(arm, (2.0, 1.0), (1.0, 2.0), 1.0, start_time=0.5)
    limit = np.array([12.0, 2.2])
    tight = {"tip": 0.001, "joint_rate": 0.3}
    for per_second in (200.0, 50.0):
        rate = per_second * limit / 12.0
        controller = fa.MPC(
            arm, [0.0, -0.9], torque_limit=limit, torque_rate=rate, acceptable=tight
        )
        with warnings.catch_warnings():
            # At the slower rate the arm cannot follow and vibrates. The design is for another
            # posture than the start, and tight.
            warnings.simplefilter("ignore", fa.FlexarmWarning)
            run = fa.simulate(arm, 1.5, controller=controller, reference=motion, rate=200.0)
        torque = run.torque.values
        assert np.all(np.abs(torque) <= limit)
        assert np.all(np.abs(np.diff(torque, axis=0)) <= 0.005 * rate * (1.0 + 1e-9))
        assert run.mpc_limited > 100
        assert run.mpc_inaccurate == run.mpc_fallback == 0
    assert capfd.readouterr().out == ""


def test_without_a_solution_the_previous_plan_continues(arm, monkeypatch):
    limit = np.array([2.0, 0.7])
    controller = fa.MPC(arm, POSTURE, torque_limit=limit, **WISHES)
    far = fa.joint_motion(arm, [1.0, 1.2], [1.0, 1.2], 1.0)
    # The stability analysis before a run would make additional calls.
    run = import_module("flexarm.simulation.calls.run")
    monkeypatch.setattr(run, "stability", lambda *_: Stability("", np.nan))
    solve, calls = mpc_module.least_distance, []

    def sometimes(*arguments):
        calls.append(arguments)
        return (None, arguments[2]) if len(calls) in (5, 6) else solve(*arguments)

    monkeypatch.setattr(mpc_module, "least_distance", sometimes)
    observed = fa.DisturbanceObserver(arm, controller, 2.0)
    run = fa.simulate(
        arm, 0.3, controller=controller, reference=far, initial=arm.rest(POSTURE), rate=200.0
    )
    assert run.mpc_fallback == 2
    assert run.mpc_limited == controller.limited == len(calls)
    assert np.all(np.abs(run.torque.values) <= limit)
    # Two plans of the same model differ by the readings between them: little in two samples.
    calls[:] = [None] * 10
    again = fa.simulate(
        arm, 0.3, controller=controller, reference=far, initial=arm.rest(POSTURE), rate=200.0
    )
    assert again.mpc_fallback == 0
    np.testing.assert_allclose(run.torque.values, again.torque.values, rtol=0, atol=0.05)
    assert observed.report() == controller.report()


@pytest.mark.parametrize(("factor", "count"), [(1.0 + 1e-5, "inaccurate"), (1.1, "fallback")])
def test_plans_beyond_a_limit_are_counted(arm, monkeypatch, factor, count):
    controller = fa.MPC(arm, POSTURE, torque_limit=[2.0, 0.7], **WISHES)
    far = fa.joint_motion(arm, [1.0, 1.2], [1.0, 1.2], 1.0)
    run = import_module("flexarm.simulation.calls.run")
    monkeypatch.setattr(run, "stability", lambda *_: Stability("", np.nan))
    solve = mpc_module.least_distance

    # Smaller than the changes that the limits allow: a plan that exceeds them.
    def short(*arguments):
        change, active = solve(*arguments)
        return change / factor, active

    monkeypatch.setattr(mpc_module, "least_distance", short)
    run = fa.simulate(
        arm, 0.1, controller=controller, reference=far, initial=arm.rest(POSTURE), rate=200.0
    )
    assert run.attrs[f"mpc_{count}"] > 0
    assert np.all(np.abs(run.torque.values) <= [2.0, 0.7])


def test_least_distance_equals_that_of_a_general_solver():
    random = np.random.default_rng(3)
    for _ in range(5):
        matrix, inside = random.standard_normal((30, 6)), 3.0 * random.standard_normal(6)
        floor = matrix @ inside - random.uniform(0.0, 1.0, 30)
        wanted = minimize(
            lambda x: x @ x,
            inside,
            jac=lambda x: 2.0 * x,
            method="SLSQP",
            constraints={
                "type": "ineq",
                "fun": lambda x, A=matrix, b=floor: A @ x - b,
                "jac": lambda x, A=matrix: A,
            },
            options={"ftol": 1e-14, "maxiter": 500},
        )
        # Without a guess, from the active rows, from others, and from more than there are numbers.
        active = np.abs(matrix @ wanted.x - floor) < 1e-5
        for guess in (np.zeros(30, dtype=bool), active, np.arange(30) < 3, np.arange(30) < 10):
            found, rows = mpc_module.least_distance(matrix, floor, guess)
            np.testing.assert_allclose(found, wanted.x, rtol=0, atol=1e-6)
            np.testing.assert_array_equal(rows, active)
        assert np.min(matrix @ found - floor) > -1e-10


def test_poles_of_slow_joints_approach_the_two_designs(arm):
    """As epsilon approaches zero the poles are those of the two designs, with proportional
    errors."""
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


def test_smaller_acceptable_bend_gives_more_damping_of_the_links(arm):
    """Bryson's rule: the weight of a reading is the inverse square of its acceptable size."""
    gains = [
        np.linalg.norm(fa.Composite(arm, POSTURE, acceptable={"strain": size}).fast_designs[0].gain)
        for size in (3e-5, 1e-4, 1e-3)
    ]
    assert gains[0] > 1.2 * gains[1] > 1.2 * gains[2]
    # Of a third of the least size, both parts are stable alone, but not together.
    usual, tight = fa.Composite(arm, POSTURE).bandwidth, {"strain": 1e-5}
    with pytest.raises(fa.InputError, match=r"bandwidth must be smaller: the loop with the model"):
        fa.Composite(arm, POSTURE, acceptable=tight, bandwidth=usual)
    slower = fa.Composite(arm, POSTURE, acceptable=tight)
    assert np.all(slower.bandwidth < usual)
    assert fa.loop_margins(slower, arm, POSTURE)["growth"].max() < 0.0


def test_composite_follows_and_damps(arm):
    motion = fa.joint_motion(arm, [0.2, 0.6], POSTURE, 0.6)
    run = fa.simulate(arm, 4.0, controller=fa.Composite(arm, POSTURE), reference=motion, rate=200.0)
    np.testing.assert_allclose(run.joint_angle.values[-1], POSTURE, atol=2e-4)
    bend = np.abs(run.link_tip_deflection.values)
    assert bend[run.time > 3.0].max() < 0.02 * bend.max()
