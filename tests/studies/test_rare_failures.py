"""Probabilities of rare failures: closed forms, and an arm."""

import numpy as np
import pytest
from scipy.stats import norm
from small_study import content

import flexarm as fa
from flexarm.cases.studies.rare import subset_probability

#: Failures with known probabilities: performance, number of variables, probability.
CASES = {
    "plane": (lambda x: 1.0 + x.sum(axis=1) / np.sqrt(x.shape[1]) - 3.72, 2, norm.sf(3.72)),
    "plane of 50": (lambda x: 1.0 + x.sum(axis=1) / np.sqrt(50.0) - 3.72, 50, norm.sf(3.72)),
    "two sides": (lambda x: abs(x[:, 0]) / 3.89, 2, 2.0 * norm.sf(3.89)),
    "failed runs": (lambda x: np.where(x[:, 0] > 3.0, np.inf, x[:, 0] / 4.0), 2, norm.sf(3.0)),
    "infeasible": (lambda x: np.where(x[:, 1] < 0.0, -np.inf, x[:, 0] / 3.0), 2, norm.sf(3.0)),
    "frequent": (lambda x: 1.0 + x[:, 0], 1, 0.5),
}


@pytest.mark.parametrize("name", CASES)
def test_probabilities_of_closed_forms(name):
    """The mean is right and the coefficient of variation is that of 30 seeds."""
    performance, size, exact = CASES[name]
    found = [subset_probability(performance, size, 1000, seed) for seed in range(30)]
    values = np.array([one.value for one in found])
    variation = np.mean([one.variation for one in found])
    # Three standard deviations of the mean, and of an estimate of a deviation: 3 / sqrt(60).
    assert np.mean(values) == pytest.approx(exact, rel=3.0 * variation / np.sqrt(30.0))
    assert np.std(values) / exact == pytest.approx(0.9 * variation, rel=0.45)
    deviations = np.log(values / exact) / np.sqrt(np.log1p(variation**2))
    assert np.mean(abs(deviations) < 1.96) >= 0.9
    assert max(one.evaluations for one in found) <= 1000 + 900 * 4


def test_failures_without_a_path_and_without_probability():
    nothing = subset_probability(lambda x: np.where(x[:, 0] > 4.0, 2.0, 0.0), 2, 500, 0)
    assert np.isnan(nothing.value)
    never = subset_probability(lambda x: 1e-3 * x[:, 0], 1, 500, 0)
    assert never.value == 0.0
    assert never.evaluations == 500 + 450 * 8
    assert np.isnan(subset_probability(lambda x: np.full(len(x), -np.inf), 1, 500, 0).value)


def carrying():
    """Return a study whose only uncertain number is the payload, normal with deviation 20 g."""
    vary = {"payload.mass": {"kind": "normal", "mean": 0.1, "deviation": 0.02}}
    return content(vary=vary, samples=None, rare_failures={"samples": 200, "seed": 1})


@pytest.mark.thorough
def test_probability_of_an_arm_is_that_of_the_payload_which_reaches_the_limit():
    """The error of the tip falls with the payload: exact is the probability of less payload."""
    study = fa.Study(carrying())
    executor, chosen = study._executor, ("torque", "as believed", "move")
    payloads = 0.1 + 0.02 * np.array([[-3.6], [-3.1], [0.0], [3.6]])
    errors = executor.performances(payloads, 0, chosen, {"tip_error_peak": 1.0})
    assert np.all(np.diff(errors) < 0.0)
    limit, exact = float(errors[1]), norm.sf(3.1)
    found = study.rare_failures({"tip_error_peak": limit}).squeeze()
    assert found["probability_low"] < exact < found["probability_high"]
    assert 0.2 < found["variation"] < 0.8
    assert found["runs"] < 1000
    often = {"tip_error_peak": float(errors[2])}
    assert study.rare_failures(often).identical(study.rare_failures(often, workers=2))


def test_wrong_arguments_are_refused():
    study = fa.Study(carrying())
    with pytest.raises(fa.InputError, match="limits must be one of 12 names, got 'tip'"):
        study.rare_failures({"tip": 1.0})
    with pytest.raises(fa.InputError, match="samples must be at least 100"):
        study.rare_failures({"tip_error_peak": 1.0}, samples=10)
    with pytest.raises(fa.InputError, match="vary is required with rare_failures"):
        fa.Study({**carrying(), "vary": {}})
    with pytest.warns(fa.AccuracyWarning, match="cannot be distinguished from other samples"):
        assert np.isnan(study.rare_failures(samples=100)["probability"].item())
