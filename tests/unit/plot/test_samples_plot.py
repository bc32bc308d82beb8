"""Plots of the samples of a study: a dot for each run, a cross for each failure."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import flexarm as fa

DIMS = ("sample", "controller", "plant", "reference")


@pytest.fixture
def table():
    errors = np.arange(8.0).reshape(4, 2, 1, 1)
    failure = np.full(errors.shape, "", dtype="<U6")
    errors[3, 1], failure[3, 1] = np.nan, "failed"
    coords = {"sample": np.arange(4), "controller": ["PD", "LQG"], "plant": ["one"]}
    coords |= {"reference": ["line"], "payload.mass": ("sample", [0.4, 0.1, 0.3, 0.2])}
    coords |= {"run.duration": ("sample", [1.0, 2.0, 3.0, 4.0])}
    return xr.Dataset({"tip_error_rms": (DIMS, errors), "failure": (DIMS, failure)}, coords)


def test_dots_are_the_runs_and_crosses_the_failures(table):
    (mass, duration), *others = fa.plot.samples(table)
    assert not others
    assert mass.get_xlabel() == "payload.mass"
    assert duration.get_xlabel() == "run.duration"
    assert mass.get_ylabel() == "tip_error_rms [mm]"
    first, no_cross, second, cross = mass.lines
    assert first.get_xydata().tolist() == [[0.4, 0.0], [0.1, 2e3], [0.3, 4e3], [0.2, 6e3]]
    assert second.get_label() == "LQG"
    assert no_cross.get_xdata().size == 0
    assert cross.get_xdata().tolist() == [0.2]
    assert [text.get_text() for text in mass.figure.legends[0].get_texts()] == ["PD", "LQG"]


def test_own_axes_are_used(table):
    own = Figure().subplots(1, 2)
    assert fa.plot.samples(table, axes=own)[0, 1] is own[1]
    assert len(own[1].lines) == 4


def test_wrong_tables_are_refused(table):
    with pytest.raises(fa.InputError, match="metric must be one of 'tip_error_rms'"):
        fa.plot.samples(table, "torque_peak")
    with pytest.raises(fa.InputError, match="has no varied numbers"):
        fa.plot.samples(table.drop_vars(["payload.mass", "run.duration"]))
