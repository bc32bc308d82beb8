"""State of a studio window: edits, messages, files, undo and redo."""

from pathlib import Path

import pytest

import flexarm as fa
from flexarm.base.errors import InputError, ModelError
from flexarm.model.drives import CONTROLLED
from flexarm.model.file_format.files import load_any
from flexarm.view.studio.presets import paper_project
from flexarm.view.studio.state import MOST_UNDO, History, Project, open_bytes, open_file, project_of

LENGTH = ("arm", "links", 0, "length")


def test_studio_starts_with_the_papers_arm():
    project = paper_project()
    assert [link.length for link in project.record.arm.links] == [1.4142, 1.0]
    assert project.name == "paper"


def test_edit_returns_another_project_and_keeps_the_first():
    project = paper_project()
    edited = project.edited(LENGTH, 1.2)
    assert edited.record.arm.links[0].length == 1.2
    assert project.record.arm.links[0].length == 1.4142
    assert edited.record.arm.links[1] == project.record.arm.links[1]
    assert edited.edited(LENGTH, 1.4142) == project


def test_values_that_the_file_omits_can_be_edited():
    project = paper_project()
    joints = project.edited(("arm", "joints", 1, "damping"), 0.3).record.arm.joints
    assert [joint.damping for joint in joints] == [0.0, 0.3]
    assert project.edited(("arm", "payload", "mass"), 0.5).record.arm.payload.mass == 0.5
    assert project.edited(("arm", "gravity", 1), -9.81).record.arm.gravity == (0.0, -9.81)


@pytest.mark.parametrize("value", [-1.0, 0.0, "long", None, True, float("nan"), [1.0], {}])
def test_wrong_value_gives_the_message_of_the_command_line(value, tmp_path):
    project = paper_project()
    with pytest.raises(ModelError) as error:
        project.edited(LENGTH, value)
    with pytest.raises(ModelError) as other:
        fa.Link(length=value, flexural_rigidity=1.0, mass_per_length=1.0)
    found, expected = error.value.problems[0], other.value.problems[0]
    assert found.name == "arm.links[0].length"
    assert (found.rule, found.value, found.hint) == (expected.rule, expected.value, expected.hint)
    assert found.statement.startswith("arm.links[0].length ")
    assert str(found) == f"studio: {found.statement}"


@pytest.mark.parametrize("kind", ["line", "circle", "spline", "via_points", "joint"])
def test_another_kind_of_motion_starts_at_the_same_point(kind):
    project = paper_project()
    edited = project.edited(("motion", "kind"), kind)
    motion = edited.record.motion
    assert motion.kind == kind
    assert motion.duration == project.record.motion.duration
    arm = fa.Arm(edited.record.arm).rigid()
    if kind == "joint":
        assert arm.tip(arm.rest(motion.start))[:2] == pytest.approx((2.0, 1.0), abs=0.02)
    else:
        first = motion.points[0] if kind in ("spline", "via_points") else motion.start
        assert first == pytest.approx((2.0, 1.0), abs=1e-3)
    assert edited.edited(("motion", "kind"), "line").record.motion.kind == "line"


@pytest.mark.sampled("joint_pd", "lqg")
@pytest.mark.parametrize("kind", CONTROLLED)
def test_another_drive_has_gains_of_a_stable_loop(kind):
    from flexarm.cases.scenario.scenario import prepare

    if kind == "mu_synthesis":
        pytest.importorskip("slycot", reason="slycot is not installed: mu synthesis was not tried")
    project = paper_project()
    for k in (0, 1):
        project = project.edited(("arm", "links", k, "gauges", "<new>"), None)
    project = project.edited(("drive", "kind"), kind)
    assert project.record.drive.kind == kind
    prepared = prepare(project.scenario)
    assert prepared.stability().text == ""


def test_a_sampled_torque_is_that_of_the_rigid_arm():
    project = paper_project()
    drive = project.edited(("drive", "kind"), "torque").record.drive
    arm = fa.Arm(project.record.arm)
    torque = fa.rigid_torque(arm, fa.line_motion(arm, (2.0, 1.0), (1.0, 2.0), 2.0))
    times = [k / drive.rate for k in range(len(drive.values))]
    assert times[-1] >= 2.0
    for t, row in zip(times, drive.values, strict=True):
        assert row == pytest.approx(torque(t), rel=5e-3, abs=1e-12)  # three digits


