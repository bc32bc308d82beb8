"""The page of a report has the numbers, texts and settings of its result."""

from __future__ import annotations

import contextlib
import html
import json
import re
import sys
from functools import cache
from importlib.metadata import version

import numpy as np
import pytest

import flexarm as fa
from flexarm.simulation.calls.metrics import metrics_of
from flexarm.view.plot.drawn_result import Signals
from flexarm.view.reporting import (
    clock,
    energies,
    errors_table,
    extremes_table,
    few_lines,
    fitted,
    key_figures,
    panels,
    run_facts,
)

LINK = {"length": 0.5, "flexural_rigidity": 30.0, "mass_per_length": 0.4, "elements": 1}
#: The documented limit of a report's size.
MOST_BYTES = 5_000_000


@cache
def arm():
    gauge = {"station": 0.1, "distance": 0.002}
    return fa.Arm(links=[{**LINK, "gauges": [gauge]}, LINK], gravity=(0.0, -9.81))


@cache
def motion():
    return fa.joint_motion(arm(), [0.3, 0.6], [0.5, 0.2], 0.15)


@cache
def controlled():
    """Simulate 0.2 s with a controller, 0.05 s longer than its motion."""
    controller = fa.JointPD([2.0, 0.5], [0.02, 0.005], sample_time=0.005)
    return fa.simulate(arm(), 0.2, controller=controller, reference=motion(), rate=500.0)


def scenario_result(tmp_path):
    fa.save_arm(arm(), tmp_path / "arm.yaml")
    path = tmp_path / "run.yaml"
    path.write_text(
        "flexarm: 1\narm: arm.yaml\n"
        "motion: {kind: joint, start: [0.3, 0.6], end: [0.5, 0.2], duration: 0.15}\n"
        "drive: {kind: rigid_inverse_dynamics}\n"
        "run: {duration: 0.2, rate: 500}\n"
    )
    return fa.run_scenario(path)


def scene_of(page):
    (data,) = re.findall(r'class="flexarm-data">(.*?)</script>', page, flags=re.DOTALL)
    (scene,) = json.loads(data)["scenes"]
    return scene


def words_of(page):
    """Return the text of a page without the player."""
    page = re.sub(r"<(script|style).*?</\1>", "", page, flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]*>", " ", page))


@pytest.mark.thorough
def test_report_of_a_file_equals_that_of_its_result(tmp_path):
    result = scenario_result(tmp_path)
    fa.write_result(result, tmp_path / "run.nc")
    page = fa.report(fa.read_result(tmp_path / "run.nc"), tmp_path / "run.html", title="A run")
    assert page == fa.report(result, title="A run")
    assert (tmp_path / "run.html").read_text(encoding="utf-8") == page
    words = words_of(page)
    assert result.attrs["scenario"] in words
    assert "arm.yaml" not in words  # the scenario contains the arm
    for text in ("joints, in 0.15 s", "rigid inverse dynamics", "No warnings.", "tip error"):
        assert text in words


def test_report_has_settings_versions_and_citations():
    attributes = controlled().attrs
    words = words_of(fa.report(controlled()))
    for name in ("flexarm_version", "software", "integrator", "integrator_reason", "arm"):
        assert str(attributes[name]) in words, name
    assert fa.citation(controlled()) in words
    assert f"evaluations {attributes['evaluations']}" in " ".join(words.split())
    assert "JointPD" in words
    assert "0.005 s" in words
    assert "for each of 40 samples" in words
    assert attributes["software"].startswith(f"Python {sys.version_info[0]}.{sys.version_info[1]}")
    for name in ("numpy", "scipy", "numba"):
        assert f"{name} {version(name)}" in attributes["software"]


def test_report_has_every_warning_and_the_failure():
    reported = controlled().copy()
    texts = {"warning": "bent far", "unstable_loop": "it grows", "failure": "stopped at 0.2 s"}
    reported.attrs = {**controlled().attrs, **texts, "estimator_consistent": 0}
    words = words_of(fa.report(reported))
    for text in (*texts.values(), "the estimator is inconsistent"):
        assert text in words
    assert "No warnings." not in words


