"""The step of a filter over a sample time, and its derivatives, against differences."""

import numpy as np
import pytest

import flexarm as fa
from arms import chain
from flexarm.linear.step_derivatives.sampled_step import SampledStep

SAMPLE_TIME, TORQUE = 0.01, np.array([1.5, -0.8])


def arm_with(payload=0.3):
    rod = {"flexural_rigidity": 40.0, "mass_per_length": 0.5, "elements": 1, "modes": 1}
    joints = [{"hub_inertia": 0.05, "damping": 0.1}, {"mass": 0.2, "hub_inertia": 0.02}]
    payload = fa.Payload(mass=payload, inertia=0.01)
    return chain((1.0, 0.7), joints, payload=payload, gravity=(0.0, -9.81), **rod)


@pytest.fixture(scope="module")
def step():
    return SampledStep(arm_with(), SAMPLE_TIME)


X = np.array([0.4, 0.003, -0.8, 0.001, 1.2, 0.02, -0.7, -0.01])


def test_step_equals_the_motion_over_a_sample_time(step):
    after = step.take(X, TORQUE).after
    q, qd = X.reshape(2, -1)
    run = fa.simulate(
        step.arm,
        SAMPLE_TIME,
        initial=q,
        initial_rate=qd,
        torque=lambda t: TORQUE,
        rtol=1e-11,
        atol=1e-13,
    )
    exact = np.concatenate([run.q.values[-1], run.qd.values[-1]])
    # Steps of a fifth of a radian of the fastest mode: 0.2^4 / 120 of its phase.
    np.testing.assert_allclose(after, exact, rtol=0, atol=1e-4 * abs(exact - X).max())
    assert step.steps > 1


def test_derivatives_by_state_and_torque_equal_differences(step):
    found = step.take(X, TORQUE)
    for k in range(8):
        small = 1e-5 * np.eye(8)[k]
        slope = (step.take(X + small, TORQUE).after - step.take(X - small, TORQUE).after) / 2e-5
        np.testing.assert_allclose(found.state[:, k], slope, rtol=0, atol=1e-6 * abs(slope).max())
    for k in range(2):
        more, less = (step.take(X, TORQUE + s * np.eye(2)[k]).after for s in (1e-3, -1e-3))
        slope = (more - less) / 2e-3
        np.testing.assert_allclose(found.torque[:, k], slope, rtol=0, atol=1e-6 * abs(slope).max())


def test_derivative_by_the_payload_equals_differences_of_arms(step):
    found, size = step.take(X, TORQUE).parameters[:, 0], 1e-4
    heavy, light = (step.take(X, TORQUE, np.array([s])).after for s in (size, -size))
    np.testing.assert_allclose(found, (heavy - light) / (2 * size), rtol=0, atol=1e-6)
    assert abs(found).max() > 1e-3
    other = SampledStep(arm_with(0.3 + size), SAMPLE_TIME)
    other.steps, other._h = step.steps, step._h  # its fastest mode differs slightly
    np.testing.assert_allclose(heavy, other.take(X, TORQUE).after, rtol=0, atol=1e-9)
