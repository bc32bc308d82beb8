"""Statistics of a fit on samples whose distribution is known."""

import numpy as np
import pytest

from flexarm.identification.space import in_words
from flexarm.identification.statistics import (
    Column,
    covariance_of,
    cross_correlation,
    fit_percent,
    independence,
    undetermined,
    whiteness,
)

COUNT = 600
ALL = np.ones(COUNT, dtype=bool)


def white(seed):
    return np.random.default_rng(seed).standard_normal(COUNT)


def coloured(seed, memory=0.8):
    from scipy.signal import lfilter

    return lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], white(seed))


def test_fit_percent():
    values = np.array([1.0, 2.0, 3.0, 4.0])
    assert fit_percent(values, values) == 100.0
    assert fit_percent(values, np.full(4, 2.5)) == pytest.approx(0.0)


@pytest.mark.thorough
def test_tests_reject_white_residuals_as_often_as_they_state():
    signal = np.random.default_rng(99).standard_normal(COUNT)
    found = np.array(
        [(whiteness(white(k), ALL), independence(white(k), ALL, signal)) for k in range(300)]
    )
    # 5 % of 300, plus or minus four standard deviations.
    rejected = (found < 0.05).sum(axis=0)
    assert np.all(np.abs(rejected - 15) < 4 * np.sqrt(300 * 0.05 * 0.95))


def rejections(p_values, level=0.01):
    """Return the share of probabilities below a level."""
    return np.mean(np.array(p_values) < level)


# A test at 1 % rejects 1 % of 500; the limit is four standard deviations of that share above it.
MOST_REJECTED = 0.01 + 4 * np.sqrt(0.01 * 0.99 / 500)


@pytest.mark.thorough
@pytest.mark.parametrize("scattered", [False, True])
def test_gaps_do_not_count_as_correlation(scattered):
    valid = ALL.copy()
    if scattered:
        valid = np.random.default_rng(7).uniform(size=COUNT) > 0.3
    else:
        valid[200:380] = False
    signal = np.cumsum(np.random.default_rng(99).standard_normal(COUNT))
    residuals = [np.where(valid, white(k) + 1.0, 0.0) for k in range(500)]
    assert rejections([whiteness(one, valid) for one in residuals]) < MOST_REJECTED
    assert rejections([independence(one, valid, signal) for one in residuals]) < MOST_REJECTED


@pytest.mark.thorough
def test_residuals_that_are_correlated_for_another_reason_pass_independence():
    found = []
    for k in range(500):
        signal = np.cumsum(white(1000 + k))
        found.append(independence(np.convolve(white(k), [1.0, 0.9, 0.8, 0.6], "same"), ALL, signal))
    assert rejections(found) < MOST_REJECTED


def test_correlated_residuals_that_depend_on_the_input_fail_independence():
    signal = np.random.default_rng(99).standard_normal(COUNT)
    late = 0.5 * np.concatenate([np.zeros(7), signal[:-7]])
    found = [
        independence(np.convolve(white(k), [1.0, 0.9, 0.8, 0.6], "same") + late, ALL, signal)
        for k in range(20)
    ]
    assert rejections(found) == 1.0


def test_errors_of_estimates_do_not_count_as_dependence_on_the_input():
    """Unseen records: the outputs depend on the input by coefficients with a deviation of 0.2."""
    signal = np.random.default_rng(99).standard_normal(COUNT)
    slopes = np.stack([np.concatenate([np.zeros(k), signal[: COUNT - k]]) for k in (1, 4)], axis=1)
    every = np.random.default_rng(7).standard_normal((40, 2))
    residuals = [white(k) + 0.2 * slopes @ error for k, error in enumerate(every)]
    errors = 0.2 * slopes
    assert rejections([independence(r, ALL, signal) for r in residuals]) > 0.5
    assert rejections([independence(r, ALL, signal, errors=errors) for r in residuals]) <= 1 / 40
    # A dependence of another form is still noticed.
    lacking = residuals[0] + 0.3 * np.concatenate([np.zeros(8), signal[:-8]])
    assert independence(lacking, ALL, signal, errors=errors) < 1e-3


def test_tests_reject_residuals_with_structure():
    signal = np.random.default_rng(99).standard_normal(COUNT)
    assert whiteness(coloured(1), ALL) < 1e-6
    late = 0.3 * np.concatenate([np.zeros(7), signal[:-7]])
    assert independence(white(1) + late, ALL, signal) < 1e-6
    assert whiteness(white(1), ALL) > 0.01


@pytest.mark.parametrize("count", [2, 3])
def test_whiteness_of_few_residuals_is_a_probability(count):
    assert 0.0 < whiteness(white(1)[:count], ALL[:count]) <= 1.0


def regression(noise):
    """Estimate two numbers from one channel; return errors and their stated deviations."""
    times = np.arange(COUNT) / COUNT
    inputs = np.stack([np.sin(12 * times), times], axis=1)
    estimate, *_ = np.linalg.lstsq(inputs, noise, rcond=None)
    residuals = noise - inputs @ estimate
    noise = residuals.std()
    column = Column(residuals / noise, -inputs / noise, ALL)
    return estimate, np.sqrt(np.diag(covariance_of([column], np.zeros(2))))


@pytest.mark.sampled("white-0.95-1.35")
@pytest.mark.parametrize(("source", "low", "high"), [(white, 0.95, 1.35), (coloured, 0.9, 1.4)])
def test_stated_deviations_are_those_of_many_repetitions(source, low, high):
    found = [regression(source(seed)) for seed in range(200)]
    errors = np.array([one[0] for one in found])
    stated = np.array([one[1] for one in found])
    ratio = np.sqrt(np.mean(stated**2, axis=0)) / errors.std(axis=0)
    # The deviation of 200 repetitions is known to 5 %. The larger one of two deviations is stated,
    # of which that of eight blocks is known to 27 %: the mean square is some 1.2^2.
    assert np.all((ratio > low) & (ratio < high)), ratio