def test_histories_equal_those_of_the_result():
    page = fa.report(controlled(), reference=motion())
    titles = [history["title"] for history in scene_of(page)["histories"]]
    assert titles[:3] == ["Joint angle", "Link tip deflection", "Torque"]
    assert set(titles[3:]) == {
        "Joint rate", "Tip", "Torque command", "Strain", "Energy", "Tip error",
    }  # fmt: skip
    torque = scene_of(page)["histories"][2]
    np.testing.assert_allclose(np.array(torque["lines"]).T, controlled().torque, atol=1e-4)
    chosen = fa.report(controlled(), channels=["tip[y]", "torque"])
    assert [history["title"] for history in scene_of(chosen)["histories"]] == ["Tip", "Torque"]


def test_magnified_bending_is_stated():
    assert "is drawn 20 times as large" in words_of(fa.report(controlled(), magnify=20.0))
    assert "times as large" not in words_of(fa.report(controlled(), magnify=1.0))
    chosen = scene_of(fa.report(controlled()))["magnify"]
    assert f"is drawn {chosen:g} times as large" in words_of(fa.report(controlled()))


def test_extreme_values():
    time = np.array([0.0, 0.1, 0.2])
    values = np.array([[0.0, 1.0], [-3.0, np.nan], [1.5, 2.0]])
    table = extremes_table([Signals("torque", time, values, "N m", ("joint 1", "joint 2"), "12")])
    assert table.rows == (
        ("Torque, joint 1 [N m]", "-3", "1.5", "0.1", "1.5"),
        ("Torque, joint 2 [N m]", "1", "2", "0.2", "2"),
    )


def test_errors_from_the_reference():
    result = controlled()
    table = errors_table(result, arm(), motion())
    rows = dict(table.rows)
    rigid_counterpart = arm().rigid()
    goal = rigid_counterpart.tip(rigid_counterpart.rest([0.5, 0.2]))[:2]
    missed = np.hypot(*(result.tip.values[-1] - goal))
    assert float(rows["Tip error at the end [mm]"]) == pytest.approx(1e3 * missed, rel=1e-4)
    metrics = metrics_of(result, arm(), motion())
    peak = 1e3 * metrics["tip_error_peak"]
    assert float(rows["Tip error peak [mm]"]) == pytest.approx(peak, rel=1e-4)
    assert "the rigid arm" in table.notes["Joint 1: error at the end [rad]"]
    off = result.joint_angle.values[-1] - [0.5, 0.2]
    for joint in (1, 2):
        found = float(rows[f"Joint {joint}: error at the end [rad]"])
        assert found == pytest.approx(off[joint - 1], rel=1e-4)
    figures = {name: (value, unit) for name, value, unit in key_figures(result, arm(), motion())}
    assert float(figures["tip error at the end"][0]) == pytest.approx(1e3 * missed, rel=1e-4)
    peak = 1e3 * float(abs(result.link_tip_deflection).max())
    assert float(figures["peak tip deflection of a link"][0]) == pytest.approx(peak, rel=1e-4)


def test_energies_and_their_sum():
    parts = energies(controlled())
    assert list(parts) == ["kinetic", "strain", "gravity", "sum"]
    np.testing.assert_allclose(parts["sum"], sum(parts[name] for name in list(parts)[:3]))
    assert np.array_equal(parts["gravity"], controlled().gravity_energy)


def test_many_lines_are_thinned_to_include_first_and_last():
    labels = tuple(map(str, range(64)))
    many = Signals("torque", np.arange(3.0), np.ones((3, 64)) * range(64), "N m", labels, labels)
    few = few_lines(many)
    assert len(few.labels) == 12
    assert (few.labels[0], few.labels[-1]) == ("0", "63")
    assert np.array_equal(few.values[0], [float(label) for label in few.labels])


@pytest.mark.thorough
def test_page_of_a_long_run_is_small_and_keeps_its_peaks():
    short, count = controlled(), 100_001
    time = np.linspace(0.0, 0.2, count)
    result = short.interp(time=time)
    result = result.assign_coords(time=np.linspace(0.0, 3000.0, count)).assign_attrs(short.attrs)
    noise = np.random.default_rng(1)
    for name in ("joint_angle", "joint_rate", "torque", "tip", "strain", "torque_command"):
        result[name] += noise.normal(size=result[name].shape)
    result["torque"][34_567, 0] = 99.0
    result.attrs["arm"] += "# " + "é" * 1_000_000 + "\n"
    histories = fitted(panels(result, arm(), None, None))
    assert max(each.values[:, 0].max() for each in histories if each.name == "torque") == 99.0
    page = fa.report(result)
    assert len(page.encode()) < MOST_BYTES
    assert "more characters, in the result" in page


