"""Histories, comparisons and phase portraits show the channels of results."""

import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
from plot_results import arm, result, rigid_result

import flexarm as fa
from flexarm.simulation.run.channels import CHANNELS
from flexarm.view.plot.drawn_result import signals_of


@pytest.fixture(autouse=True)
def _no_open_figures_remain():
    yield
    plt.close("all")


def drawn(axes):
    """Return values of the lines that have points, (T, lines)."""
    return np.array([line.get_ydata() for line in axes.get_lines() if len(line.get_xdata()) > 2]).T


def legend(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_history_shows_a_channel_with_its_unit():
    axes = fa.plot.history(result(), "link_tip_deflection")
    assert np.array_equal(drawn(axes), 1e3 * result().link_tip_deflection)
    assert np.array_equal(axes.get_lines()[0].get_xdata(), result().time)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "deflection [mm]")
    assert legend(axes) == ["link 1", "link 2"]


def test_list_of_channels_has_a_panel_each():
    above, below = fa.plot.history(result(), ["torque", "tip[y]"])
    assert np.array_equal(drawn(above), result().torque)
    assert np.array_equal(drawn(below)[:, 0], result().tip.sel(axis="y"))
    assert below.get_ylabel() == "position [m]"
    usual = fa.plot.history(result())
    assert [axes.get_title("left") for axes in usual] == [
        "Joint angle",
        "Link tip deflection",
        "Torque",
    ]


def test_unit_of_the_axis_is_that_of_the_channel_table():
    for name, channel in CHANNELS.items():
        if name in result():
            signals = signals_of("channel", result(), name)
            scale = {"mm": 1e3, "µm/m": 1e6}.get(signals.unit, 1.0)
            flat = result()[name].values.reshape(len(result().time), -1)
            assert np.array_equal(signals.values, scale * flat)
            if scale == 1.0:
                assert signals.unit == channel.unit
            for label, key in zip(signals.labels, signals.keys, strict=True):
                part = signals_of("channel", result(), f"{name}[{key}]")
                assert part.labels == (label,)


def test_plots_use_given_axes_and_their_settings():
    figure, (left, right) = plt.subplots(1, 2)
    assert fa.plot.history(result(), "torque", axes=left) is left
    assert fa.plot.phase_portrait(result(), axes=right) is right
    assert left.figure is figure
    assert plt.get_fignums() == [figure.number]
    assert left.xaxis.label.get_family() == plt.rcParams["font.family"]


def test_two_calls_share_axes_and_keep_all_names():
    axes = fa.plot.history(result(), "torque[1]")
    fa.plot.history(result(), "torque[2]", axes=axes)
    assert legend(axes) == ["joint 1", "joint 2"]


def test_new_figure_belongs_to_pyplot_and_changes_no_settings():
    before = dict(plt.rcParams)
    axes = fa.plot.history(result(), "torque")
    assert plt.gcf() is axes.figure
    assert dict(plt.rcParams) == before
    with fa.plot.styled("screen"):
        assert plt.rcParams["font.family"] == ["DejaVu Sans"]
        screen = fa.plot.history(result(), "torque")
    assert axes.xaxis.label.get_family() == ["STIXGeneral"]
    assert screen.xaxis.label.get_family() == ["DejaVu Sans"]
    assert dict(plt.rcParams) == before


def test_results_differ_in_colour_and_their_parts_in_dashes():
    axes = fa.plot.compare({"flexible": result(), "rigid": rigid_result()}, "joint_angle")
    expected = np.concatenate([result().joint_angle, rigid_result().joint_angle], axis=1)
    assert np.array_equal(drawn(axes), expected)
    first, second, third, _ = axes.get_lines()
    assert first.get_color() == second.get_color() != third.get_color()
    assert first.get_linestyle() == third.get_linestyle() != second.get_linestyle()
    assert legend(axes) == ["flexible", "rigid", "joint 1", "joint 2"]
    one = fa.plot.compare([result(), result()], "tip[x]")
    assert legend(one) == ["1", "2"]


def test_small_and_large_values_are_compared_in_one_unit():
    large = result().assign(torque=1e5 * result().torque)
    axes = fa.plot.compare({"small": result(), "large": large}, "torque[1]")
    torque = result().torque.sel(joint=1).values
    np.testing.assert_allclose(drawn(axes), np.stack([1e-3 * torque, 1e2 * torque], axis=1))
    assert np.array_equal(axes.get_lines()[1].get_xdata(), result().time)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "torque [kN m]")


