"""Edits of a studio window that are more than a value: kinds, forms, tables, entries of lists."""

import pytest

from flexarm.base.errors import InputError
from flexarm.model import Load
from flexarm.view.studio.presets import paper_project
from flexarm.view.studio.state import (
    FORM,
    KIND,
    NEW,
    PRESET,
    REMOVE,
    TABLE,
    WAY,
    History,
    open_bytes,
)

from test_state import STUDY  # isort: skip

LOADS, CONTACTS = ("loads", NEW), ("contacts", NEW)


def test_loads_are_added_and_removed():
    project = paper_project().edited(LOADS, None)
    assert project.record.loads[0].link == 2
    project = project.edited(("loads", 0, "force", 1), -2.0).edited(LOADS, None)
    assert [load.force[1] < 0.0 for load in project.record.loads] == [True, True]
    first, second = project.record.loads
    assert first.force == (0.0, -2.0)
    assert project.edited(("loads", 0, REMOVE), None).record.loads == (second,)
    assert project.edited(("loads", 1, REMOVE), None).record.loads == (first,)


def test_a_new_load_bends_the_arm_a_little():
    """The force of the table is the one that deflects a clamped arm by a fiftieth of its length."""
    project = paper_project().edited(LOADS, None)
    arm = project.record.arm
    length = sum(link.length for link in arm.links)
    rigidity = arm.links[0].flexural_rigidity
    deflection = abs(project.record.loads[0].force[1]) * length**3 / (3.0 * rigidity)
    assert deflection == pytest.approx(0.02 * length, rel=0.01)  # three digits


def test_a_table_is_added_edited_and_refused_as_in_a_file():
    project = paper_project().edited(LOADS, None).edited(("loads", 0, "factor", NEW), None)
    path = ("loads", 0, "factor", TABLE)
    edited = project.edited(path, "times, values\n0, 0\n1, 0.5\n2, 1\n")
    assert edited.record.loads[0].factor.values == (0.0, 0.5, 1.0)
    with pytest.raises(InputError) as error:
        project.edited(path, "times, values\n0, 0\n-1, 0.5\n")
    assert error.value.problems[0].statement == (
        "loads[0].factor.times[1] must be at least 0 (the previous time), got -1."
    )
    with pytest.raises(InputError, match=r"loads\[0\]\.factor\.values\[0\] must be a number"):
        project.edited(path, "times, values\n0, much\n")
    removed = edited.edited(("loads", 0, "factor", REMOVE), None)
    assert removed.record.loads[0].factor is None


def test_the_kind_of_a_surface_changes():
    project = paper_project().edited(CONTACTS, None)
    for kind in ("round", "table", "wall"):
        project = project.edited(("contacts", 0, "surface", KIND), kind)
        assert project.record.contacts[0].surface.kind == kind
    assert project.edited(("contacts", 0, REMOVE), None).record.contacts == ()


def test_new_contacts_are_free_of_the_arm_at_its_start():
    from flexarm.cases.scenario.scenario import prepare

    project = paper_project().edited(CONTACTS, None)
    for kind in ("round", "table", "wall"):
        prepare(project.edited(("contacts", 0, "surface", KIND), kind).scenario)


def test_a_value_has_two_forms():
    project = paper_project().edited(("base_acceleration", NEW), None)
    assert project.record.base_acceleration == (1.0, 0.0)
    table = project.edited(("base_acceleration", FORM), "record")
    assert table.record.base_acceleration.values == ((0.0, 0.0), (1.0, 0.0), (0.0, 0.0))
    assert table.edited(("base_acceleration", FORM), "record") == table  # pressed twice
    pair = table.edited(("base_acceleration", FORM), "pair")
    assert pair.record.base_acceleration == (0.0, 0.0)
    assert pair.edited(("base_acceleration", REMOVE), None) == paper_project()


def test_one_number_for_all_joints_and_back():
    project = paper_project().edited(("drive", KIND), "joint_pd")
    one = project.edited(("drive", "derivative", FORM), "number")
    assert one.record.drive.derivative == project.record.drive.derivative[0]
    each = one.edited(("drive", "derivative", FORM), "list")
    assert each.record.drive.derivative == (one.record.drive.derivative,) * 2


def test_a_list_that_is_not_one_for_each_joint_has_a_length_that_fits():
    project = open_bytes(STUDY.encode(), "study.yaml")
    edited = project.edited(("plant", "flexural_rigidity_factor", FORM), "list")
    assert edited.plant.flexural_rigidity_factor == (1.0,)
    project = paper_project().edited(("arm", "links", 0, "damping", KIND), "modal")
    edited = project.edited(("arm", "links", 0, "damping", "ratio", FORM), "list")
    assert set(edited.record.arm.links[0].damping.ratio) == {0.01}


def test_a_link_is_described_in_three_ways():
    project = paper_project()
    for way in ("material and section", "table", "constants"):
        project = project.edited(("arm", "links", 0, WAY), way)
        link = project.record.arm.links[0]
        assert (link.section is None) == (way != "material and section")
        assert (link.table is None) == (way != "table")
        assert link.length == 1.4142
        # Three digits of the diameter, whose fourth power counts.
        assert link.beam().flexural_rigidity[0] == pytest.approx(105.0, rel=0.02)


def test_a_material_is_a_preset_or_has_values_of_its_own():
    way = paper_project().edited(("arm", "links", 0, WAY), "material and section")
    place = ("arm", "links", 0, "material")
    steel = way.edited((*place, PRESET), "steel")
    assert steel.record.arm.links[0].material.density == 7850.0
    light = steel.edited((*place, "density"), 5000.0)
    assert light.record.arm.links[0].material.density == 5000.0
    assert light.record.arm.links[0].material.youngs_modulus == 210e9


def test_instruments_are_added_and_removed():
    project = paper_project().edited(("drive", KIND), "joint_pd").edited(("hardware", NEW), None)
    place = ("hardware", "instruments")
    for signals in (["joint_angle", "joint_rate"], ["joint_angle", "joint_rate", "joint_twist"]):
        project = project.edited((*place, NEW), None)
        assert [item.signal for item in project.record.hardware.instruments] == signals
    for _ in range(3):
        project = project.edited((*place, 0, REMOVE), None)
    assert project.record.hardware.instruments is None


def test_undo_includes_entries_of_lists():
    project = paper_project()
    history = History(project)
    history.put(project.edited(LOADS, None))
    history.put(history.now.edited(("loads", 0, REMOVE), None))
    history.undo()
    assert len(history.now.record.loads) == 1
    history.undo()
    assert history.now.record.loads == ()
    history.redo()
    assert isinstance(history.now.record.loads[0], Load)
