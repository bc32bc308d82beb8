"""Iterative learning: the lifted model, the laws, and the predicted convergence of trials."""

import numpy as np
import pytest
from learning_arms import SAMPLE_TIME, feedback, one_rigid_link, swing, two_links

import flexarm as fa
from flexarm.planning.learning.bench import AddedTorque, Bench, window_of
from flexarm.planning.learning.iterative import filtered, norm_optimal, proportional_derivative


def bench(arm, motion, controller, interval, output="tip", plant=None, **options):
    """Return trials and the lifted model of one without added torque."""
    window = window_of(arm, motion, controller, None, interval)
    trials = Bench(arm, motion, window, output, plant, None, None, options)
    none = AddedTorque(controller, np.zeros((window.intervals, arm.n_joints)), window.interval)
    return trials, none, trials.model(none)


# The lifted model ---------------------------------------------------------------------------------


def pid(arm, motion):
    return fa.JointPID([20.0, 8.0], [3.0, 0.8], [15.0, 5.0], arm=arm, sample_time=SAMPLE_TIME)


@pytest.mark.parametrize("make", [feedback, pid])
@pytest.mark.parametrize("output", ["tip", "joint_angle"])
def test_lifted_model_is_the_derivative_of_a_trial(make, output):
    """Against differences of whole simulated trials, in three intervals of both joints."""
    arm = two_links()
    motion = swing(arm, duration=0.4)
    trials, none, P = bench(arm, motion, make(arm, motion), 0.02, output)
    size = abs(P).max()
    for interval, joint in ((0, 0), (7, 1), (15, 0)):
        ends = []
        for push in (-0.01, 0.01):
            torque = none.torque.copy()
            torque[interval, joint] += push
            ends.append(trials.errors(AddedTorque(none.inner, torque, none.interval)))
        slope = (ends[0] - ends[1]).ravel() / 0.02
        # The matrices are those in the middle of each sample of 1 ms: an error of second order.
        np.testing.assert_allclose(P[:, 2 * interval + joint], slope, rtol=0, atol=2e-4 * size)


def test_lifted_model_starts_where_the_trials_start():
    """Against differences of trials that start 1.2 rad beside the motion, and moving."""
    arm = two_links()
    motion = swing(arm, duration=0.4)
    rate = np.zeros(arm.dof)
    rate[arm.joint_index] = [0.5, -2.0]
    start = {"initial": arm.rest([0.3, 0.8]), "initial_rate": rate}
    trials, none, P = bench(arm, motion, feedback(arm, motion), 0.02, **start)
    ends = []
    for push in (-0.01, 0.01):
        torque = none.torque.copy()
        torque[3, 0] += push
        ends.append(trials.errors(AddedTorque(none.inner, torque, none.interval)))
    slope = (ends[0] - ends[1]).ravel() / 0.02
    # As above; about the reference, it differs by a tenth of its size.
    np.testing.assert_allclose(P[:, 6], slope, rtol=0, atol=1e-3 * abs(P).max())


def test_start_of_a_plant_with_other_coordinates_is_that_of_the_model():
    arm = two_links()
    motion = swing(arm, duration=0.4)
    angles, rates = [0.3, 0.8], np.array([0.5, -2.0])
    whole = np.zeros(arm.dof)
    whole[arm.joint_index] = rates
    found = [
        bench(
            arm, motion, feedback(arm, motion), 0.02, plant=plant, initial=start, initial_rate=rate
        )[2]
        for plant, start, rate in ((None, arm.rest(angles), whole), (arm.rigid(), angles, rates))
    ]
    np.testing.assert_array_equal(found[0], found[1])


def test_lifted_model_of_a_rigid_link_is_a_double_integrator():
    """One torque h long turns a free link by h^2 / I (k + 1/2), k intervals after its end."""
    arm, interval = one_rigid_link(), 0.02
    motion = fa.joint_motion(arm, [0.0], [0.5], 0.4)
    free = fa.JointPD(0.0, 0.0, sample_time=SAMPLE_TIME)
    _, _, P = bench(arm, motion, free, interval, "joint_angle")
    inertia = float(arm.mass_matrix(np.zeros(1))[0, 0])
    later = np.arange(20)[:, None] - np.arange(20)
    expected = np.where(later >= 0, interval**2 / inertia * (later + 0.5), 0.0)
    np.testing.assert_allclose(P, expected, rtol=1e-10, atol=1e-14)
    # Causal laws have the rate |1 - gain p_1| (Bristow et al. 2006), p_1 the first response.
    law = proportional_derivative(np.ones((20, 1, 1)), np.array([300.0]), np.zeros(1), 0, interval)
    first = interval**2 / (2.0 * inertia)
    found = np.diag(law.contraction(P))
    np.testing.assert_allclose(found, 1.0 - 300.0 * first, rtol=1e-10)


# Laws ---------------------------------------------------------------------------------------------


