"""Plots of mode shapes, frequency lines and responses show the computed values."""

import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.vibration import modes_figure, response_figure, tracks_figure

# Links bend further than their theory allows, on purpose.
pytestmark = pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")

LINK = fa.Link(
    length=0.5,
    flexural_rigidity=3.0,
    mass_per_length=0.4,
    elements=2,
    damping={"kind": "modal", "ratio": 0.01},
)
ARM = fa.Arm(links=[LINK, LINK], theory="second_order")


def test_mode_shapes_equal_their_curves():
    found = fa.modes(ARM, [0.2, 0.5])
    figure = modes_figure(found, 4)
    assert len(figure.axes) == 4
    title = figure.axes[0].get_title(loc="left")
    assert title == f"1: {found.frequency_hz[0]:.4g} Hz, {100 * found.damping_ratio[0]:.2g} %"
    rest, curve = (line.get_xydata() for line in figure.axes[1].get_lines()[:2])
    np.testing.assert_allclose(rest, ARM.shape(found.q)[0])
    away = np.linalg.norm(found.curves(amplitude=0.12)[1] - ARM.shape(found.q), axis=-1)
    np.testing.assert_allclose(np.linalg.norm(curve - rest, axis=1), away[0], atol=1e-12)
    other = figure.axes[1].get_lines()[2].get_xydata()
    np.testing.assert_allclose(0.5 * (curve + other), rest, atol=1e-12)
    assert (figure.axes[1].get_xlabel(), figure.axes[1].get_ylabel()) == ("x [m]", "y [m]")
    free = modes_figure(fa.modes(ARM, joints="free"), 2)
    assert free.axes[0].get_title(loc="left") == "1: does not vibrate"


def test_frequency_lines_equal_the_tracked_modes():
    tracks = fa.campbell(ARM, np.linspace(0.0, 60.0, 5), count=2)
    above, below = tracks_figure(tracks).axes
    np.testing.assert_array_equal(above.get_lines()[0].get_ydata(), tracks.frequency_hz[:, 0])
    np.testing.assert_array_equal(
        below.get_lines()[1].get_ydata(), 100 * tracks.damping_ratio[:, 1]
    )
    assert above.get_xlabel() == "spin [rad/s]"
    assert above.get_ylabel() == "frequency [Hz]"
    assert below.get_ylabel() == "damping ratio [%]"
    for line in above.get_lines():
        np.testing.assert_array_equal(line.get_xdata(), tracks.parameter)
    names = [text.get_text() for text in above.get_legend().get_texts()]
    assert names == ["mode 1", "mode 2"]
    once = above.get_lines()[2]  # once in each revolution
    np.testing.assert_allclose(once.get_ydata(), tracks.parameter / (2 * np.pi))
    assert above.texts[0].get_text() == "1×"
    over = fa.plot.campbell(fa.track_modes(ARM, [[0.2, 0.5], [0.2, 0.9]], count=2))
    assert len(over.get_lines()) == 2  # orders belong to a spin rate only


def test_responses_equal_gain_and_phase(monkeypatch):
    # python-control evaluates by NumPy then; slycot has fewer correct digits.
    monkeypatch.setitem(sys.modules, "slycot", None)
    model = fa.linearize(ARM, fa.equilibrium(ARM, [0.2, 0.5]), outputs=["tip", "joint_angle"])
    omega = np.array([1.0, 30.0])
    figure = response_figure(model, omega)
    gain, phase = figure.axes[2:4]
    system = model.to_control()
    expected = [system["tip[y]", "torque[1]"](1j * w) for w in omega]
    assert gain.get_lines()[0].get_ydata() == pytest.approx(np.abs(expected), rel=1e-9)
    turned = phase.get_lines()[0].get_ydata() - np.degrees(np.angle(expected))
    assert turned / 360.0 == pytest.approx(np.round(turned / 360.0), abs=1e-9)
    assert gain.get_ylabel() == "tip[y]\n[m / (N m)]"
    assert phase.get_ylabel() == "phase [°]"
    assert phase.get_xlabel() == ""
    assert figure.axes[-1].get_xlabel() == "frequency [Hz]"
    assert len(response_figure(model).axes) == 8


def test_responses_are_interrupted_at_undamped_resonances():
    """One grid point is the resonance, where the gain is infinite."""
    bare = LINK.replace(damping=None)
    model = fa.linearize(fa.Arm(links=[bare]), outputs="joint_angle")
    gain, phase = response_figure(model).axes
    values = gain.get_lines()[0].get_ydata()
    assert 1 <= np.isnan(values).sum() <= model.poles.size // 2
    assert np.array_equal(np.isnan(values), np.isnan(phase.get_lines()[0].get_ydata()))
    # Undamped: in phase or opposed, and beside a resonance once each.
    degrees = phase.get_lines()[0].get_ydata()
    assert set(np.round(degrees[np.isfinite(degrees)])) == {-180.0, 0.0}
    at_rest = response_figure(model, np.array([0.0, 1.0])).axes[0].get_lines()[0].get_ydata()
    assert np.isnan(at_rest[0])  # a free joint under a constant torque turns without limit
    assert np.isfinite(at_rest[1])


def test_resonances_moved_by_rounding_are_interrupted():
    bare = LINK.replace(damping=None, elements=1)
    model = fa.linearize(fa.Arm(links=[bare] * 6, gravity=(9.81, 0.0)), outputs="tip_angle")
    gain = response_figure(model).axes[0]
    speed = np.unique(np.abs(model.poles.imag))
    line = gain.get_lines()[0]
    omega = 2.0 * np.pi * line.get_xdata()
    at = np.any(np.abs(omega[:, None] - speed) < 4e-5 * speed, axis=1)
    assert at.sum() >= 5
    assert np.isnan(line.get_ydata()[at]).all()
    assert gain.get_ylim()[1] < 1e6  # otherwise the peaks hide everything else


