"""Samples: their distributions, and the same values for any division into chunks."""

import numpy as np
import pytest
from scipy.stats import kstest, loguniform, norm
from small_study import PD, READING, content

import flexarm as fa
from flexarm.cases.studies.samples import Samples
from flexarm.model import StudySpec

VARY = {
    "payload.mass": {"kind": "uniform", "low": 0.0, "high": 2.0},
    "links[1].flexural_rigidity": {"kind": "log_uniform", "low": 0.1, "high": 10.0, "levels": 3},
    "run.duration": {"kind": "values", "values": [0.05, 0.07]},
}
EXACT = {"instruments": [{"signal": "joint_angle"}, {"signal": "joint_rate"}]}
NOISE = {"count": 3, "noise": "different"}
NORMAL = {"links[0].length": {"kind": "normal", "mean": 1.0, "deviation": 0.1, "relative": True}}


def samples(method, count=None, seed=3, **vary):
    plan = {"method": method, "seed": seed}
    plan |= {} if count is None else {"count": count}
    return Samples(StudySpec(**content(vary={**VARY, **vary}, samples=plan)))


@pytest.mark.parametrize("method", ["random", "sobol", "latin_hypercube", "grid"])
def test_values_do_not_depend_on_the_chunks(method):
    found = samples(method, None if method == "grid" else 37)
    whole = found.values(0, found.count)
    parts = [found.values(k, min(k + 5, found.count)) for k in range(0, found.count, 5)]
    assert np.array_equal(np.concatenate(parts), whole)
    assert len(whole) == found.count == (30 if method == "grid" else 37)


@pytest.mark.parametrize("method", ["random", "sobol", "latin_hypercube"])
def test_values_have_their_distribution(method):
    values = samples(method, 1024, **NORMAL).values(0, 1024)
    expected = [lambda x: x / 2.0, loguniform(0.1, 10.0).cdf]
    for column, cdf in zip(values.T, expected, strict=False):
        # The largest deviation of 1024 independent values exceeds 0.06 with a probability of 1e-3.
        assert kstest(column, cdf).statistic < 0.06
    assert kstest(values[:, 3], norm(1.0, 0.1).cdf).statistic < 0.06
    assert set(values[:, 2]) == {0.05, 0.07}
    assert abs(np.mean(values[:, 2] == 0.05) - 0.5) < 0.06
    assert not np.array_equal(values, samples(method, 1024, seed=4, **NORMAL).values(0, 1024))


def test_latin_hypercube_has_one_value_in_each_interval():
    masses = samples("latin_hypercube", 50).values(0, 50)[:, 0]
    assert sorted((masses * 25.0).astype(int)) == list(range(50))


def test_grid_has_all_combinations():
    found = samples("grid")
    values = found.values(0, found.count)
    assert len({tuple(row) for row in values.tolist()}) == 5 * 3 * 2
    assert np.unique(values[:, 0]).tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert np.unique(values[:, 1]) == pytest.approx([0.1, 1.0, 10.0], rel=1e-12)


def test_seeds_of_noise_have_63_bits():
    """Of 2000 seeds of 32 bits, two are equal with a probability of 1 in 2000."""
    plan = {"count": 2000, "noise": "different"}
    changes = {"hardware": READING, "drives": {"PD": PD}}
    drawn = Samples(StudySpec(**content(**changes, samples=plan)))
    seeds = [drawn.noise_seed(k) for k in range(2000)]
    assert len(set(seeds)) == 2000
    assert 2**62 < max(seeds) < 2**63
    assert fa.Hardware(seed=max(seeds)).seed == max(seeds)


def test_relative_values_are_factors():
    values = samples("random", 9, **NORMAL).values(0, 9)
    longer = content()["arm"] | {"links": [{**content()["arm"]["links"][0], "length": 3.0}] * 2}
    plan = {"method": "random", "count": 9, "seed": 3}
    other = Samples(StudySpec(**content(arm=longer, vary={**VARY, **NORMAL}, samples=plan)))
    assert other.values(0, 9)[:, 3] == pytest.approx(3.0 * values[:, 3], rel=1e-15)


@pytest.mark.parametrize("shared", [None, EXACT], ids=["none", "without noise"])
def test_hardware_of_a_plant_makes_samples_different(shared):
    plan = {"vary": {}, "samples": NOISE, "drives": {"PD": PD}, "hardware": shared}
    fa.Study(content(**plan, plants={"one": {}, "noisy": {"hardware": READING}}))
    with pytest.raises(fa.InputError, match="without noise"):
        fa.Study(content(**plan, plants={"exact": {"hardware": EXACT}}))


def test_largest_seed_is_the_largest_number_of_63_bits():
    """Stores keep seeds as integers of 64 bits with a sign."""
    assert samples("random", 4, seed=2**63 - 1).count == 4
    with pytest.raises(fa.ModelError, match="seed"):
        samples("random", 4, seed=2**63)