def test_blocks_increase_the_deviation_where_parts_of_a_record_disagree():
    """Errors of the model that differ from part to part are not noise of a short correlation."""
    times = np.arange(COUNT) / COUNT
    slope = np.sin(60.0 * times)
    error = np.sign(np.sin(2.5 * np.pi * times)) * slope  # a gain that changes slowly
    residuals = white(1) * 0.1 + error - slope * (slope @ error) / (slope @ slope)
    residuals /= residuals.std()
    column = Column(residuals, -slope[:, None], ALL)
    alone = 1.0 / np.linalg.norm(slope)
    stated = float(np.sqrt(covariance_of([column], np.zeros(1))[0, 0]))
    blocks = [residuals[k : k + 75] @ slope[k : k + 75] for k in range(0, COUNT, 75)]
    expected = np.sqrt(np.sum(np.square(blocks)) * 8 / 7) / (slope @ slope)  # sum of eight scores
    assert stated > 2.0 * alone
    assert stated == pytest.approx(expected, rel=0.25)  # the step without a block is larger


def test_derivatives_of_rounding_have_no_zero_deviation():
    """Residuals of alternating signs and gaps make the estimated variance negative."""
    valid = np.random.default_rng(1).uniform(size=COUNT) > 0.5
    residuals = np.where(valid, (-1.0) ** np.arange(COUNT), 0.0)
    columns = [Column(residuals, 1e-9 * valid[:, None].astype(float), valid)]
    found = covariance_of(columns, np.zeros(1))
    assert found[0, 0] > 1e10


def test_correlations_with_an_input_find_its_delay():
    signal = white(3)
    residuals = np.roll(signal, 4) + 2.0 * white(5)
    residuals[:4] = 0.0
    found, deviation = cross_correlation(residuals, ALL, signal, 10)
    assert np.argmax(np.abs(found)) == 4
    assert found[4] > 6.0 * deviation
    # Ten normal numbers: all below four in 999 of 1000 cases.
    assert np.abs(np.delete(found, 4)).max() < 4.0 * deviation


def test_priors_count_as_measurements():
    column = Column(white(1), np.ones((COUNT, 1)), ALL)
    (alone,) = np.diag(covariance_of([column], np.zeros(1)))
    (both,) = np.diag(covariance_of([column], np.array([1.0 / alone])))
    assert both == pytest.approx(alone / 2, rel=0.3)  # the residuals are correlated by chance


def test_undetermined_combinations_are_found_behind_initial_states():
    random = np.random.default_rng(4)
    rows = random.standard_normal((COUNT, 5))
    rows[:, 1] = 2.0 * rows[:, 0]  # cannot be distinguished
    rows[:, 2] = 0.0  # has no effect
    rows[:, 3] += rows[:, 4]
    columns = [Column(white(2), 10.0 * rows, ALL)]

    def lost(columns, priors):
        covariance = covariance_of(columns, priors)[:4, :4]
        return sorted(sorted(places) for places, _ in undetermined(covariance, np.ones(4)))

    assert lost(columns, np.zeros(5)) == [[0, 1], [2]]
    # Without information about an initial state, what acts in the same way is not determined.
    rows[:, 3] = rows[:, 4]
    columns = [Column(white(2), 10.0 * rows, ALL)]
    assert lost(columns, np.zeros(5)) == [[0, 1], [2], [3]]
    assert lost(columns, np.array([0.0, 0.0, 0.0, 0.0, 1e12])) == [[0, 1], [2]]


def test_a_sum_is_named_with_a_part_that_is_nearly_zero():
    """The first two act as a sum, the third alone; all of them are undetermined."""
    rows = np.random.default_rng(4).standard_normal((COUNT, 3)) * [1e3, 1e3, 1e-3]
    rows[:, 1] = rows[:, 0]
    covariance = covariance_of([Column(white(2), rows, ALL)], np.zeros(3))
    assert np.array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0
    for part in (1e-5, 1.0):
        lost = undetermined(covariance, np.array([part, 1.0, 0.01]))
        assert sorted(sorted(places) for places, _ in lost) == [[0, 1], [2]]


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


def test_what_is_not_determined_has_the_deviation_of_the_table():
    """Coloured residuals and a related parameter increase a deviation beyond the limit of 50 %."""
    random = np.random.default_rng(8)
    rows = np.stack([np.sin(np.arange(COUNT) / 40.0), random.standard_normal(COUNT)], axis=1)
    rows = np.linalg.qr(rows)[0]
    residuals = coloured(3, memory=0.95)
    deviations = np.sqrt(np.diag(covariance_of([Column(residuals, rows, ALL)], np.zeros(2))))
    # One deviation is scaled to 0.6, the other one to 0.4: white residuals would give less.
    columns = [Column(residuals, rows * deviations / [0.6, 0.4], ALL)]
    covariance = covariance_of(columns, np.zeros(2))
    ((places, deviation),) = undetermined(covariance, np.ones(2))
    assert places == [0]
    assert deviation == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-9)
    white_only = 1.0 / np.linalg.norm(columns[0].derivatives[:, 0])
    assert white_only < 0.5 < deviation


def test_tests_that_cannot_be_made_are_not_numbers():
    assert np.isnan(whiteness(np.zeros(COUNT), ALL))
    assert np.isnan(independence(np.zeros(COUNT), ALL, white(1)))
    assert np.isnan(independence(white(1), ALL, np.full(COUNT, 3.0)))
