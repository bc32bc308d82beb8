"""Links are copied, exchanged and removed with their joints; what does not fit is made anew."""

import json
import zlib
from base64 import urlsafe_b64encode

import pytest

import flexarm as fa
from flexarm.base.errors import InputError
from flexarm.cases import templates
from flexarm.cases.scenario.scenario import prepare
from flexarm.model.wording import path_text
from flexarm.view.studio.compute import Picture, Request, parts_of
from flexarm.view.studio.presets import paper_project
from flexarm.view.studio.state import (
    BESIDE,
    COPY,
    KIND,
    LARGEST_FILE,
    LINKS,
    MOVE,
    NEW,
    REMOVE,
    link_of,
    open_bytes,
    open_file,
    open_link,
    shown_by,
)
from flexarm.view.studio.values.fields import fields_in, groups_of, points_of

from test_state import STUDY  # isort: skip

MECHANISMS = [["--mechanism", kind] for kind in templates.MECHANISMS]


def lengths(project):
    return [round(link.length, 6) for link in project.record.arm.links]


def test_links_are_copied_exchanged_and_removed_with_their_joints():
    project = paper_project()
    first, second = lengths(project)
    project = project.edited(("arm", "joints", 1, "mass"), 0.25)
    longer = project.edited((*LINKS, 0, COPY), None)
    assert lengths(longer) == [first, first, second]
    assert [joint.mass for joint in longer.record.arm.joints] == [0.0, 0.0, 0.25]
    moved = longer.edited((*LINKS, 1, MOVE), None)
    assert lengths(moved) == [first, second, first]
    assert [joint.mass for joint in moved.record.arm.joints] == [0.0, 0.25, 0.0]
    assert lengths(moved.edited((*LINKS, 0, REMOVE), None)) == [second, first]
    assert shown_by(longer.record, (), (*LINKS, 0, COPY)) == (*LINKS, 1, COPY)
    assert shown_by(longer.record, (), (*LINKS, 2, REMOVE)) == (*LINKS, 2, REMOVE)


@pytest.mark.parametrize("kind", ["joint_pd", "computed_torque", "lqg", "mpc"])
@pytest.mark.parametrize("edit", [(1, COPY), (0, REMOVE)])
def test_the_drive_and_the_motion_fit_the_joints(edit, kind):
    project = paper_project()
    for path, value in ((("motion", KIND), "joint"), (("drive", KIND), kind)):
        project = project.edited(path, value)
    changed = project.edited((*LINKS, *edit), None)
    assert changed.record.drive.kind == kind
    count = len(changed.record.arm.links)
    assert len(changed.record.motion.end) == count
    assert prepare(changed.record).arm.n_joints == count


def test_what_fits_is_kept():
    project = paper_project()
    assert project.record.motion.kind == "line"
    assert project.edited((*LINKS, 1, COPY), None).record.motion == project.record.motion


def test_starting_gains_follow_the_arm_and_chosen_ones_remain():
    """Gains of the studio for links of 2 m are unstable with links of half a metre."""
    project = paper_project().edited(("motion", KIND), "joint")
    project = project.edited(("drive", KIND), "joint_pid")
    first = project.record.drive.derivative
    for k, length in enumerate((0.8, 0.6)):
        project = project.edited(("arm", "links", k, "length"), length)
    drive = project.record.drive
    assert drive.derivative[0] < 0.5 * first[0]
    prepared = prepare(project.scenario)
    assert prepared.stability().text == ""
    chosen = project.edited(("drive", "derivative", 0), 1.25)
    later = chosen.edited(("arm", "links", 0, "length"), 0.9)
    assert later.record.drive == chosen.record.drive


def test_a_load_on_a_removed_link_refuses_its_removal():
    project = paper_project().edited(("loads", NEW), None)
    with pytest.raises(InputError, match=r"loads\[0\]\.link"):
        project.edited((*LINKS, 1, REMOVE), None)


def test_branches_remain_on_their_links():
    link = "{length: 1.0, flexural_rigidity: 10.0, mass_per_length: 0.1"
    text = (
        f"flexarm: 1\narm:\n  links:\n    - {link}}}\n    - {link}}}\n    - {link}, parent: 2}}\n"
    )
    project = open_bytes(text.encode(), "tree.yaml")
    assert [x.parent for x in project.edited((*LINKS, 0, COPY), None).record.arm.links][-1] == 3
    with pytest.raises(InputError, match="link 2 carries link 3: remove that first"):
        project.edited((*LINKS, 1, REMOVE), None)
    # Another link would take the number of the removed one, and carry the branch.
    longer = project.edited((*LINKS, 1, COPY), None)
    assert [x.parent for x in longer.record.arm.links][-1] == 2
    with pytest.raises(InputError, match="link 2 carries link 4: remove that first"):
        longer.edited((*LINKS, 1, REMOVE), None)


def test_a_study_is_not_changed_unless_all_its_parts_fit():
    project = open_bytes(STUDY.encode(), "study.yaml")
    with pytest.raises(InputError, match="one value for each joint"):
        project.edited((*LINKS, 0, COPY), None)


