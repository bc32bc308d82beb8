"""The tip of a rigid chain, its Jacobian and the rate of that."""

import numpy as np
from motion_checks import derivative

from flexarm.motion.geometry.inverse_kinematics import tip_jacobian, tip_jacobian_rate, tip_position

LENGTHS = np.array([0.9, 0.4, 1.3, 0.2])
ANGLES = np.array([0.3, -1.1, 0.7, 2.0])
RATES = np.array([1.5, -0.6, 0.4, -2.0])


def test_relative_angles_are_added():
    quarter = np.pi / 2
    tip = tip_position(np.array([2.0, 1.0, 0.5]), np.array([quarter, -quarter, -quarter]))
    np.testing.assert_allclose(tip, [1.0, 2.0 - 0.5], rtol=0, atol=1e-15)


def test_jacobian_by_finite_differences():
    columns = [
        derivative(lambda x, e=unit: tip_position(LENGTHS, ANGLES + x * e), np.array([0.0]), 1e-2)
        for unit in np.eye(4)
    ]
    # Sixth order with step 0.01 on sines: 1e-12 / 140, and rounding of 1e-16 / 0.01.
    np.testing.assert_allclose(
        np.stack(columns, axis=-1), tip_jacobian(LENGTHS, ANGLES), rtol=0, atol=1e-12
    )


def test_jacobian_rate_by_finite_differences():
    def jacobian(t):
        return tip_jacobian(LENGTHS, ANGLES + t * RATES)

    rate = tip_jacobian_rate(LENGTHS, ANGLES, RATES)
    np.testing.assert_allclose(
        derivative(jacobian, np.array([0.0]), 1e-2), rate, rtol=0, atol=1e-10
    )


def test_batch_equals_its_members():
    batch = np.random.default_rng(1).normal(size=(3, 5, 4))
    rates = batch[::-1]
    for at in np.ndindex(3, 5):
        for whole, one in [
            (tip_position(LENGTHS, batch), tip_position(LENGTHS, batch[at])),
            (tip_jacobian(LENGTHS, batch), tip_jacobian(LENGTHS, batch[at])),
            (
                tip_jacobian_rate(LENGTHS, batch, rates),
                tip_jacobian_rate(LENGTHS, batch[at], rates[at]),
            ),
        ]:
            np.testing.assert_allclose(whole[at], one, rtol=0, atol=1e-15)
