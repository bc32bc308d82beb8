"""Statistics of a fit on samples whose distribution is known."""

import numpy as np
import pytest

from flexarm.identification.space import in_words
from flexarm.identification.statistics import (
    Column,
    covariance_of,
    fit_percent,
    independence,
    undetermined,
    whiteness,
)

COUNT = 600


def white(seed):
    return np.random.default_rng(seed).standard_normal(COUNT)


def coloured(seed, memory=0.8):
    from scipy.signal import lfilter

    return lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], white(seed))


def test_fit_percent():
    values = np.array([1.0, 2.0, 3.0, 4.0])
    assert fit_percent(values, values) == 100.0
    assert fit_percent(values, np.full(4, 2.5)) == pytest.approx(0.0)


def test_tests_reject_white_residuals_as_often_as_they_state():
    signal = np.random.default_rng(99).standard_normal(COUNT)
    found = np.array([(whiteness(white(k)), independence(white(k), signal)) for k in range(300)])
    # 5 % of 300, plus or minus four standard deviations.
    rejected = (found < 0.05).sum(axis=0)
    assert np.all(np.abs(rejected - 15) < 4 * np.sqrt(300 * 0.05 * 0.95))


def test_tests_reject_residuals_with_structure():
    signal = np.random.default_rng(99).standard_normal(COUNT)
    assert whiteness(coloured(1)) < 1e-6
    late = 0.3 * np.concatenate([np.zeros(7), signal[:-7]])
    assert independence(white(1) + late, signal) < 1e-6
    assert whiteness(white(1)) > 0.01


def regression(noise):
    """Estimate two numbers from one channel; return errors and their stated deviations."""
    times = np.arange(COUNT) / COUNT
    inputs = np.stack([np.sin(12 * times), times], axis=1)
    estimate, *_ = np.linalg.lstsq(inputs, noise, rcond=None)
    residuals = noise - inputs @ estimate
    spread = residuals.std()
    column = Column(residuals / spread, -inputs / spread)
    return estimate, np.sqrt(np.diag(covariance_of([column], np.zeros(2))))


@pytest.mark.parametrize(("source", "low", "high"), [(white, 0.85, 1.15), (coloured, 0.8, 1.2)])
def test_stated_deviations_are_those_of_many_repetitions(source, low, high):
    found = [regression(source(seed)) for seed in range(200)]
    errors = np.array([one[0] for one in found])
    stated = np.array([one[1] for one in found])
    ratio = np.sqrt(np.mean(stated**2, axis=0)) / errors.std(axis=0)
    # The deviation of 200 repetitions is known to 5 %. That of correlated residuals is estimated
    # too low, because the fit removes their slowest part.
    assert np.all((ratio > low) & (ratio < high)), ratio


def test_priors_count_as_measurements():
    column = Column(white(1), np.ones((COUNT, 1)))
    (alone,) = np.diag(covariance_of([column], np.zeros(1)))
    (both,) = np.diag(covariance_of([column], np.array([1.0 / alone])))
    assert both == pytest.approx(alone / 2, rel=0.3)  # the residuals are correlated by chance


def test_undetermined_combinations_are_found_behind_initial_states():
    random = np.random.default_rng(4)
    rows = random.standard_normal((COUNT, 5))
    rows[:, 1] = 2.0 * rows[:, 0]  # cannot be distinguished
    rows[:, 2] = 0.0  # has no effect
    rows[:, 3] += rows[:, 4]
    columns = [Column(white(2), 10.0 * rows)]
    physical = np.array([True, True, True, True, False])
    found = undetermined(columns, np.zeros(5), np.ones(5), physical)
    assert sorted(sorted(places) for places, _ in found) == [[0, 1], [2]]
    # Without information about an initial state, what acts in the same way is not determined.
    rows[:, 3] = rows[:, 4]
    columns = [Column(white(2), 10.0 * rows)]
    found = undetermined(columns, np.zeros(5), np.ones(5), physical)
    assert sorted(sorted(places) for places, _ in found) == [[0, 1], [2], [3]]
    known = np.array([0.0, 0.0, 0.0, 0.0, 1e12])
    assert len(undetermined(columns, known, np.ones(5), physical)) == 2


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("links[0].flexural_rigidity", "flexural rigidity of link 1"),
        ("links[1].gauges[0].distance", "distance of gauge 1 of link 2"),
        ("joints[1].friction.coulomb", "coulomb friction of joint 2"),
        ("payload.mass", "mass of the payload"),
        (
            "links[0].damping.stiffness_coefficient",
            "stiffness coefficient of the damping of link 1",
        ),
        ("motors.torque_constant", "torque constant of the motors"),
        ("motors.torque_constant[1]", "torque constant of motor 2"),
    ],
)
def test_paths_in_words(path, words):
    assert in_words(path) == words