def test_norm_optimal_law_is_the_solution_of_its_least_squares():
    rng = np.random.default_rng(3)
    P, v, e = rng.normal(size=(12, 8)), rng.normal(size=8), rng.normal(size=12)
    effort, change = 0.02, 0.3
    law = norm_optimal(P, effort, change)
    scale = np.linalg.norm(P, 2)
    # Errors of the next trial, its torques, and their changes, as one least-squares problem.
    rows = np.vstack([P, np.sqrt(effort) * scale * np.eye(8), np.sqrt(change) * scale * np.eye(8)])
    right = np.concatenate([e + P @ v, np.zeros(8), np.sqrt(change) * scale * v])
    expected = np.linalg.lstsq(rows, right, rcond=None)[0]
    np.testing.assert_allclose(law.Q @ v + law.G @ e, expected, rtol=1e-9)
    # The eigenvalues follow from the singular values of P.
    square = np.linalg.svd(P, compute_uv=False) ** 2
    rates = change * square[0] / (square + (effort + change) * square[0])
    found = np.linalg.eigvalsh(law.contraction(P))
    np.testing.assert_allclose(found, np.sort(rates), rtol=1e-9)


def test_filter_has_no_phase_shift_and_the_squared_gain_of_its_order():
    count, interval, cutoff = 200, 0.01, 5.0
    one = proportional_derivative(np.ones((count, 1, 1)), np.ones(1), np.zeros(1), 0, interval)
    Q = filtered(one, 1, cutoff, interval).Q
    np.testing.assert_allclose(Q, Q.T, atol=1e-14)
    np.testing.assert_allclose(Q @ np.ones(count), 1.0, rtol=1e-12)
    assert np.linalg.norm(Q, 2) <= 1.0 + 1e-12
    for hertz, gain in ((2.5, 1 / (1 + 0.5**4)), (5.0, 0.5), (20.0, 1 / (1 + 4.0**4))):
        # A cosine of the transform, about the middles of the intervals.
        wave = np.cos(2 * np.pi * hertz * interval * (np.arange(count) + 0.5))
        np.testing.assert_allclose(Q @ wave, gain * wave, atol=1e-12)


# Trials -------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_learning_with_the_model_converges_at_the_tip_of_another_arm():
    model = two_links()
    motion = swing(model)
    plant = two_links(payload=0.15, rigidity=0.9)
    found = fa.iterative_learning(
        model,
        motion,
        feedback(model, motion),
        duration=1.0,
        interval=0.005,
        effort=1e-4,
        trials=5,
        plant=plant,
    )
    assert found.error_rms[0] > 0.04
    assert found.error_rms[-1] < 0.005 * found.error_rms[0]
    again = fa.simulate(model, 1.0, controller=found.controller, reference=motion, plant=plant)
    missed = again.tip.values - motion.tip(again.time.values)
    assert np.sqrt(np.mean(np.sum(missed**2, axis=1))) == pytest.approx(
        found.error_rms[-1], rel=0.05
    ), "the errors between the ends of the intervals are as large as those at them"


def test_predicted_and_measured_rates_agree_with_the_model():
    """The rate is c / (s + e + c) with the singular values s^2 of the model; here 1/2."""
    arm = two_links()
    motion = swing(arm, size=0.05)
    found = fa.iterative_learning(
        arm,
        motion,
        feedback(arm, motion),
        interval=0.02,
        effort=0.01,
        change=0.01,
        trials=8,
    )
    assert found.predicted_rate == pytest.approx(0.5, abs=0.01)
    assert found.predicted_bound == pytest.approx(found.predicted_rate, rel=1e-6)  # symmetric
    assert np.all(found.rate <= found.predicted_bound * 1.01)
    # Small motions are linear: the model predicts each trial.
    np.testing.assert_allclose(found.error_rms, found.predicted_error_rms, rtol=0.01)


@pytest.mark.thorough
def test_predicted_and_measured_rates_agree_without_a_model():
    arm = two_links()
    motion = swing(arm, size=0.05)
    found = fa.iterative_learning(
        arm,
        motion,
        feedback(arm, motion),
        duration=1.0,
        interval=0.02,
        proportional=[10.0, 4.0],
        derivative=[1.5, 0.4],
        lead=0.1,
        cutoff=2.0,
        trials=30,
    )
    assert 0.6 < found.predicted_rate < 0.7
    assert found.predicted_bound < 0.9
    assert np.all(found.rate <= found.predicted_bound * 1.001)
    # The change of torque has become the eigenvector of the largest eigenvalue.
    assert found.rate[-1] == pytest.approx(found.predicted_rate, rel=0.01)
    np.testing.assert_allclose(found.error_rms, found.predicted_error_rms, rtol=0.03)


def test_predicted_divergence_is_reported_and_happens():
    arm = two_links()
    motion = swing(arm, size=0.05)
    with pytest.warns(fa.UnstableLoopWarning, match="predicted to diverge"):
        found = fa.iterative_learning(
            arm,
            motion,
            feedback(arm, motion),
            interval=0.02,
            proportional=[40.0, 16.0],
            trials=10,
        )
    assert found.predicted_rate > 1.0
    assert found.rate[-1] > 1.0


