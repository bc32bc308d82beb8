"""Readings, masses and torques that are impossible for the extended Kalman filter."""

import numpy as np
import pytest
from linear_arm import arm_with_gauges as two_links

import flexarm as fa
from flexarm.control.hardware.measurement import Measurement

ENCODER = fa.Instrument("joint_angle", noise=2e-4)


@pytest.mark.parametrize("reading", [np.nan, np.inf, 1e200])
def test_impossible_readings_are_rejected(reading):
    arm = two_links()
    filters = fa.ExtendedKalmanFilter(arm, [ENCODER], payload_deviation=0.1)
    for _ in range(2):  # the first reading and a later one
        with pytest.raises(fa.InputError, match=r"ExtendedKalmanFilter\.correct: "):
            filters.correct(Measurement(joint_angle=np.array([0.1, reading])))
        filters.correct(Measurement(joint_angle=np.array([0.1, 0.2])))
    assert np.all(np.isfinite(filters.q))
    with pytest.raises(fa.InputError, match="have 2 readings of joint_angle, got 3"):
        filters.correct(Measurement(joint_angle=np.zeros(3)))
    record = np.tile([0.1, reading], (3, 1))
    with pytest.raises(fa.InputError):
        filters.run(np.zeros((3, 2)), {"joint_angle": record})


def test_huge_initial_values_are_rejected():
    arm = two_links()
    filters = fa.ExtendedKalmanFilter(arm, [ENCODER], payload_deviation=0.1)
    still, P = np.zeros(arm.dof), np.eye(2 * arm.dof + 1)
    for mass, covariance, name in ((1e300, P, "payload_mass"), (0.1, 1e300 * P, "covariance")):
        with pytest.raises(fa.InputError, match=f"{name} must be at most 1e\\+09"):
            filters.begin(still, still, mass, covariance)


def test_diverging_estimate_is_reported():
    arm = two_links()
    filters = fa.ExtendedKalmanFilter(arm, [ENCODER])
    filters.correct(Measurement(joint_angle=np.array([0.1, 0.2])))
    with np.errstate(all="ignore"):
        filters.predict([1e250, -1e250])
    with pytest.raises(fa.InputError, match="the estimate is not finite"):
        filters.correct(Measurement(joint_angle=np.array([0.1, 0.2])))
