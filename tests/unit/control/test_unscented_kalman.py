"""Sigma points of the unscented Kalman filter, and its evaluations of arm and readings."""

import numpy as np
import pytest
from scipy.stats import chi2

import flexarm as fa
from flexarm.control.filters.kalman_filter import _covariance, _mean, _sigma_points
from flexarm.control.filters.predicted_readings import PredictedReadings
from flexarm.linear.step_derivatives.sampled_step import SampledStep


def gaussian(seed, size=4, joints=2):
    """Return a mean, a covariance of very different variances, and one with torque errors."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(size + joints, size + joints))
    scale = np.append(10.0 ** np.arange(0, -2 * size, -2), np.ones(joints))
    root = np.linalg.qr(root)[0] * (0.5 + random.random(size + joints))
    whole = root @ root.T
    # The errors of the torque are independent and have unit variance.
    change = np.eye(size + joints)
    change[size:, size:] = np.linalg.inv(np.linalg.cholesky(whole[size:, size:]))
    whole = change @ whole @ change.T
    whole = scale[:, None] * whole * scale
    return random.normal(size=size) * scale[:size], whole[:size, :size], whole[:size, size:]


def test_sigma_points_have_the_mean_and_covariance():
    x, P, N = gaussian(3)
    points = _sigma_points(x, P, N)
    size = np.sqrt(np.diag(P))
    np.testing.assert_allclose(_mean(points)[:4] / size, x / size, rtol=0, atol=1e-12)
    np.testing.assert_allclose(_mean(points)[4:], 0.0, atol=1e-12)
    found = _covariance(points, points)
    np.testing.assert_allclose(
        found[:4, :4] / np.outer(size, size), P / np.outer(size, size), atol=1e-12
    )
    np.testing.assert_allclose(found[:4, 4:] / size[:, None], N / size[:, None], atol=1e-12)
    np.testing.assert_allclose(found[4:, 4:], np.eye(2), atol=1e-12)


def test_certain_states_have_no_distance_from_the_mean():
    P = np.diag([1e-8, 0.0, 4.0])
    points = _sigma_points(np.array([1.0, 2.0, 3.0]), P, np.zeros((3, 1)))
    np.testing.assert_array_equal(points[:, 1], 2.0)
    np.testing.assert_allclose(_covariance(points, points)[:3, :3], P, atol=1e-15)


def test_mean_of_quadratic_functions_is_exact():
    """A linearisation omits the second term of E(y^T A y) = m^T A m + trace(A P)."""
    x, P, N = gaussian(8)
    points = _sigma_points(x, P, N)[:, :4]
    A = np.random.default_rng(9).normal(size=(4, 4))
    values = np.einsum("ki,ij,kj->k", points, A, points)
    expected = x @ A @ x + np.trace(A @ P)
    assert float(_mean(values[:, None])[0]) == pytest.approx(expected, rel=1e-12)


@pytest.mark.sampled("0.0-ExtendedKalmanFilter")
@pytest.mark.parametrize("kind", [fa.ExtendedKalmanFilter, fa.UnscentedKalmanFilter])
@pytest.mark.parametrize("unknown", [0.0, 0.05])
def test_estimates_of_a_record_have_their_chi_squared_tests(kind, unknown):
    link = fa.Link(length=1.0, flexural_rigidity=40.0, mass_per_length=0.4, elements=1, modes=1)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.05)], payload=fa.Payload(mass=0.2))
    instruments = [fa.Instrument("joint_angle", noise=2e-4)]
    hardware = fa.Hardware([*instruments, fa.Instrument("joint_rate")], seed=3)
    pd = fa.JointPD(20.0, 3.0)
    run = fa.simulate(arm, 0.2, controller=pd, hardware=hardware, initial=arm.rest([0.3]))
    filters = kind(
        arm,
        instruments,
        torque_noise=0.02,
        payload_deviation=unknown,
        rate_deviation=0.01,
        energy_deviation=1e-4,
    )
    found = filters.run(
        run.torque_command.values[:-1], {"joint_angle": run.measured_joint_angle.values}
    )
    true = run.q.values[:-1], run.qd.values[:-1]
    squared = found.squared_errors(*true, 0.2)
    states = 4 + (unknown > 0.0)
    error = np.concatenate([true[0][50] - found.q[50], true[1][50] - found.qd[50]])
    error = np.append(error, 0.2 - found.payload_mass[50])[:states]
    P = found.covariance[50][:states, :states]
    assert squared[50] == pytest.approx(error @ np.linalg.inv(P) @ error / states, rel=1e-6)
    np.testing.assert_allclose(found.error_band(), chi2.ppf([0.025, 0.975], states) / states)
    low, high = found.innovation_band(0.9)
    np.testing.assert_allclose(np.array([low, high]).T, [chi2.ppf([0.05, 0.95], 1)] * len(low))
    # 90 % of 200 independent samples, with a deviation of 2 %.
    inside = np.mean((found.innovation > low) & (found.innovation < high))
    assert inside == pytest.approx(0.9, abs=0.07)
    with pytest.raises(fa.InputError, match="probability must be within 0 and 1"):
        found.error_band(1.0)
    with pytest.raises(fa.InputError, match="q must be"):
        found.squared_errors(true[0][1:], true[1], 0.2)


def test_both_filters_agree_on_an_arm_that_hardly_moves():
    """With an accelerometer, which measures the torque error that has just moved the arm."""
    link = fa.Link(length=1.0, flexural_rigidity=40.0, mass_per_length=0.4, elements=1, modes=1)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.05)], payload=fa.Payload(mass=0.2))
    sensor = fa.Sensor("acceleration", link=1, frame="link", name="accelerometer")
    instruments = [
        fa.Instrument("joint_angle", noise=1e-7),
        fa.Instrument(sensor, name="accelerometer", noise=1e-4),
    ]
    small = {"torque_noise": 1e-4, "rate_deviation": 1e-5, "energy_deviation": 1e-12}
    readings = {"joint_angle": np.zeros((30, 1)), "accelerometer": np.zeros((30, 2))}
    found = [
        kind(arm, instruments, **small).run(np.zeros((30, 1)), readings).covariance[-1][:4, :4]
        for kind in (fa.ExtendedKalmanFilter, fa.UnscentedKalmanFilter)
    ]
    size = np.sqrt(np.diag(found[0]))
    # Products of deviations of 1e-5 are the difference of the filters.
    np.testing.assert_allclose(*(P / np.outer(size, size) for P in found), rtol=0, atol=1e-3)


def test_steps_and_readings_without_derivatives_are_the_same():
    links = [fa.Link(length=0.7, flexural_rigidity=50.0, mass_per_length=0.5, elements=1)] * 2
    arm = fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.1)] * 2, gravity=(0.0, -9.81))
    sensor = fa.Sensor("acceleration", link=2, frame="link")
    readings = PredictedReadings(
        arm, [fa.Instrument("joint_angle", noise=1e-4), fa.Instrument(sensor, noise=0.1)]
    )
    random = np.random.default_rng(4)
    x, torque = 0.05 * random.normal(size=2 * arm.dof), np.array([0.5, -0.3])
    step, more = SampledStep(arm, 1e-3), np.array([0.2])
    np.testing.assert_array_equal(step.advance(x, torque, more), step.take(x, torque, more).after)
    constants = step.free.at(more)
    found, expected = (one(x, torque, constants) for one in (readings.values, readings.predict))
    np.testing.assert_array_equal(found, expected.values)