def test_own_trials_get_the_controller_of_each_trial():
    arm = two_links()
    motion = swing(arm, size=0.05)
    given = {"interval": 0.02, "effort": 1e-3, "trials": 3}

    def trial(controller):
        run = fa.simulate(arm, 0.81, controller=controller, reference=motion, rate=1e3)
        return run.tip.values[20:801:20]

    own = fa.iterative_learning(arm, motion, feedback(arm, motion), trial=trial, **given)
    simulated = fa.iterative_learning(arm, motion, feedback(arm, motion), **given)
    np.testing.assert_allclose(own.torques, simulated.torques, rtol=0, atol=1e-10)
    assert own.result is None
    assert simulated.result is not None


def test_exception_of_an_own_trial_is_reported_as_that_of_the_trial():
    arm = two_links()
    motion = swing(arm, size=0.05)

    def broken(controller):
        raise RuntimeError("the camera\nis off")

    def invalid(controller):
        return fa.simulate(arm, -1.0)

    given = {"interval": 0.02, "trials": 1}
    text = "trial failed with RuntimeError: the camera is off"
    with pytest.raises(fa.InputError, match=text) as caught:
        fa.iterative_learning(arm, motion, feedback(arm, motion), trial=broken, **given)
    assert isinstance(caught.value.__cause__, RuntimeError)
    with pytest.raises(fa.InputError, match="duration must be greater than 0"):
        fa.iterative_learning(arm, motion, feedback(arm, motion), trial=invalid, **given)


def test_trials_without_change_have_no_rate():
    arm = two_links()
    motion = swing(arm, size=0.05)
    given = {"interval": 0.02, "trials": 4, "proportional": 0.0, "cutoff": 2.0}
    with pytest.warns(fa.UnstableLoopWarning):
        found = fa.iterative_learning(arm, motion, feedback(arm, motion), **given)
    assert np.all(found.torques == 0.0)
    assert found.rate.shape == (2,)
    assert np.all(np.isnan(found.rate))


def test_effort_has_no_meaning_without_a_model():
    arm = two_links()
    motion = swing(arm, size=0.05)
    given = {"interval": 0.02, "trials": 2, "proportional": 1.0, "duration": 1.0, "cutoff": 2.0}
    found = [
        fa.iterative_learning(arm, motion, feedback(arm, motion), effort=effort, **given)
        for effort in (0.0, 1e-3)
    ]
    np.testing.assert_array_equal(found[0].torques, found[1].torques)


def test_added_torque_requires_the_joints_of_both_torques():
    arm = two_links()
    three = fa.JointPD([1.0, 2.0, 3.0], 1.0)
    for inner, joints in ((three, 2), (fa.JointPD(1.0, 1.0), 3)):
        with pytest.raises(fa.InputError, match="controller is for 3 joints, but the arm has 2"):
            fa.simulate(arm, 0.1, controller=AddedTorque(inner, np.zeros((4, joints)), 0.02))


def test_instruments_measure_the_errors_with_new_noise_in_each_trial():
    arm = two_links()
    motion = swing(arm, size=0.05)
    read = [fa.Instrument("joint_angle"), fa.Instrument("joint_rate")]
    hardware = fa.Hardware([*read, fa.Instrument("tip", noise=1e-3)])
    # The effort is so large that the torques, and the motion, are the same in all trials.
    given = {"interval": 0.02, "effort": 1e9, "trials": 4}
    exact = fa.iterative_learning(arm, motion, feedback(arm, motion), **given)
    noisy = fa.iterative_learning(arm, motion, feedback(arm, motion), hardware=hardware, **given)
    noise = noisy.errors - exact.errors
    # 80 numbers in each trial: the estimate of a deviation has a deviation of 8 %.
    np.testing.assert_allclose(noise.std(axis=(1, 2)), 1e-3, rtol=0.4)
    assert abs(np.corrcoef(noise.reshape(4, -1)) - np.eye(4)).max() < 0.5


# Arguments ----------------------------------------------------------------------------------------


def test_controllers_without_a_linear_model_are_rejected():
    arm = two_links()
    motion = swing(arm)

    class Own(fa.Controller):
        sample_time = SAMPLE_TIME

        def update(self, t, measurement, reference):
            return np.zeros(2)

    with pytest.raises(fa.InputError, match="controller must have a step"):
        fa.iterative_learning(arm, motion, Own())

    class Looking(fa.Controller):
        sample_time = SAMPLE_TIME

        def step(self, memory, readings, inputs):
            return memory, np.zeros(2)

        def requirements(self, arm, reference):
            return fa.ControllerRequirements(measured=("tip",))

    with pytest.raises(fa.InputError, match="require no readings except"):
        fa.iterative_learning(arm, motion, Looking())
