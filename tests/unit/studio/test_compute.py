"""Contents of a studio window: the numbers of a direct run."""

import json

import numpy as np
import pytest

import flexarm as fa
from flexarm.view.studio import compute
from flexarm.view.studio.compute import Failure, Margins, Picture, Report, Request, parts_of
from flexarm.view.studio.presets import cards, paper_project
from flexarm.view.studio.state import open_bytes

from test_state import STUDY  # isort: skip


def test_picture_equals_that_of_a_run():
    project = paper_project()
    (picture,) = parts_of(Request(project))
    assert isinstance(picture, Picture)
    result = fa.run_scenario(project.scenario)
    scene = json.loads(picture.data)["scenes"][0]
    at = int(np.searchsorted(scene["times"], 2.0))
    shape = fa.Arm(project.record.arm).shape(
        result.q.interp(time=scene["times"][at]).values, len(scene["links"][at][0])
    )
    np.testing.assert_allclose(scene["links"][at], shape, atol=2e-4)  # digits of the page
    assert scene["ghost"] is not None
    names = [history["title"] for history in scene["histories"]]
    assert names == ["Joint angle", "Link tip deflection", "Torque", "Tip error"]
    assert picture.frequencies[0] == pytest.approx(1.3335, abs=1e-3)
    (margins,) = parts_of(Request(project, "margins"))
    assert margins == Margins((), "The drive has no feedback loop.")


def test_margins_equal_those_of_loop_margins():
    from flexarm.cases.scenario.scenario import prepare

    project = paper_project().edited(("drive", "kind"), "joint_pd")
    (margins,) = parts_of(Request(project, "margins"))
    prepared = prepare(project.scenario)
    angles = prepared.arm.joint_angles(prepared.options["initial"])
    table = fa.loop_margins(prepared.options["controller"], prepared.arm, angles)
    assert [row[0] for row in margins.rows] == ["joint 1", "joint 2"]
    for k, row in enumerate(margins.rows):
        degrees = np.degrees(table.phase_margin.values[0, 0, k])
        assert float(row[2]) == pytest.approx(degrees, rel=0.01)


def test_report_is_a_page():
    (part,) = parts_of(Request(paper_project(), "report"))
    assert isinstance(part, Report)
    assert part.text.startswith("<!DOCTYPE html>") or "<!DOCTYPE html>" in part.text[:200]


def test_wrong_scenario_names_the_value():
    project = paper_project().edited(("motion", "end", 0), 5.0)
    (failure,) = parts_of(Request(project))
    assert isinstance(failure, Failure)
    ((name, text),) = failure.problems
    assert name == "motion.end"
    assert text.startswith("motion.end must lie within the reach")


@pytest.mark.thorough
def test_failed_run_gives_its_reason():
    project = paper_project().edited(("drive", "kind"), "joint_pd")
    project = project.edited(("drive", "derivative", 1), 1000.0)
    (failure,) = parts_of(Request(project))
    assert failure.problems[0][1].startswith("stopped at t = ")


def test_plant_of_a_study_is_simulated():
    from flexarm.cases.scenario.study import PreparedStudy

    project = open_bytes(STUDY.encode(), "study.yaml")
    study = PreparedStudy(project.record)
    ends = []
    for plant in ("as believed", "heavier"):
        picture = next(parts_of(Request(project.chosen(plant=plant))))
        ends.append(json.loads(picture.data)["scenes"][0]["path"][-1])
        expected, _ = study.one("torque alone", plant, "slow")
        np.testing.assert_allclose(ends[-1], expected.tip[-1], atol=2e-4)
    assert np.abs(np.subtract(*ends)).max() > 0.02


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("drive", "derivative", 0), 0.4),
        (("drive", "kind"), "computed_torque"),
        (("drive", "kind"), "rigid_inverse_dynamics"),
        (("motion", "duration"), 1.5),
        (("run", "duration"), 2.5),
        (("arm", "payload", "mass"), 0.3),
    ],
)
def test_a_scenario_is_prepared_as_without_those_before(path, value):
    """Arm, motion and reference are those of an earlier scenario only where they are equal."""
    first = paper_project().edited(("drive", "kind"), "joint_pd")
    compute._prepared(first)
    later = compute._prepared(first.edited(path, value))[0]
    compute._prepared.cache_clear()
    compute._RECENT.clear()
    alone = compute._prepared(first.edited(path, value))[0]
    assert later.text == alone.text
    assert later.arm.spec == alone.arm.spec
    assert later.followed.kind == alone.followed.kind
    np.testing.assert_array_equal(later.options["initial"], alone.options["initial"])
    times = np.linspace(0.0, 2.0, 9)
    angles = [each.followed.motion.joint_angle(times) for each in (later, alone)]
    np.testing.assert_array_equal(*angles)


PREVIEWED = ("Arm of the paper", "Whip", "Chain of ten links")


@pytest.mark.parametrize("title", PREVIEWED)
def test_preview_is_coarser_and_within_two_pixels_of_the_picture(title):
    (project,) = [make() for name, _, make in cards() if name == title]
    picture, preview = (
        next(parts_of(Request(project, purpose))) for purpose in ("picture", "preview")
    )
    assert preview.frequencies == picture.frequencies
    assert preview.warnings == ()
    whole, coarse = (json.loads(part.data)["scenes"][0] for part in (picture, preview))
    assert len(coarse["histories"][0]["time"]) <= 301
    width = whole["view"][1] - whole["view"][0]
    tips = [np.array(scene["links"])[:, -1, -1] for scene in (whole, coarse)]
    for axis in (0, 1):
        there = np.interp(coarse["times"], whole["times"], tips[0][:, axis])
        # The arm has about 400 pixels.
        np.testing.assert_allclose(tips[1][:, axis], there, rtol=0.0, atol=5e-3 * width)


def test_arm_at_a_dead_centre_has_a_picture_without_frequencies():
    (project,) = [make() for name, _, make in cards() if name == "Slider-crank"]
    (picture,) = parts_of(Request(project))
    assert isinstance(picture, Picture)
    assert picture.frequencies is None
