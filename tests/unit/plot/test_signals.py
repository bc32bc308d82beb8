"""The quick plot of a result draws its channels, with their units, for arms of any size."""

import io

import numpy as np
import pytest
from matplotlib.text import Text

import flexarm as fa
from flexarm.view.plot.histories import readable_unit, series_colors, signals_figure


def run(links, gauges=(), **fields):
    link = fa.Link(length=0.3, flexural_rigidity=3.0, mass_per_length=0.4, elements=1)
    first = link.replace(gauges=list(gauges))
    arm = fa.Arm(links=[first, *[link] * (links - 1)], gravity=(0.0, -9.81), **fields)
    return fa.simulate(arm, 0.05, rate=200.0)


@pytest.fixture(scope="module")
def result():
    return run(2, [fa.Gauge(station=0.1, distance=0.002)])


def plot(figure, title):
    (axes,) = (axes for axes in figure.axes if axes.get_title(loc="left") == title)
    return axes


@pytest.mark.thorough_cases("Joint rate-joint_rate-1.0-rate [rad/s]")
@pytest.mark.parametrize(
    ("title", "channel", "scale", "unit"),
    [
        ("Joint angle", "joint_angle", 1.0, "angle [rad]"),
        ("Joint rate", "joint_rate", 1.0, "rate [rad/s]"),
        ("Link tip deflection", "link_tip_deflection", 1e3, "deflection [mm]"),
        ("Torque", "torque", 1.0, "torque [N m]"),
        ("Strain", "strain", 1e6, "strain [µm/m]"),
    ],
)
def test_lines_equal_the_channel(title, channel, scale, unit, result):
    axes = plot(signals_figure(result), title)
    drawn = np.array([line.get_ydata() for line in axes.get_lines()]).T
    assert np.array_equal(drawn, scale * result[channel])
    assert axes.get_ylabel() == unit


def test_energies_and_their_sum_are_drawn(result):
    axes = plot(signals_figure(result), "Energy")
    drawn = {line.get_label(): line for line in axes.get_lines()}
    assert set(drawn) == {"kinetic", "strain", "gravity", "total"}
    parts = sum(drawn[name].get_ydata() for name in ("kinetic", "strain", "gravity"))
    assert np.allclose(drawn["total"].get_ydata(), parts, rtol=0.0, atol=1e-15)
    assert drawn["total"].is_dashed()


def test_tip_path_is_drawn(result):
    axes = plot(signals_figure(result), "Tip")
    assert np.array_equal(axes.get_lines()[0].get_xydata(), result["tip"])


def test_without_gauges_there_is_no_plot_of_strains():
    assert len(signals_figure(run(1)).axes) == 6


def test_first_and_last_of_many_lines_are_named():
    axes = plot(signals_figure(run(9)), "Joint angle")
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["joint 1", "joint 9"]
    colors = [line.get_color() for line in axes.get_lines()]
    assert len(set(colors)) == 9


@pytest.mark.parametrize("count", [1, 6, 7, 40])
def test_lines_have_different_colours(count):
    assert len(set(series_colors(count))) == count


@pytest.mark.parametrize(
    ("unit", "largest", "expected"),
    [
        ("N m", 9999.0, (1.0, "N m")),
        ("N m", 2e4, (1e-3, "kN m")),
        ("J", 2e4, (1e-3, "kJ")),
        ("rad", 2e4, (1.0, "rad")),
        ("m", 5.0, (1e3, "mm")),
    ],
)
def test_large_numbers_get_a_larger_unit(unit, largest, expected):
    assert readable_unit(unit, np.array([0.0, -largest])) == expected


def test_the_factor_of_small_numbers_is_beside_the_title():
    """Of an arm of micrometres, whose torques are printed with a factor of 1e-12."""
    arm = fa.Arm(
        links=[fa.Link(length=2e-4, flexural_rigidity=2e-12, mass_per_length=9e-8, elements=1)]
    )
    figure = signals_figure(fa.simulate(arm, 1e-5, torque=lambda t: [1e-13]))
    figure.savefig(io.BytesIO(), format="png")
    factors = 0
    for axes in figure.axes:
        factor = axes.yaxis.get_offset_text()
        (title,) = (t for t in axes.findobj(Text) if t.get_text() == axes.get_title(loc="left"))
        assert not factor.get_window_extent().overlaps(title.get_window_extent())
        factors += bool(factor.get_text())
    assert factors >= 2