def test_links_have_buttons():
    def buttons(project):
        group = next(group for group in groups_of(project) if group.title == "Link 1")
        fields = fields_in(group.entries)
        return [field.path[-1] for field in fields if field.path[:2] == LINKS][-3:]

    assert buttons(paper_project()) == [COPY, MOVE, REMOVE]
    single = paper_project().edited((*LINKS, 0, REMOVE), None)
    assert buttons(single)[-1] == COPY


def test_the_scenario_of_init_opens_after_its_arm(tmp_path):
    arm, scenario = _files_of_init(tmp_path)
    with pytest.raises(fa.ModelError, match=r"refers to another file, 'arm\.yaml'"):
        open_bytes(scenario, "scenario.yaml")
    opened = open_bytes(arm, "arm.yaml").record.arm
    project = open_bytes(scenario, "scenario.yaml", {"arm.yaml": opened})
    assert project.record == fa.load_scenario(tmp_path / "scenario.yaml")


def _files_of_init(folder, *options):
    from typer.testing import CliRunner

    from flexarm.cli.main import app

    assert CliRunner().invoke(app, ["init", str(folder), *options]).exit_code == 0
    return [(folder / name).read_bytes() for name in ("arm.yaml", "scenario.yaml")]


@pytest.mark.parametrize("options", [[], ["--gravity"], ["--links", "1"], *MECHANISMS], ids=str)
def test_the_studio_opens_and_simulates_what_init_writes(options, tmp_path):
    _files_of_init(tmp_path, *options)
    for name in ("scenario.yaml", "arm.yaml"):
        project = open_file(tmp_path / name).edited(("run", "duration"), 0.1)
        part = next(parts_of(Request(project)))
        assert isinstance(part, Picture), part


def test_a_link_contains_the_whole_state():
    study = open_bytes(STUDY.encode(), "study.yaml").chosen(plant="heavier")
    drive = study.edited((BESIDE, NEW), None)
    for project in (paper_project(), study, drive):
        assert open_link(link_of(project)) == project


LINK = link_of(paper_project())


@pytest.mark.parametrize(
    "text",
    [
        "",
        "x",
        "ä",
        LINK[:-5],
        LINK[:60] + "AA" + LINK[62:],
        LINK + "AAAA",
        link_of(paper_project())[::-1],
    ],
    ids=["empty", "short", "not ASCII", "cut", "changed", "longer", "reversed"],
)
def test_damaged_links_are_refused(text):
    with pytest.raises(InputError, match="the link is damaged or incomplete"):
        open_link(text)


def test_links_of_more_than_the_largest_file_are_refused():
    bomb = urlsafe_b64encode(zlib.compress(bytes(LARGEST_FILE + 1), 9)).decode()
    with pytest.raises(InputError, match="the link is damaged"):
        open_link(bomb)


def test_links_with_other_names_are_refused():
    content = json.dumps(["s", STUDY, ["none", "slow", "heavier"], None])
    with pytest.raises(InputError, match="the link is damaged"):
        open_link(urlsafe_b64encode(zlib.compress(content.encode())).decode())


def test_a_second_drive_is_added_exchanged_and_removed():
    project = paper_project()
    two = project.edited((BESIDE, NEW), None)
    kinds = [side.scenario.drive.kind for side in two.sides]
    assert kinds == ["computed_torque", "rigid_inverse_dynamics"]
    other = two.edited((BESIDE, MOVE), None)
    assert [side.scenario.drive.kind for side in other.sides] == kinds[::-1]
    assert other.edited((BESIDE, REMOVE), None) == project
    longer = two.edited(("arm", "links", 0, "length"), 1.5)
    assert {side.record.arm.links[0].length for side in longer.sides} == {1.5}
    # The gains of the drive beside are those of another number of joints.
    assert two.edited((*LINKS, 1, COPY), None).beside is None


def test_the_outcome_of_two_drives_is_that_of_compare():
    project = paper_project().edited(("run", "duration"), 3.0).edited((BESIDE, NEW), None)
    part = next(parts_of(Request(project)))
    head, *rows = part.outcome
    assert head == ("", "computed torque", "rigid inverse dynamics")
    prepared = prepare(project.scenario)
    references = {"m": prepared.followed.motion}
    law = {"c": prepared.options["controller"]}
    settings = {"rate": prepared.options["rate"], "initial": prepared.options["initial"]}
    table = fa.compare(prepared.arm, law, 3.0, references, **settings)
    expected = 1e3 * float(table["tip_error_rms"].squeeze())
    found = {row[0]: row[1] for row in rows}["tip error rms [mm]"]
    assert float(found) == pytest.approx(expected, rel=1e-3)
    assert len(json.loads(part.data)["scenes"]) == 2


def test_points_of_the_motion_are_moved():
    project = paper_project()
    assert [(path_text(path), name) for path, name, _ in points_of(project)] == [
        ("motion.start", "start"),
        ("motion.end", "end"),
    ]
    moved = project.edited(("motion", KIND), "via_points")
    assert [name for _, name, _ in points_of(moved)] == ["point 1", "point 2", "point 3"]
    path = points_of(moved)[1][0]
    assert moved.edited(path, [1.5, 1.25]).record.motion.points[1] == (1.5, 1.25)
    assert points_of(project.edited(("motion", KIND), "joint")) == []