@pytest.mark.parametrize(
    ("duration", "speed", "plays"), [(0.004, 0.002, 2.0), (1.0, 1.0, 1.0), (300.0, 5.0, 60.0)]
)
def test_animation_of_a_short_run_lasts_for_seconds(duration, speed, plays):
    result = controlled().assign_coords(time=np.linspace(0.0, duration, controlled().time.size))
    times, fps, found = clock(result, 2)
    assert found == pytest.approx(speed)
    assert (len(times) - 1) / fps == pytest.approx(plays)
    assert times[-1] == duration
    assert 24.0 < fps <= 30.0  # long runs have fewer frames, so that the page is small


def test_report_of_one_sample_and_of_a_run_without_torque():
    one = controlled().isel(time=[0])
    assert scene_of(fa.report(one))["times"] == [0.0]
    bare = controlled()[["q", "joint_angle", "tip"]]
    assert [h["title"] for h in scene_of(fa.report(bare))["histories"]] == ["Joint angle", "Tip"]


def test_without_jinja_the_message_names_the_package(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(fa.InputError, match=r"pip install 'flexarm\[report\]'"):
        fa.report(controlled(), tmp_path / "new" / "report.html")
    assert not list(tmp_path.iterdir())


def test_full_disk_keeps_the_older_file(tmp_path, monkeypatch):
    path = tmp_path / "report.html"
    path.write_text("older")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("flexarm.base.writing.places.replace_file", full)
    with pytest.raises(fa.InputError, match="No space left on device"):
        fa.report(controlled(), path)
    assert path.read_text() == "older"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"path": "report.pdf"}, r"path must end in \.html"),
        ({"title": 1}, "title must be text"),
        ({"notes": None}, "notes must be text"),
        ({"channels": "torqe"}, "Did you mean 'torque'?"),
        ({"magnify": -1.0}, "at least 0"),
        ({"magnify": "large"}, "magnify must be a number or 'auto', got 'large'"),
        ({"rigid": 1}, "rigid must be True, False or a result"),
        ({"reference": 1}, "reference"),
        ({"contacts": [1]}, "list of Contact"),
        ({"result": fa}, "result must be"),
    ],
)
def test_wrong_input_has_one_clear_message(options, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(fa.InputError, match=words) as caught:
        fa.report(**{"result": controlled(), **options})
    assert len(caught.value.problems) == 1
    assert str(caught.value).startswith("report: ")
    assert not list(tmp_path.iterdir())


EDITED = {
    "text": "abc",
    "nothing": None,
    "no number": np.nan,
    "list": np.array([1.0, 2.0]),
    "bytes": b"x",
    "object": object(),
}


@pytest.mark.thorough
@pytest.mark.parametrize("value", EDITED)
def test_edited_attributes_are_shown_or_named(value):
    """Another program, or the user, may have replaced any attribute of a result."""
    shown = 0
    for name in controlled().attrs:
        result = controlled().copy()
        result.attrs = {**controlled().attrs, name: EDITED[value]}
        with contextlib.suppress(fa.InputError):
            shown += "</html>" in fa.report(result)
    assert shown >= len(controlled().attrs) - 5


def test_a_text_in_place_of_a_tolerance_is_shown():
    result = controlled().assign_attrs(rtol="tight")
    assert ("tolerances", f"'tight' relative, {result.atol:g} m") in run_facts(result)


def test_attributes_that_no_file_can_store_are_named(tmp_path):
    result = controlled().assign_attrs(remark=None)
    with pytest.raises(fa.InputError, match=r"result cannot be stored: .*remark"):
        fa.write_result(result, tmp_path / "run.nc")
    assert list(tmp_path.iterdir()) == []


def test_tables_with_text_in_place_of_numbers_are_named():
    options = {"controllers": {"pd": fa.JointPD([2.0, 0.5], [0.02, 0.005], sample_time=0.005)}}
    table = fa.compare(arm(), **options, duration=0.05, references={"move": motion()})
    changed = table.assign(torque_rms=table["torque_rms"].astype(str))
    for draw in (fa.plot.comparison_figure, fa.plot.study):
        with pytest.raises(fa.InputError, match="other values than numbers in 'torque_rms'"):
            draw(changed)
