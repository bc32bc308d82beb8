"""Nonlinear MPC against IPOPT, against linear control for small motions, and at its limits."""

import casadi
import numpy as np
import pytest
from linear_arm import POSTURE, arm_with_gauges

import flexarm as fa
from arms import table_one_arm
from flexarm.control.hardware.sampled_plant import held
from flexarm.control.laws.mpc import with_modes
from flexarm.linear.step_derivatives import sampled_step
from flexarm.linear.step_derivatives.sampled_step import SampledSteps, Steps


@pytest.fixture(scope="module")
def arm():
    return arm_with_gauges(gravity=(0.0, -9.81))


@pytest.fixture(scope="module")
def few(arm):
    """One mode for each link."""
    return with_modes(arm, 1)


def chained(few, x, torques, step, steps):
    """Return the states after samples of ``steps`` steps of rk4, and their whole derivatives."""
    found, state, by = [], np.eye(8), np.zeros((8, 2))
    for torque in torques:
        for _ in range(steps):
            one = fa.step_jacobian(few, x[:4], x[4:], torque, step)
            state, by = one.state @ state, one.state @ by + one.torque
            x = np.concatenate([one.q, one.qd])
        found.append(x)
    return np.array(found), state, by


def test_prediction_takes_single_steps(few):
    torques = np.random.default_rng(4).uniform(-2.0, 2.0, (3, 2))
    model = SampledSteps(few, 0.03, 5)
    x = np.concatenate([few.rest(POSTURE), [1.0, -2.0, 0.05, 0.03]])
    assert model.steps > 1
    wanted, *_ = chained(few, x, torques, 0.03 / model.steps, model.steps)
    # Rounding of sums in another order.
    np.testing.assert_allclose(model.take(x, torques).after, wanted, rtol=1e-11, atol=1e-12)


def test_derivatives_of_the_prediction_are_of_second_order(few):
    """Ten directions in two blocks; ``step_jacobian`` perturbs by complex numbers."""
    x = np.concatenate([fa.equilibrium(few, POSTURE).q, [2.0, -3.0, 0.0, 0.0]])
    torque, errors = np.array([9.0, -4.0]), []
    _, state, by = chained(few, x, [torque], 1e-4, 400)
    for samples in (8, 16, 32):
        found = SampledSteps(few, 0.04 / samples, samples).take(x, np.tile(torque, (samples, 1)))
        whole, pushed = np.eye(8), np.zeros((8, 2))
        for A, B in zip(found.state, found.torque, strict=True):
            whole, pushed = A @ whole, A @ pushed + B
        pairs = (whole, state), (pushed, by)
        errors.append([abs(one - two).max() / abs(two).max() for one, two in pairs])
    assert np.all(np.array(errors[0]) < 0.02)
    ratios = np.array(errors[:-1]) / errors[1:]
    np.testing.assert_allclose(ratios, 4.0, rtol=0.3)


def test_derivatives_at_rest_are_those_of_the_linear_model(arm):
    """Every matrix of a horizon at rest, of an odd number of samples, by SciPy's exponential."""
    rest = fa.equilibrium(arm, POSTURE)
    x, torques = np.append(rest.q, np.zeros(arm.dof)), np.tile(rest.torque, (5, 1))
    found = SampledSteps(arm, 0.01, 5).take(x, torques)
    A, B = held(*(getattr(fa.linearize(arm, rest), name) for name in "AB"), 0.01)
    for k in range(5):
        # The Taylor polynomial, whose relative error of 1.5e-6 is doubled each time.
        np.testing.assert_allclose(found.state[k], A, rtol=0, atol=1e-5 * abs(A).max())
        np.testing.assert_allclose(found.torque[k], B, rtol=0, atol=1e-5 * abs(B).max())


def torques_of(few, law, start, motion=None):
    run = {"reference": motion, "rate": 100.0, "initial": start}
    found = fa.simulate(few, 0.8, controller=law, **run)
    assert found.attrs.get("mpc_limited", 0) == 0
    return found.torque.values