def test_damping_can_be_added_and_removed():
    project = paper_project().edited(("arm", "links", 0, "damping", "kind"), "modal")
    assert project.record.arm.links[0].damping == fa.ModalDamping(ratio=0.01)
    project = project.edited(("arm", "links", 0, "damping", "kind"), "rayleigh")
    assert project.record.arm.links[0].damping.kind == "rayleigh"
    project = project.edited(("arm", "links", 0, "damping", "kind"), "none")
    assert project.record.arm.links[0].damping is None


STUDY = """\
flexarm: 1
arm:
  links: [{length: 0.5, flexural_rigidity: 3.0, mass_per_length: 0.4, elements: 1}]
  joints: [{hub_inertia: 0.05}]
  payload: {mass: 0.1}
motions:
  slow: {kind: joint, start: [0.0], end: [1.0], duration: 2.0}
  fast: {kind: joint, start: [0.0], end: [1.0], duration: 1.0}
drives:
  torque alone: {kind: rigid_inverse_dynamics}
  joint PD: {kind: joint_pd, proportional: 2.0, derivative: 0.5}
plants:
  as believed: {}
  heavier: {payload_factor: 2.0}
run: {duration: 2.5, rate: 200}
"""


def test_study_simulates_its_choice_and_edits_it_in_place():
    project = open_bytes(STUDY.encode(), "study.yaml")
    assert project.scenario.drive.kind == "rigid_inverse_dynamics"
    chosen = project.chosen(drive="joint PD", motion="fast", plant="heavier")
    edited = chosen.edited(("drive", "derivative"), 0.7).edited(("motion", "duration"), 1.5)
    assert edited.record.drives["joint PD"].derivative == 0.7
    assert edited.record.motions["fast"].duration == 1.5
    assert edited.record.motions["slow"].duration == 2.0
    assert edited.simulated_arm.payload.mass == 0.2
    assert edited.record.arm.payload.mass == 0.1


def test_drives_motions_and_plants_of_a_study_are_copied_renamed_and_removed():
    project = open_bytes(STUDY.encode(), "study.yaml").chosen(plant="heavier")
    copied = project.copied("plant")
    assert copied.choice.plant == "heavier 2"
    assert copied.record.plants["heavier 2"] == project.record.plants["heavier"]
    changed = copied.edited(("plant", "payload_factor"), 3.0)
    assert changed.simulated_arm.payload.mass == pytest.approx(0.3)
    assert changed.record.plants["heavier"].payload_factor == 2.0
    renamed = changed.renamed("plant", "heaviest")
    assert list(renamed.record.plants) == ["as believed", "heavier", "heaviest"]
    assert renamed.choice.plant == "heaviest"
    assert renamed.plant.payload_factor == 3.0
    removed = renamed.removed("plant")
    assert list(removed.record.plants) == ["as believed", "heavier"]
    assert removed.choice.plant == "as believed"
    with pytest.raises(InputError, match="repeats 'heavier', the name of another one"):
        renamed.renamed("plant", "heavier")
    assert list(project.copied("drive").record.drives) == [
        "torque alone",
        "joint PD",
        "torque alone 2",
    ]
    with pytest.raises(ModelError, match="motions must be a mapping with at least one name"):
        project.removed("motion").removed("motion")


def test_arm_file_gets_a_motion_and_a_run():
    arm = paper_project().record.arm
    project = project_of(arm, "mine")
    assert project.record.arm == arm
    assert project.scenario.run.duration == 3.0
    assert len(project.scenario.motion.end) == 2


@pytest.mark.parametrize("kind", ["model", "scenario"])
def test_files_of_a_scenario_can_be_opened_again(kind, tmp_path):
    project = paper_project().edited(LENGTH, 1.2)
    name, text = project.files()[kind]
    assert set(project.files()) == {"model", "scenario"}
    (tmp_path / name).write_text(text, encoding="utf-8")
    opened = open_file(tmp_path / name)
    assert opened.record.arm == project.record.arm
    if kind == "scenario":
        assert opened == project
    assert load_any(tmp_path / name) == (project.record.arm if kind == "model" else project.record)


