"""Studies that end when a quantile is known well enough."""

import numpy as np
import pytest
from small_study import content, files_of

import flexarm as fa
from flexarm.cases.studies.store import quantile_interval

STOP = {"metric": "tip_error_rms", "quantile": 0.5, "within": 0.022}


def study(count=300, method="random", **stop):
    plan = {"method": method, "count": count, "seed": 2, "stop": {**STOP, **stop}}
    return fa.Study(content(samples=plan))


def test_interval_of_a_quantile_is_that_of_order_statistics():
    """For the median of 20 values and 95 %: the 6th and the 15th (David and Nagaraja, 2003)."""
    values = np.random.default_rng(1).permutation(np.arange(1.0, 21.0))
    assert quantile_interval(values, 0.5, 0.95) == (6.0, 15.0)
    assert quantile_interval(values, 0.999, 0.95)[1] == np.inf
    assert quantile_interval(np.zeros(0), 0.5, 0.95) == (-np.inf, np.inf)


@pytest.mark.parametrize("quantile", [0.05, 0.5, 0.95])
def test_interval_contains_the_quantile_as_often_as_it_says(quantile):
    rng, inside = np.random.default_rng(3), []
    for _ in range(1000):
        low, high = quantile_interval(rng.random(100), quantile, 0.9)
        inside.append(low <= quantile <= high)
    # The number of ends is discrete; 1000 trials scatter by 1 %.
    assert 0.88 < np.mean(inside) < 0.98


@pytest.mark.thorough
def test_a_study_ends_at_the_same_sample_for_all_chunks_and_interruptions(tmp_path):
    """With 64 samples the median is known within 2.5 %, with 128 within 1.9 %."""
    table = study().run(workers=1, chunk=7)
    assert table.sizes["sample"] == 128
    assert table.identical(study().run(workers=1, chunk=50))
    first, second = tmp_path / "first.zarr", tmp_path / "second.zarr"
    assert (
        study()
        .run(first, workers=1, chunk=9)
        .identical(table.assign_attrs(fa.read_study(first).attrs))
    )
    assert fa.read_study(first).sizes["sample"] == 128
    interrupted = study()
    execute, executed = interrupted._executor.outcomes, []

    def twice(start, stop):
        if len(executed) == 10:
            raise KeyboardInterrupt
        executed.append(start)
        return execute(start, stop)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("flexarm.cases.studies.study.executor_of", lambda _: interrupted._executor)
        patch.setattr(interrupted._executor, "outcomes", twice)
        with pytest.raises(KeyboardInterrupt):
            interrupted.run(second, workers=1, chunk=9)
    assert fa.read_study(second).sizes["sample"] == 90
    study().run(second, workers=1, resume=True)
    assert files_of(second) == files_of(first)
    assert study().verify(second) == []


@pytest.mark.thorough
def test_two_processes_end_at_the_same_sample(tmp_path):
    table = study().run(tmp_path / "store.zarr", workers=2, chunk=20)
    assert table.sizes["sample"] == 128
    alone = study().run(workers=1)
    assert np.array_equal(table["tip_error_rms"].values, alone["tip_error_rms"].values)


@pytest.mark.thorough
def test_samples_that_do_not_suffice_give_a_warning():
    with pytest.warns(fa.AccuracyWarning, match=r"70 samples determine the 0.5 quantile of tip_er"):
        table = study(70, within=0.01).run(workers=1)
    assert table.sizes["sample"] == 70
    with pytest.warns(fa.AccuracyWarning, match=r"70 samples do not determine the 0.999 quantile"):
        study(70, quantile=0.999).run(workers=1)
