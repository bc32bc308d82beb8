"""Indices of Sobol' of functions whose indices are known."""

import math
import warnings

import numpy as np
import pytest
from scipy.stats import qmc
from small_study import content
from test_study_statistics import table

import flexarm as fa

UNIT = {"kind": "uniform", "low": 0.0, "high": 1.0}


def indices_of(y, u, **options):
    """Return the indices (numbers,) of values whose numbers are in the table alone."""
    names = {f"x{j}": column for j, column in enumerate(u.T)}
    return fa.sensitivity_indices(table(y, **names), **options).squeeze()


def of_study(function, vary, count=64, seed=3):
    """Return the indices of a function of the samples of a study with distributions."""
    paths = "payload.mass", "links[0].flexural_rigidity", "joints[1].mass"
    plan = {"method": "sobol", "count": count, "seed": seed}
    given = content(vary=dict(zip(paths, vary, strict=False)), samples=plan)
    study = fa.Study(given)
    samples = study._executor.samples
    numbers = samples.values(0, count)
    columns = dict(zip(samples.paths, numbers.T, strict=True))
    made = table(function(*numbers.T), **columns).assign_attrs(study=study._text)
    return fa.sensitivity_indices(made).squeeze()


@pytest.mark.parametrize("count", [64, 128, 256])
def test_indices_of_a_sum(count):
    """Of 4 a + 2 b + c: 16/21, 4/21, 1/21. Without a study, the variances are those of the samples,
    which differ from 1/12 by 1/count² in a Sobol sequence."""
    u = qmc.Sobol(3, seed=1).random(count)
    found = indices_of(u @ [4.0, 2.0, 1.0], u)
    exact = np.array([16.0, 4.0, 1.0]) / 21.0
    assert found.first_order.values == pytest.approx(exact, abs=2e-3)
    assert found.total.values == pytest.approx(exact, abs=2e-3)
    assert found.unexplained < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_interactions_are_in_the_total_indices(seed):
    """The function of Ishigami and Homma (1990) with a = 7, b = 0.1."""
    u = qmc.Sobol(3, seed=seed).random(128)
    x = np.pi * (2.0 * u - 1.0)
    y = np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    first, second = 0.5 * (1.0 + 0.1 * math.pi**4 / 5.0) ** 2, 49.0 / 8.0
    both = 0.01 * math.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    whole = first + second + both
    found = indices_of(y, u)
    # Degrees up to 12 need more samples; 128 leave a few thousandths unexplained.
    assert found.first_order.values == pytest.approx([first / whole, second / whole, 0], abs=0.02)
    exact = np.array([first + both, second, both]) / whole
    assert found.total.values == pytest.approx(exact, abs=0.02)


def test_distributions_have_their_polynomials():
    """ln x + z ln x / 2 + 10 l of a logarithmic, a normal and a listed number: a polynomial of the
    variables of the distributions, so that the indices are exact."""
    normal = {"kind": "normal", "mean": 2.0, "deviation": 0.5, "relative": True}
    logarithmic = {"kind": "log_uniform", "low": 1.0, "high": math.exp(2.0)}
    listed = {"kind": "values", "values": [0.1, 0.1, 0.4]}

    def function(logs, normals, levels):
        return np.log(logs) + normals / 40.0 * np.log(logs) + 10.0 * levels

    found = of_study(function, [logarithmic, normal, listed])
    # ln x: mean 1, variance 1/3; normal: mean 2, variance 1/4; listed: mean 2, variance 2.
    parts = {"x": 9.0 / 3.0, "z": 0.25, "l": 2.0, "xz": 0.25 / 3.0}
    whole = sum(parts.values())
    first = np.array([parts["x"], parts["z"], parts["l"]]) / whole
    total = np.array([parts["x"] + parts["xz"], parts["z"] + parts["xz"], parts["l"]]) / whole
    assert found.unexplained < 1e-12
    assert found.first_order.values == pytest.approx(first, abs=1e-9)
    assert found.total.values == pytest.approx(total, abs=1e-9)


def functions(rng):
    """Yield random functions of numbers in (0, 1), their indices, and whether they are smooth."""
    weights = rng.uniform(0.1, 3.0, 4)
    yield lambda u: u @ weights, weights**2 / (weights @ weights), True
    a = rng.uniform(0.0, 5.0, 4)
    parts = 1.0 / (3.0 * (1.0 + a) ** 2)
    yield (
        lambda u: np.prod((abs(4.0 * u - 2.0) + a) / (1.0 + a), axis=1),
        parts / (np.prod(1.0 + parts) - 1.0),
        False,
    )
    noise = 0.3 * np.linalg.norm(weights) / math.sqrt(12.0)
    yield (
        lambda u: u @ weights + noise * rng.normal(size=len(u)),
        weights**2 / (weights @ weights) / 1.09,
        False,
    )


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.AccuracyWarning")
def test_intervals_contain_the_errors():
    inside, smooth_widths = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        u = qmc.Sobol(4, seed=seed).random(128)
        for function, exact, smooth in functions(rng):
            found = indices_of(function(u), u)
            width = found.first_order_confidence.values + 1e-3  # of the distribution of samples
            inside += list(abs(found.first_order.values - exact) <= width)
            if smooth:
                smooth_widths.append(width.max())
    assert np.mean(inside) > 0.95
    assert max(smooth_widths) < 2e-3


@pytest.mark.parametrize("size", [2, 20])
def test_an_expansion_that_explains_nothing_warns(size):
    """The choice of terms from many must not hide that the values are noise."""
    rng = np.random.default_rng(size)
    u, y = rng.random((64, size)), rng.normal(size=64)
    with pytest.warns(fa.AccuracyWarning, match=r"leave \d+ % of the variance of tip_error_rms un"):
        found = indices_of(y, u)
    assert found.unexplained > 0.8
    assert (found.first_order_confidence > 0.8).all()


def test_runs_without_a_value_are_left_out():
    u = qmc.Sobol(2, seed=1).random(64)
    made = table(u[:, 0], failed=[3], x0=u[:, 0], x1=u[:, 1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fa.sensitivity_indices(made).squeeze()
    assert found.first_order.values == pytest.approx([1.0, 0.0], abs=1e-9)
    with pytest.warns(fa.AccuracyWarning, match="4 of 64 runs have no tip_error_rms"):
        fa.sensitivity_indices(table(u[:, 0], failed=range(4), x0=u[:, 0], x1=u[:, 1]))
    few = fa.sensitivity_indices(table(u[:, 0], failed=range(50), x0=u[:, 0], x1=u[:, 1]))
    assert few.to_array().isnull().all()
    constant = fa.sensitivity_indices(table(np.ones(64), x0=u[:, 0], x1=u[:, 1]))
    assert constant.to_array().isnull().all()
