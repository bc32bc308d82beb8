"""Postures, deflections and moments equal those of the result."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from plot_results import arm, result, rigid_result

import flexarm as fa


@pytest.fixture(autouse=True)
def _no_open_figures_remain():
    yield
    plt.close("all")


def curves(axes, points):
    """Return the lines with so many points."""
    return [line for line in axes.get_lines() if len(line.get_xdata()) == points]


def test_postures_are_the_shapes_at_evenly_spaced_times():
    axes = fa.plot.postures(result(), 3)
    lines = curves(axes, 50)
    assert len(lines) == 3
    for line, k in zip(lines, (0, 50, 100), strict=True):
        expected = arm().shape(result().q.values[k], 25).reshape(-1, 2)
        np.testing.assert_allclose(line.get_xydata(), expected, rtol=0.0, atol=1e-14)
    (path,) = curves(axes, 101)
    assert np.array_equal(path.get_xydata(), result().tip)
    assert axes.get_aspect() == 1.0


def legend(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_postures_change_from_light_to_dark_between_named_tips():
    axes = fa.plot.postures(result(), 3)
    brightness = [sum(to_rgb(line.get_color())) for line in curves(axes, 50)]
    assert brightness == sorted(brightness, reverse=True)
    assert brightness[0] > brightness[-1] + 0.5
    tips = {text.get_text(): text.xy for text in axes.texts}
    assert tips == {"start": tuple(result().tip.values[0]), "end": tuple(result().tip.values[-1])}
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
    assert legend(axes) == ["flexible", "tip"]
    assert legend(fa.plot.postures(result(), 3, rigid=True)) == ["rigid", "flexible", "tip"]


def test_rigid_counterpart_has_the_same_joint_angles():
    axes = fa.plot.postures(result(), 3, rigid=True)
    first = next(line for line in curves(axes, 50) if line.is_dashed())
    rigid_counterpart = arm().rigid()
    expected = rigid_counterpart.shape(
        rigid_counterpart.rest(result().joint_angle.values[0]), 25
    ).reshape(-1, 2)
    np.testing.assert_allclose(first.get_xydata(), expected, rtol=0.0, atol=1e-14)


def test_another_result_may_be_the_rigid_counterpart():
    axes = fa.plot.postures(result(), 2, rigid=rigid_result())
    last = [line for line in curves(axes, 50) if line.is_dashed()][-1]
    np.testing.assert_allclose(last.get_xydata()[-1], rigid_result().tip[-1], atol=1e-14)


def test_magnification_is_named_and_applies_to_the_path():
    axes = fa.plot.postures(result(), 2, magnify=20.0)
    last = curves(axes, 50)[-1].get_xydata()
    (path,) = [line for line in axes.get_lines() if line.get_label() == "tip"]
    np.testing.assert_allclose(path.get_xydata()[-1], last[-1], rtol=0.0, atol=1e-14)
    assert legend(axes) == ["bending × 20", "tip"]


def test_deflections_end_at_those_of_the_tips():
    axes = fa.plot.deflection(result(), 2)
    lines = curves(axes, 25)
    expected = 1e3 * result().link_tip_deflection.values[[0, 0, -1, -1], [0, 1, 0, 1]]
    ends = [line.get_ydata()[-1] for line in lines]
    np.testing.assert_allclose(ends, expected, rtol=0.0, atol=1e-10)
    assert axes.get_ylabel() == "deflection [mm]"
    assert axes.get_xlabel() == "distance from the base along the arm [m]"
    np.testing.assert_allclose(lines[1].get_xdata(), np.linspace(0.5, 1.0, 25))
    assert legend(axes) == ["range of the run", "0 s", "0.2 s"]
    for link, band in enumerate(axes.collections):
        y = band.get_paths()[0].vertices[:, 1]
        values = 1e3 * result().link_tip_deflection.values[:, link]
        assert y.max() == pytest.approx(max(values.max(), 0.0), abs=1e-9)
        assert y.min() == pytest.approx(min(values.min(), 0.0), abs=1e-9)


def test_envelope_of_the_bending_moment_and_its_peak():
    axes = fa.plot.bending_moment(result())
    moment = result().bending_moment.values
    high, low, *_ = curves(axes, 5)
    assert np.array_equal(high.get_ydata(), moment.max(axis=0)[0])
    assert np.array_equal(low.get_ydata(), moment.min(axis=0)[0])
    np.testing.assert_allclose(curves(axes, 5)[2].get_xdata(), np.linspace(0.5, 1.0, 5))
    assert (high.get_label(), low.get_label()) == ("largest", "smallest")
    assert axes.get_ylabel() == "moment [N m]"
    k, link, station = np.unravel_index(np.abs(moment).argmax(), moment.shape)
    place = 0.5 * (link + float(result().station[station]))
    peak, time = moment[k, link, station], float(result().time[k])
    (mark,) = [line for line in axes.get_lines() if line.get_marker() == "o"]
    assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (pytest.approx(place), peak)
    assert axes.texts[0].get_text() == f"{peak:.4g} N m at {time:.4g} s".replace("-", "−")
