"""Statistics of studies, on tables with known numbers."""

import numpy as np
import pytest
import xarray as xr

import flexarm as fa

DIMS = ("sample", "controller", "plant", "reference")


def table(values, failed=(), **varied):
    count = len(values)
    texts = np.full((count, 1, 1, 1), "", dtype="<U9")
    texts[list(failed)] = "it failed"
    errors = np.array(values, dtype=float).reshape(-1, 1, 1, 1)
    errors[list(failed)] = np.nan
    coords = {"sample": np.arange(count), **{dim: ["one"] for dim in DIMS[1:]}}
    coords |= {name: ("sample", given) for name, given in varied.items()}
    return xr.Dataset({"tip_error_rms": (DIMS, errors), "failure": (DIMS, texts)}, coords)


def test_quantiles_leave_out_failures():
    found = fa.study_statistics(table(range(12), failed=[11]), [0.0, 0.5, 1.0])
    assert found["tip_error_rms"].values.ravel().tolist() == [0.0, 5.0, 10.0]
    assert found["samples"].item() == 11
    assert set(found.coords) == {*DIMS[1:], "quantile"}


def test_infeasible_runs_are_not_in_the_rates():
    own = table(range(6), failed=[0, 1, 2])
    reasons = np.full((6, 1, 1, 1), "", dtype="<U4")
    reasons[1:3] = "mass"
    own["infeasible"] = (DIMS, reasons)
    own["failure"][1:3] = ""
    found = fa.study_statistics(own, limits={"tip_error_rms": 4.0})
    assert found["failure_rate"].item() == 0.5  # one of four failed, one exceeds the limit
    assert (found["samples"].item(), found["infeasible"].item()) == (3, 2)
    nothing = fa.study_statistics(own.isel(sample=[1, 2]), limits={"tip_error_rms": 4.0})
    assert np.isnan(nothing["failure_rate"].item())
    assert np.isnan(nothing["failure_rate_high"].item())
    bad = fa.study_statistics(own.isel(sample=[0, 1]), limits={"tip_error_rms": 4.0})
    assert bad["failure_rate"].item() == 1.0


def test_interval_of_failures_is_exact():
    """No failure in 20 runs: (alpha / 2)^(1/20) of the binomial distribution."""
    found = fa.study_statistics(table(range(20)), confidence=0.95)
    assert found["failure_rate"].item() == 0.0
    assert found["failure_rate_low"].item() == 0.0
    assert found["failure_rate_high"].item() == pytest.approx(1.0 - 0.025 ** (1 / 20), rel=1e-9)


def test_limits_count_as_failures():
    found = fa.study_statistics(table(range(10), failed=[0]), limits={"tip_error_rms": 7.0})
    assert found["failure_rate"].item() == pytest.approx(0.3)


def test_values_that_do_not_exist_exceed_a_limit():
    found = fa.study_statistics(table([1.0, np.nan, 3.0, 9.0]), limits={"tip_error_rms": 7.0})
    assert found["failure_rate"].item() == pytest.approx(0.5)
    assert found["samples"].item() == 4


def test_limit_of_a_metric_without_values_is_refused():
    with pytest.raises(fa.InputError, match="cannot contain tip_error_rms, which is NaN for all"):
        fa.study_statistics(table([np.nan, np.nan]), limits={"tip_error_rms": 7.0})
    all_failed = table([1.0, 2.0], failed=[0, 1])
    found = fa.study_statistics(all_failed, limits={"tip_error_rms": 7.0})
    assert found["failure_rate"].item() == 1.0


def test_ratios_are_relative_to_the_nominal_runs():
    given = table(range(1, 12))
    nominal = table([4.0]).isel(sample=0).drop_vars("failure")
    found = fa.study_statistics(given, [0.0, 1.0], nominal=nominal)
    assert found["tip_error_rms_ratio"].values.ravel().tolist() == [0.25, 2.75]
    zero = fa.study_statistics(given, [0.0, 1.0], nominal=0.0 * nominal)
    assert np.isnan(zero["tip_error_rms_ratio"].values).all()
    with pytest.raises(fa.InputError, match=r"nominal must be a table .* with samples"):
        fa.study_statistics(given, [0.5], nominal=given)
    other = nominal.assign_coords(controller=["another"])
    with pytest.raises(fa.InputError, match="nominal must have the same names of controller"):
        fa.study_statistics(given, nominal=other)
    with pytest.raises(fa.InputError, match=r"nominal must be a table of Study\.nominal"):
        fa.study_statistics(given, nominal=xr.Dataset())
