"""The paper's figures show the runs, with the rigid arm dashed, and change no settings."""

import io

import matplotlib
import numpy as np
import pytest

from flexarm.view.paper import POSTURES, PaperCase, histories
from flexarm.view.plot.paper.paper_data import FIGURE_NAMES, HISTORY_NAMES, PANELS
from flexarm.view.plot.paper.paper_figures import FIGURES


@pytest.fixture(scope="module")
def case():
    return PaperCase(2.0)


@pytest.fixture(scope="module")
def slow(case):
    return histories(case)


@pytest.fixture(scope="module")
def fast():
    return histories(PaperCase(1.0), ("flexible", "rigid", "second_order"))


def lines(axes):
    """Return lines that have points, without the mark at the end of the torques."""
    return [line for line in axes.get_lines() if len(line.get_xdata()) > 2]


def saved(figure, form):
    stream = io.BytesIO()
    figure.savefig(stream, format=form)
    return stream.getvalue()


def test_every_figure_of_the_paper_from_3_to_16_exists():
    numbers = [int(name[3:5]) for name in FIGURE_NAMES]
    assert numbers == list(range(3, 17))
    assert [panel.figure for panel in PANELS] == list(range(5, 17))
    assert set(FIGURE_NAMES) < set(FIGURES)


@pytest.mark.parametrize("name", HISTORY_NAMES)
def test_history_shows_the_flexible_arm_and_the_rigid_arm_dashed(name, case, slow):
    panel = HISTORY_NAMES[name]
    axes = FIGURES[name](slow).axes[0]
    flexible, rigid = lines(axes)
    for line, result in ((flexible, case.flexible), (rigid, case.rigid)):
        assert np.array_equal(line.get_xdata(), result["time"])
        expected = panel.scale * result[panel.channel].isel(link=panel.link)
        assert np.array_equal(line.get_ydata(), expected)
    assert rigid.is_dashed()
    assert not flexible.is_dashed()
    assert flexible.get_color() != rigid.get_color()
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["flexible", "rigid", "end of torques"]
    title = axes.get_title(loc="left")
    assert title.startswith(f"Fig. {panel.figure}   {panel.title}")
    assert title.endswith("relative to root tangent") == panel.channel.startswith("link_tip")


@pytest.mark.parametrize("name", ["fig05_link1_angle", "fig07_link2_angle"])
def test_angle_has_its_difference_from_the_rigid_arm_below(name, case, slow):
    _, below = FIGURES[name](slow).axes
    (line,) = lines(below)
    angle = [
        result["link_angle"][:, HISTORY_NAMES[name].link] for result in (case.flexible, case.rigid)
    ]
    np.testing.assert_allclose(line.get_ydata(), 1e3 * (angle[0] - angle[1]), rtol=0, atol=1e-12)
    assert below.get_ylabel() == "difference [mrad]"


def test_figure_3_has_the_distance_between_the_tips_as_an_inset(case, slow):
    (inset,) = FIGURES["fig03_path"](slow).axes[0].child_axes
    (line,) = lines(inset)
    away = np.linalg.norm((case.flexible["tip"] - case.rigid["tip"]).values, axis=1)
    np.testing.assert_allclose(line.get_ydata(), 1e3 * away, rtol=1e-12)


def test_rigid_arm_is_the_zero_line_of_deflections(slow):
    for name, panel in HISTORY_NAMES.items():
        if panel.channel.startswith("link_tip"):
            _, rigid = lines(FIGURES[name](slow).axes[0])
            assert not np.any(rigid.get_ydata())


@pytest.mark.parametrize("name", HISTORY_NAMES)
def test_unit_of_an_axis_suits_its_scale(name, slow):
    panel = HISTORY_NAMES[name]
    axes = FIGURES[name](slow).axes[-1]
    unit = axes.get_ylabel().split("[")[1].rstrip("]")
    scale = panel.scale if panel.channel != "link_angle" else 1e3  # the difference, in mrad
    assert unit.startswith("m") == (scale == 1e3)
    assert axes.get_xlabel() == "time [s]"


def test_figure_3_shows_ten_bent_and_ten_straight_postures(case, slow):
    (axes,) = FIGURES["fig03_path"](slow).axes
    links = [line for line in lines(axes) if len(line.get_xdata()) == 50]
    bent = [line for line in links if not line.is_dashed()]
    straight = [line for line in links if line.is_dashed()]
    assert len(bent) == len(straight) == POSTURES == 10
    first, last = straight[0].get_xydata(), straight[-1].get_xydata()
    # The tip of the rigid arm is on the line of the scenario; 1e-6 m: its tolerance.
    assert np.allclose(first[[0, -1]], [[0.0, 0.0], [2.0, 1.0]], atol=1e-6)
    assert np.allclose(last[[0, -1]], [[0.0, 0.0], [1.0, 2.0]], atol=1e-6)
    assert axes.get_aspect() == 1.0
    # A straight link's middle lies on its chord; that of a bent one has a distance of about a fifth
    # of the tip deflection (the first mode's shape), 17 mm at the third posture.
    middle, root, tip = bent[2].get_xydata()[[12, 0, 24]]
    chord = (tip - root) / np.linalg.norm(tip - root)
    off = abs(chord[0] * (middle - root)[1] - chord[1] * (middle - root)[0])
    deflection = abs(case.flexible["link_tip_deflection"].sel(time=4 / 9, method="nearest")[0])
    assert 0.1 * deflection < off < 0.3 * deflection


def test_figure_4_shows_the_torques_of_both_joints(case, slow):
    (axes,) = FIGURES["fig04_torques"](slow).axes
    for line, joint in zip(lines(axes), (1, 2), strict=True):
        assert np.array_equal(line.get_ydata(), case.flexible["torque"].sel(joint=joint))


def test_both_theories_and_their_difference_are_drawn(fast):
    above, below = FIGURES["theories"](fast).axes
    linear, second, rigid = (line.get_ydata() for line in lines(above))
    (difference,) = (line.get_ydata() for line in lines(below))
    assert np.array_equal(linear - second, difference)
    assert not np.any(rigid)
    assert np.max(np.abs(difference)) > 1.0  # mm: visible


def test_overview_has_all_figures(slow):
    titles = [axes.get_title(loc="left") for axes in FIGURES["overview"](slow).axes]
    assert [int(title.split()[1]) for title in titles] == list(range(3, 17))


def test_fonts_in_pdf_are_accepted_by_journals(slow):
    assert b"/Type3" not in saved(FIGURES["fig09_link1_tip_deflection"](slow), "pdf")


@pytest.mark.parametrize("form", ["png", "pdf", "svg"])
def test_equal_figures_give_equal_files(form, slow):
    first, second = (saved(FIGURES["fig09_link1_tip_deflection"](slow), form) for _ in range(2))
    assert len(first) > 10_000
    if form != "svg":  # Matplotlib numbers the parts of an SVG at random
        assert first == second


def test_bitmaps_have_the_resolution_of_print(slow):
    data = saved(FIGURES["fig09_link1_tip_deflection"](slow), "png")
    width, height = (int.from_bytes(data[k : k + 4], "big") for k in (16, 20))
    assert (width, height) == (800, 520)  # 4 by 2.6 inches at 200 dots per inch


def test_settings_of_the_user_are_unchanged(slow):
    with matplotlib.rc_context({"font.size": 17.0, "axes.grid": False}):
        before = dict(matplotlib.rcParams)
        saved(FIGURES["fig09_link1_tip_deflection"](slow), "png")
        assert dict(matplotlib.rcParams) == before
