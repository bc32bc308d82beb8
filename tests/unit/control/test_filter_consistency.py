"""Errors of the Kalman filters against their covariance, over a few random runs."""

from __future__ import annotations

import itertools
import warnings

import numpy as np
import pytest
from scipy.stats import chi2

from page_scripts import script

#: Runs of each arm; the page "Control under uncertainty" has the table of 100.
SEEDS = 8


STUDY = script("measure_consistency")


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "moving"), [*itertools.product(STUDY.ARMS, [False, True])])
def test_errors_have_the_stated_covariance(name, moving):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of links that bend far under a heavy random payload
        squared, consistent = zip(
            *(STUDY.errors(name, moving, seed) for seed in range(SEEDS)), strict=True
        )
    arm, _ = STUDY.ARMS[name]
    # Twelve sums are tested: with other seeds one would be outside its band in 1 % of cases.
    low, high = chi2.ppf([0.0005, 0.9995], SEEDS * (2 * arm.dof + 1))
    assert np.all((low < np.sum(squared, axis=0)) & (np.sum(squared, axis=0) < high))
    assert all(consistent)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:.*the least squares did not converge")  # one of 750 samples
@pytest.mark.parametrize(("kind", "rtol"), [("unscented", 0.25), ("moving horizon", 0.3)])
def test_other_filters_have_the_errors_of_the_extended_one_on_the_same_draws(kind, rtol):
    """A large mean over a few draws is therefore no property of the filter; large, small, usual."""
    kinds = [
        [STUDY.errors("one link", False, seed, name)[0] for seed in (3, 4, 5)]
        for name in ("extended", kind)
    ]
    np.testing.assert_allclose(kinds[1], kinds[0], rtol=rtol)
    assert np.ptp(kinds[0]) > 8.0