@pytest.mark.thorough
def test_small_deviations_are_controlled_as_by_the_regulator(few, monkeypatch):
    """Vibration of 0.1 mm about rest: the rest is the error of the steps."""
    how = {"sample_time": 0.01, "integral": True}
    regulator, start = fa.LQG(few, POSTURE, **how), fa.equilibrium(few, POSTURE).q.copy()
    start[~np.isin(np.arange(4), few.joint_index)] += 1e-4
    hold = fa.joint_motion(few, POSTURE, POSTURE, 1.0)
    wanted = torques_of(few, regulator, start, hold)
    moved = np.abs(wanted - wanted[-1]).max()
    for reach, error in ((1.0, 0.1), (0.25, 2e-3)):
        monkeypatch.setattr(sampled_step, "_REACH", reach)
        law = fa.NonlinearMPC(few, POSTURE, torque_limit=100.0, **how)
        found = torques_of(few, law, start, hold)
        assert np.abs(found - wanted).max() < error * moved
    margins = [fa.loop_margins(one).disk_margin.values for one in (law.at_rest(), regulator)]
    np.testing.assert_array_equal(*margins)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:the tip rests:flexarm.AccuracyWarning")  # rigid angles
def test_small_motions_are_followed_as_by_the_regulator(few):
    """`LQG` neglects changes of the nominal torque within a sample, of first order in its time."""
    motion = fa.joint_motion(few, POSTURE, np.add(POSTURE, 1e-3), 0.4, start_time=0.1)
    start, errors = fa.equilibrium(few, POSTURE).q, []
    for sample_time in (0.01, 0.005):
        regulator = fa.LQG(few, POSTURE, sample_time=sample_time, preview=0.3)
        law = fa.NonlinearMPC(
            few,
            POSTURE,
            torque_limit=100.0,
            sample_time=sample_time,
            preview=0.3 - 20 * sample_time,
        )
        wanted = torques_of(few, regulator, start, motion)
        away = torques_of(few, law, start, motion) - wanted
        errors.append(np.abs(away).max() / np.abs(wanted - wanted[0]).max())
    assert errors[0] < 0.2
    assert errors[1] < 0.6 * errors[0]


def horizon_by_ipopt(few, law, start, wanted, torques):
    """Return the optimal torques (horizon, joints): multiple shooting with the same steps."""
    dynamics, design = fa.to_casadi(few).forward_dynamics, law.designs[0]
    N, n, limit = law.horizon, 2 * few.dof, law.torque_limit
    steps = law._model_steps.steps
    h = law.sample_time / steps

    def rate(x, u):
        q, qd = x[: few.dof], x[few.dof :]
        return casadi.vertcat(qd, dynamics(q, qd, u, 0, []))

    x, u = casadi.SX.sym("x", n), casadi.SX.sym("u", few.n_joints)
    after = x
    for _ in range(steps):
        k1 = rate(after, u)
        k2 = rate(after + h / 2 * k1, u)
        k3 = rate(after + h / 2 * k2, u)
        k4 = rate(after + h * k3, u)
        after = after + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    step = casadi.Function("step", [x, u], [after])
    problem = casadi.Opti()
    X, U = problem.variable(n, N + 1), problem.variable(few.n_joints, N)
    cost = 0
    for k in range(N):
        away, push = X[:, k] - wanted[k], U[:, k] - torques[k]
        cost += away.T @ design.weight @ away + push.T @ design.torque_weight @ push
        problem.subject_to(X[:, k + 1] == step(X[:, k], U[:, k]))
    away = X[:, N] - wanted[N]
    problem.minimize(1e-3 * (cost + away.T @ design.cost @ away))
    problem.subject_to(X[:, 0] == start)
    for joint in range(few.n_joints):
        problem.subject_to(problem.bounded(-limit[joint], U[joint, :], limit[joint]))
    problem.set_initial(X, np.tile(start[:, None], N + 1))
    options = {"print_level": 0, "sb": "yes", "tol": 1e-10, "bound_relax_factor": 0.0}
    problem.solver("ipopt", {"print_time": False}, options)
    return problem.solve().value(U).T