@pytest.mark.parametrize(
    ("channel", "rate", "scale"),
    [
        ("link_angle[2]", "link_rate", 1.0),
        ("link_tip_deflection[1]", "link_tip_deflection_rate", 1e3),
        ("link_tip_slope[1]", "link_tip_slope_rate", 1.0),
        ("tip[y]", "tip_velocity", 1.0),
        ("tip_angle", "tip_angle_rate", 1.0),
    ],
)
def test_rate_of_a_phase_portrait_is_that_of_the_channel(channel, rate, scale):
    axes = fa.plot.phase_portrait(result(), channel)
    (line,) = [line for line in axes.get_lines() if len(line.get_xdata()) > 2]
    name, _, part = channel.rstrip("]").partition("[")
    column = {"": 0, "1": 0, "2": 1, "y": 1}[part]
    values, rates = (
        result()[each].values.reshape(len(result().time), -1)[:, column] for each in (name, rate)
    )
    np.testing.assert_array_equal(line.get_xdata(), scale * values)
    np.testing.assert_array_equal(line.get_ydata(), rates)
    start, end = [line for line in axes.get_lines() if len(line.get_xdata()) == 1]
    assert (start.get_xdata()[0], start.get_ydata()[0]) == (scale * values[0], rates[0])
    assert (end.get_xdata()[0], end.get_ydata()[0]) == (scale * values[-1], rates[-1])
    assert start.get_markerfacecolor() == "white" != end.get_markerfacecolor()


def test_phase_portrait_has_the_rate_on_the_vertical_axis():
    axes = fa.plot.phase_portrait(result(), "joint_angle[2]")
    (line,) = [line for line in axes.get_lines() if len(line.get_xdata()) > 2]
    assert np.array_equal(line.get_xdata(), result().joint_angle.sel(joint=2))
    assert np.array_equal(line.get_ydata(), result().joint_rate.sel(joint=2))
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("angle [rad]", "rate [rad/s]")


def test_readings_of_instruments_are_channels_at_their_own_times():
    instruments = [fa.Instrument("joint_angle"), fa.Instrument("joint_rate")]
    run = fa.simulate(
        arm(),
        0.05,
        controller=fa.JointPD([0.8, 0.3], [0.08, 0.03], sample_time=0.001),
        reference=fa.joint_motion(arm(), [0.1, 0.3], [0.2, 0.4], 0.1),
        hardware=fa.Hardware(instruments=instruments),
        rate=400.0,
    )
    axes = fa.plot.history(run, "measured_joint_angle")
    assert np.array_equal(axes.get_lines()[0].get_xdata(), run.tick_time)
    assert np.array_equal(drawn(axes), run.measured_joint_angle)
    assert axes.get_ylabel() == "angle [rad]"


@pytest.mark.thorough
def test_plotly_draws_the_same_lines():
    pytest.importorskip("plotly")
    figure = fa.plot.history(result(), ["torque", "tip"], backend="plotly")
    lines = np.array([trace.y for trace in figure.data]).T
    assert np.array_equal(lines, np.concatenate([result().torque, result().tip], axis=1))
    assert all(np.array_equal(trace.x, result().time) for trace in figure.data)
    assert [trace.name for trace in figure.data] == ["joint 1", "joint 2", "x", "y"]
    assert figure.layout.yaxis.title.text == "torque [N m]"
    assert figure.layout.yaxis2.title.text == "position [m]"
    assert figure.layout.xaxis2.title.text == "time [s]"
    phase = fa.plot.phase_portrait(result(), backend="plotly")
    assert np.array_equal(phase.data[1].x, result().joint_angle.sel(joint=2))
    assert np.array_equal(phase.data[1].y, result().joint_rate.sel(joint=2))
    assert np.array_equal(phase.data[1].customdata, result().time)
    start, end = phase.data[2:]
    assert np.array_equal([start.x, end.x], result().joint_angle[[0, -1]])
    assert np.array_equal([start.y, end.y], result().joint_rate[[0, -1]])
    assert phase.layout.xaxis.title.text == "angle [rad]"
    assert phase.layout.yaxis.title.text == "rate [rad/s]"


def test_without_plotly_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly", None)
    with pytest.raises(fa.InputError, match=r"flexarm\[plots\]"):
        fa.plot.history(result(), backend="plotly")
