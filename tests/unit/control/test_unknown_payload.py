"""The distribution of an unknown payload in Kalman filters, by Bayes' theorem."""

import numpy as np
import pytest
from scipy.stats import lognorm, norm

import flexarm as fa
from arms import observed_link
from flexarm.control.hardware.measurement import Measurement

ENCODER = fa.Instrument("joint_angle", noise=2e-4)
STRAIN = fa.Instrument("strain", noise=3e-6)


def test_a_reading_changes_the_weights_as_bayes_theorem_says():
    arm = observed_link()
    filters = fa.ExtendedKalmanFilter(arm, [ENCODER, STRAIN])
    deflection = np.array([[[0.0, 1.0]], [[0.0, 0.0]]])
    strain = arm.strains(deflection[None])[0, 0]
    # The deflection is proportional to the deviation of the mass, and otherwise nearly known.
    by_mass, deviation, missed = 30.0 * STRAIN.noise / strain, 0.1, 4.5 * STRAIN.noise
    slope = np.array([0.0, by_mass, 0.0, 0.0, 1.0])
    filters.begin(
        np.zeros(2), np.zeros(2), 0.2, deviation**2 * np.outer(slope, slope) + 1e-16 * np.eye(5)
    )
    filters.correct(Measurement(joint_angle=np.zeros(1), strain=np.array([missed])))

    # The mass that moves with the tip, of the payload, the hub and the rod, is lognormal.
    own = 0.05 + 0.4 / 3.0
    mass = np.linspace(1e-4, 2.0, 20_001)
    spread = np.log1p(deviation**2 / (0.2 + own) ** 2)
    prior = lognorm.pdf(mass, np.sqrt(spread), scale=(0.2 + own) * np.exp(-0.5 * spread))
    readings = strain * by_mass * (mass - own - 0.2)
    weights = prior * norm.pdf(missed, readings, STRAIN.noise)
    mean = np.average(mass, weights=weights)
    # The Gaussians end at 2.5 deviations: a fiftieth of the deviation after the reading.
    found = np.sqrt(np.average((mass - mean) ** 2, weights=weights))
    assert filters.payload_mass == pytest.approx(mean - own, abs=0.02 * found)
    assert np.sqrt(filters.covariance[-1, -1]) == pytest.approx(found, rel=0.03)


def test_variance_of_the_payload_grows_by_its_drift():
    """A random walk: its variance is the square of the drift times the time."""
    found = {}
    for drift in (0.0, 0.05):
        filters = fa.ExtendedKalmanFilter(observed_link(), [ENCODER], payload_drift=drift)
        filters.begin(np.zeros(2), np.zeros(2), 0.2, np.diag([1e-8, 1e-8, 1e-6, 1e-6, 1e-4]))
        for _ in range(10):
            filters.predict(np.zeros(1))
        found[drift] = filters.covariance[-1, -1]
    # The logarithm of the mass walks: the difference is the relative variance, 0.1 % to 1 %.
    assert found[0.05] - found[0.0] == pytest.approx(0.05**2 * 0.01, rel=1e-2)
