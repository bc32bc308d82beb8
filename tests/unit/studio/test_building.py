"""Links are copied, exchanged and removed with their joints; what does not fit is made anew."""

import pytest

import flexarm as fa
from flexarm.base.errors import InputError
from flexarm.cases.scenario.scenario import prepare
from flexarm.view.studio.state import (
    COPY,
    KIND,
    LINKS,
    MOVE,
    NEW,
    REMOVE,
    open_bytes,
    paper_project,
    shown_by,
)
from flexarm.view.studio.values.fields import groups_of

from test_state import STUDY  # isort: skip


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
        fields = next(group for group in groups_of(project) if group.title == "Link 1").fields
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


def _files_of_init(folder):
    from typer.testing import CliRunner

    from flexarm.cli.main import app

    assert CliRunner().invoke(app, ["init", str(folder)]).exit_code == 0
    return [(folder / name).read_bytes() for name in ("arm.yaml", "scenario.yaml")]