def test_a_scenario_with_every_part_can_be_edited_saved_and_opened_again():
    project = open_file(Path(__file__).parent / "every_part.yaml")
    edited = project.edited(("hardware", "instruments", 1, "noise"), 0.02)
    edited = edited.edited(("contacts", 2, "surface", "y", 1), -2.2)
    opened = open_bytes(edited.files()["scenario"][1].encode(), "every_part.yaml")
    assert opened == edited
    assert opened.record.contacts[2].surface.y == (-2.0, -2.2, -2.0)
    assert opened.record.motion == project.record.motion
    assert opened.record.loads == project.record.loads


def test_files_of_a_study_can_be_opened_again():
    project = open_bytes(STUDY.encode(), "study.yaml").chosen(plant="heavier")
    files = project.files()
    assert [name for name, _ in files.values()] == [
        "study-arm.yaml",
        "study-scenario.yaml",
        "study.yaml",
    ]
    assert open_bytes(files["study"][1].encode(), "study.yaml").record == project.record
    assert open_bytes(files["scenario"][1].encode(), "x.yaml").record == project.scenario
    assert open_bytes(files["model"][1].encode(), "x.yaml").record.arm == project.record.arm


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("flexarm: [1", "is not valid YAML"),
        ("", "is empty"),
        ("flexarm: 1\narm: /etc/passwd\nrun: {duration: 1}\n", "refers to another file"),
        ("flexarm: 1\narm: !!python/object/apply:os.system [ls]\nrun: {duration: 1}\n", "tag"),
        (STUDY.replace("length: 0.5", "length: -0.5"), "must be greater than 0, got -0.5"),
    ],
)
def test_broken_file_is_rejected(text, message):
    with pytest.raises(ModelError, match=message):
        open_bytes(text.encode(), "broken.yaml")


@pytest.mark.parametrize(
    ("file", "name"), [("../../etc/x.yaml", "x"), ('a"<b>.yaml', "a--b"), ("\n.yaml", "arm")]
)
def test_names_of_files_have_plain_characters(file, name):
    assert open_bytes(STUDY.encode(), file).name == name


def test_the_kind_of_a_fault_changes_with_the_numbers_that_it_needs():
    path = ("hardware", "instruments", 0, "faults", 0, "kind")
    project = paper_project().edited(("drive", "kind"), "joint_pd")
    project = project.edited(("hardware", "<new>"), None)
    project = project.edited((*path[:2], "<new>"), None).edited((*path[:4], "<new>"), None)
    sizes = []
    for kind in ("frozen", "gain"):
        project = project.edited(path, kind)
        fault = project.record.hardware.instruments[0].faults[0]
        assert fault.kind == kind
        sizes.append(fault.size is None)
    assert sizes == [True, False]


def test_undo_and_redo():
    first = paper_project()
    history = History(first)
    second, third = first.edited(LENGTH, 1.2), first.edited(LENGTH, 1.3)
    assert not history.can_undo
    assert history.put(second)
    assert not history.put(second)  # no change, so no step of undo
    assert history.put(third)
    history.undo()
    assert history.now is second
    history.undo()
    history.undo()  # nothing is left to undo
    assert history.now is first
    assert not history.can_undo
    history.redo()
    assert history.now is second
    history.put(first.edited(LENGTH, 1.5))
    assert not history.can_redo
    history.redo()
    assert history.now.record.arm.links[0].length == 1.5


def test_copied_history_has_separate_edits():
    first = paper_project()
    history = History(first)
    history.put(first.edited(LENGTH, 1.2))
    other = history.copy()
    other.undo()
    assert other.now is first
    assert history.now.record.arm.links[0].length == 1.2
    assert history.can_undo
    assert not history.can_redo


def test_undo_keeps_a_limited_number_of_projects():
    project = paper_project()
    history = History(project)
    for k in range(MOST_UNDO + 50):
        history.put(Project(project.record, f"step {k}"))
    for _ in range(2 * MOST_UNDO):
        history.undo()
    assert history.now.name == "step 49"