def with_exact_derivatives(few, model):
    """Return ``take`` of a model with the derivatives of its own steps."""

    def take(x, torques):
        found = []
        for torque in torques:
            (x,), *by = chained(few, x, [torque], model._h, model.steps)
            found.append((x, *by))
        return Steps(*map(np.array, zip(*found, strict=True)))

    return take


def test_converged_iterations_solve_the_nonlinear_problem(arm, few):
    """From a posture 0.5 rad away, with limits active."""
    limit = np.array([7.0, 2.5])
    goal = fa.joint_motion(arm, POSTURE, POSTURE, 1.0)
    reading = fa.Measurement(
        joint_angle=np.add(POSTURE, [0.5, -0.4]), joint_rate=np.zeros(2), strain=np.zeros(2)
    )
    plans = []
    for iterations, exact in ((1, False), (20, False), (20, True)):
        law = fa.NonlinearMPC(
            arm,
            POSTURE,
            torque_limit=limit,
            acceptable={"joint_angle": 0.1, "tip": 0.1, "joint_rate": 0.5},
            sample_time=0.02,
            horizon=12,
            preview=0.0,
            modes=1,
            iterations=iterations,
        )
        law.reset()
        if exact:
            law._model_steps.take = with_exact_derivatives(few, law._model_steps)
        torque = law.update(0.0, reading, goal)
        plans.append(law.memory["plan"].reshape(12, 2))
        np.testing.assert_allclose(torque, plans[-1][0], rtol=1e-14)  # cut at the limits
    wanted, torques = law._motion.states(13), law._motion.torques(12)
    best = horizon_by_ipopt(few, law, wanted[0] + law.estimate, wanted, torques)
    assert np.any(np.abs(best) > 0.999 * limit)
    assert np.any(np.abs(best) < 0.9 * limit)
    # The tolerance of IPOPT.
    np.testing.assert_allclose(plans[2], best, rtol=0, atol=1e-5)
    # Linear motion within samples of 20 ms, in which the torque changes from limit to limit.
    errors = [np.abs(plan - best).max(axis=0) / limit for plan in plans]
    assert np.all(errors[1] < 0.01)
    assert np.all(errors[1] < 0.5 * errors[0])


def settled(arm, law):
    """Simulate a motion that requires more than the limits allow, and return the run."""
    fast = fa.joint_motion(arm, [0.0, 1.4], [0.8, 0.4], 0.4, start_time=0.1)
    return fa.simulate(arm, 2.5, controller=law, reference=fast, rate=200.0)


@pytest.mark.thorough
def test_limits_hold_and_vibration_is_less_than_with_cut_torques():
    arm = arm_with_gauges()
    limit, rate = np.array([3.0, 0.8]), np.array([200.0, 80.0])
    how = {"torque_limit": limit, "sample_time": 0.01}
    run = settled(arm, fa.NonlinearMPC(arm, POSTURE, torque_rate=rate, **how))
    torque = run.torque.values
    assert np.all(np.abs(torque) <= limit)
    assert np.any(np.abs(torque) == limit)
    steps = np.abs(np.diff(torque[:-1], axis=0))
    assert np.all(steps <= 0.01 * rate * (1.0 + 1e-12))
    assert np.any(steps > 0.01 * rate * (1.0 - 1e-9))
    assert run.mpc_limited > 10
    assert run.mpc_inaccurate == run.mpc_fallback == 0
    np.testing.assert_allclose(run.joint_angle.values[-1], [0.8, 0.4], atol=2e-3)
    cut = settled(arm, fa.LQG(arm, POSTURE, **how))
    late = slice(1.2, None)
    swings = [
        np.ptp(one.link_tip_deflection.sel(time=late).values, axis=0).max() for one in (run, cut)
    ]
    assert swings[0] < 0.5 * swings[1]


def test_feedback_and_preparation_are_an_update(arm):
    how = {"torque_limit": [14.0, 4.0], "horizon": 6}
    first, second = (fa.NonlinearMPC(arm, POSTURE, **how) for _ in range(2))
    goal = fa.joint_motion(arm, POSTURE, np.add(POSTURE, 0.1), 0.1)
    for law in (first, second):
        law.reset()
    for k in range(4):
        reading = fa.Measurement(
            joint_angle=np.add(POSTURE, 1e-3 * k), joint_rate=np.zeros(2), strain=np.zeros(2)
        )
        found = second.feedback(0.01 * k, reading, goal)
        if k != 2:  # a forgotten preparation is made up for
            second.prepare()
            second.prepare()
        np.testing.assert_array_equal(first.update(0.01 * k, reading, goal), found)