def test_each_input_of_a_response_has_its_name():
    model = fa.linearize(ARM, fa.equilibrium(ARM, [0.2, 0.5]), outputs=["tip"])
    omega = np.array([1.0, 30.0])
    gain, phase, *_ = response_figure(model, omega).axes
    response = model.frequency_response(omega)[:, 0]
    for k, line in enumerate(gain.get_lines()):
        assert line.get_label() == model.inputs[k] == f"torque[{k + 1}]"
        np.testing.assert_allclose(line.get_ydata(), np.abs(response[:, k]))
        np.testing.assert_allclose(line.get_xdata(), omega / (2.0 * np.pi))
        assert line.get_color() == phase.get_lines()[k].get_color()
    assert len(gain.get_legend().get_texts()) == 2


def test_constant_zero_output_is_noted():
    """The tip of a straight arm does not move along it."""
    figure = response_figure(fa.linearize(fa.Arm(links=[LINK, LINK]), outputs="tip"))
    along, _, across, _ = figure.axes
    assert [text.get_text() for text in along.texts] == ["zero: no input moves it here"]
    assert not across.texts
    assert along.get_xlim() == across.get_xlim()


def test_modes_frequencies_and_responses_are_drawn_into_given_axes():
    given = Figure().subplots(2, 2)
    found = fa.modes(ARM, [0.2, 0.5])
    panels = fa.plot.modes(found, 2, axes=given[0])
    assert list(panels) == list(given[0])
    curve = panels[1].get_lines()[1].get_xydata()
    np.testing.assert_allclose(curve, found.curves(amplitude=0.12)[1, 0], atol=1e-12)
    tracks = fa.campbell(ARM, np.linspace(0.0, 60.0, 3), count=2)
    axes = fa.plot.campbell(tracks, axes=given[1, 0])
    np.testing.assert_array_equal(axes.get_lines()[1].get_ydata(), tracks.frequency_hz[:, 1])
    model = fa.linearize(ARM, fa.equilibrium(ARM, [0.2, 0.5]), outputs=["tip_angle"])
    empty = Figure().subplots(2)
    pair = fa.plot.bode(model, [1.0, 30.0], axes=empty)
    assert pair.tolist() == [list(empty)]
    gain = pair[0, 0].get_lines()[0].get_ydata()
    assert gain == pytest.approx(np.abs(model.frequency_response([1.0, 30.0])[:, 0, 0]))
    with pytest.raises(fa.InputError, match="2 Matplotlib axes"):
        fa.plot.bode(model, [1.0, 30.0], axes=given[0, 0])


@pytest.fixture(scope="module")
def table():
    """Compare two drives on two plants along two motions; one of the runs fails."""
    there = fa.joint_motion(ARM, [0.2, 0.5], [0.25, 0.45], 0.05)
    back = fa.joint_motion(ARM, [0.2, 0.5], [0.15, 0.55], 0.05)
    drives = {
        "slow": fa.JointPD(0.05, 0.001, sample_time=0.001),
        "fast": fa.JointPD(0.1, 0.002, sample_time=0.001),
    }
    plants = {"bare": ARM, "loaded": fa.varied(ARM, flexural_rigidity_factor=0.7)}
    found = fa.compare(ARM, drives, 0.06, {"there": there, "back": back}, plants=plants)
    where = {"controller": "fast", "plant": "loaded", "reference": "back"}
    found["torque_rms"].loc[where] = np.nan
    found["failure"].loc[where] = "stopped"
    return found


def test_metrics_of_a_comparison_are_drawn_into_given_axes(table):
    with pytest.raises(fa.InputError, match="6 Matplotlib axes"):
        fa.plot.study(table, axes=Figure().subplots())
    figure = Figure()
    panels = fa.plot.study(table, axes=figure.subplots(2, 3))
    assert panels.shape == (2, 3)
    metrics = {
        "tip_error_rms": ("tip error, RMS [mm]", 1e3),
        "residual_vibration": ("residual vibration [mm]", 1e3),
        "torque_rms": ("torque, RMS [N m]", 1.0),
    }
    for row, reference in enumerate(("there", "back")):
        for panel, (name, (title, scale)) in zip(panels[row], metrics.items(), strict=True):
            assert panel.get_title().startswith(title)
            marks = {line.get_label(): line for line in panel.get_lines()}
            for plant in ("bare", "loaded"):
                values = table[name].sel(reference=reference, plant=plant).values
                np.testing.assert_allclose(marks[plant].get_xdata(), scale * values)
            assert marks["bare"].get_marker() != marks["loaded"].get_marker()
            crosses = [line for line in panel.get_lines() if line.get_marker() == "x"]
            assert len(crosses) == (reference == "back")
            assert all(cross.get_ydata()[0] == 1 for cross in crosses)  # the row of "fast"
    names = [label.get_text() for label in panels[0, 0].get_yticklabels()]
    assert names == ["slow", "fast"]
    assert panels[1, 0].get_title().endswith("along back")
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["bare", "loaded"]


def test_short_axes_of_a_comparison_have_few_labels(table):
    """Within less than a decade, labels at every half would cover each other."""
    close = table.copy(deep=True)
    close["torque_rms"][:] = np.linspace(1.8, 2.2, close["torque_rms"].size).reshape(2, 2, 2)
    panels = fa.plot.study(close, axes=Figure().subplots(2, 3))
    low, high = panels[0, 2].get_xlim()
    shown = [at for at in panels[0, 2].get_xticks() if low <= at <= high]
    assert 2 <= len(shown) <= 5