@pytest.mark.parametrize("iterations", [1, 2])
def test_plan_continues_if_the_prediction_overflows(arm, iterations, monkeypatch):
    """An encoder jumps by a turn, which the estimator takes for rates that coarse steps do not
    survive."""
    monkeypatch.setattr(sampled_step, "_REACH", 2.0)
    law = fa.NonlinearMPC(arm, POSTURE, torque_limit=1.0, horizon=8, iterations=iterations)
    hold, overflows = fa.joint_motion(arm, POSTURE, POSTURE, 1.0), 0
    law.reset()
    for k in range(8):
        overflowed, last = law._ready is None and k > 0, law._plans["plan"]
        angle = np.add(POSTURE, [2.0 * np.pi * (k >= 3), 0.0])
        reading = fa.Measurement(joint_angle=angle, joint_rate=np.zeros(2), strain=np.zeros(2))
        assert np.all(np.abs(law.update(law.sample_time * k, reading, hold)) <= 1.0)
        if overflowed:
            overflows += 1
            # The estimate starts again at the readings; its rates were thousands of rad/s.
            assert np.abs(law.estimate).max() < 7.0
        if overflowed and iterations == 1:
            np.testing.assert_array_equal(law._plans["plan"], np.append(last[2:], last[-2:]))
    assert overflows == 1
    # The second iteration predicts one sample earlier, and plans from the new estimate.
    assert law.fallback == 1


def test_recorded_run_is_followed():
    few = with_modes(arm_with_gauges(), 1)
    motion = fa.joint_motion(few, POSTURE, [0.6, 0.6], 0.5)
    planned = fa.simulate(few, 0.8, torque=fa.rigid_torque(few, motion), initial=few.rest(POSTURE))
    law = fa.NonlinearMPC(few, [0.5, 0.75], nominal=planned, torque_limit=20.0, sample_time=0.005)
    run = fa.simulate(few, 0.7, controller=law, reference=motion)  # and 0.1 s of horizon
    # Torques are constant over 5 ms instead of smooth.
    wanted = planned.tip.sel(time=run.time).values
    np.testing.assert_allclose(run.tip.values, wanted, rtol=0, atol=2e-4)


@pytest.mark.thorough
def test_defaults_hold_an_arm_without_damping():
    """The model has the modes of the arm: with two for each link, this loop is unstable."""
    plain = table_one_arm()
    gauges = [fa.Gauge(station=0.0, distance=0.005)]
    arm = fa.Arm(links=[link.replace(gauges=gauges) for link in plain.spec.links])
    posture = np.array([1.11, -0.785])
    law = fa.NonlinearMPC(arm, posture, torque_limit=500.0)
    hold = fa.joint_motion(arm, posture, posture, 0.5)
    run = fa.simulate(
        arm, 1.5, controller=law, reference=hold, initial=arm.rest(posture - 0.02), rate=100.0
    )
    assert np.abs(run.joint_angle.values[120:] - posture).max() < 5e-4


def test_model_has_few_modes(arm):
    law = fa.NonlinearMPC(arm, POSTURE, torque_limit=5.0, modes=1)
    assert law.arm.dof == 4
    assert len(law.designs[0].A) == 8
    assert fa.NonlinearMPC(arm, POSTURE, torque_limit=5.0, modes=9).arm is arm
    rod = {"length": 1.0, "flexural_rigidity": 9.0, "mass_per_length": 0.4}
    ratios = fa.ModalDamping(ratio=(0.01, 0.02, 0.03))
    links = [fa.Link(**rod, damping=ratios), fa.Link(**rod, flexible=False)]
    other = with_modes(fa.Arm(links=links), 2)
    assert other.spec.links[0].damping.ratio == (0.01, 0.02)
    assert other.spec.links[1] is links[1]
