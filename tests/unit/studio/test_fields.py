"""Fields of a studio window: values, controls, ranges, units and names."""

import math
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import pytest
from pydantic import Field

from flexarm.base.errors import ModelError
from flexarm.model.arm.links import Gauge
from flexarm.model.checks import Record
from flexarm.model.drives import CONTROLLED, DRIVES, FEEDFORWARD_DRIVES
from flexarm.model.quantities import (
    Count,
    Flag,
    Listed,
    NonNegative,
    Number,
    Pair,
    PerJoint,
    Positive,
)
from flexarm.model.units import unit_of
from flexarm.model.wording import look
from flexarm.view.studio.presets import paper_project
from flexarm.view.studio.state import (
    FORM,
    KIND,
    NEW,
    REMOVE,
    TABLE,
    WORDS,
    open_file,
    table_content,
)
from flexarm.view.studio.values.fields import FieldMaker, Sizes, fields_in, groups_of
from flexarm.view.studio.values.starts import new_record

ROOT = Path(__file__).parents[3]
EXAMPLES = [
    *sorted(path for path in (ROOT / "examples").rglob("*.yaml") if path.stem != "identify"),
    ROOT / "tests/unit/studio/every_part.yaml",
]


def fields_of(project):
    return {field.name: field for group in groups_of(project) for field in fields_in(group.entries)}


def controlled():
    project = paper_project().edited(("drive", "kind"), "joint_pd")
    return project.edited(("arm", "links", 0, "damping", "kind"), "modal")


def test_main_values_have_fields():
    found = fields_of(controlled())
    for name in (
        "arm.links[0].length",
        "arm.links[1].flexural_rigidity",
        "arm.links[0].damping.ratio",
        "arm.joints[1].damping",
        "arm.payload.mass",
        "motion.kind",
        "motion.duration",
        "motion.start[0]",
        "drive.kind",
        "drive.proportional[1]",
        "drive.derivative[0]",
        "run.duration",
        "run.integrator",
        "arm.gravity[1]",
    ):
        assert name in found, name


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_every_field_has_a_value_of_the_scenario_in_its_range(file):
    project = open_file(file)
    for field in fields_of(project).values():
        value = project.record
        for part in project.placed(field.path):
            value = value if part in WORDS else look(value, part)
        assert field.description or field.path[-1] == REMOVE, field.name
        if field.path[-1] not in WORDS:
            assert field.value == (None if value == math.inf else value), field.name
        elif field.path[-1] == KIND:
            assert field.value == ("none" if value is None else value.kind)
        elif field.path[-1] == TABLE:
            assert table_content(field.value, value) == {
                name: [list(row) if isinstance(row, tuple) else row for row in column]
                for name in value._columns
                if (column := getattr(value, name)) is not None
            }
        if field.control == "slider":
            limits = field.range
            assert limits.low <= field.value <= limits.high, field.name
            assert 0.0 < limits.step <= limits.high - limits.low, field.name
        elif field.control == "list":
            assert field.word, field.name


@pytest.mark.sampled("arm", "paper")
@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_ends_of_a_slider_are_within_the_bounds_of_the_value(file):
    project = open_file(file)
    for field in fields_of(project).values():
        if field.control != "slider":
            continue
        for value in (field.range.low, field.range.high):
            try:
                project.edited(field.path, type(field.value)(value))
            except ModelError as error:
                # Rules between values remain, such as a step longer than the duration.
                for problem in error.problems:
                    bounds = ("be greater than 0", "be at least 0", "be less than 1")
                    assert problem.rule not in bounds or problem.name != field.name


def test_units_descriptions_and_bounds_equal_those_of_the_records():
    found = fields_of(controlled())
    assert found["arm.links[0].flexural_rigidity"].unit == "N m^2"
    assert found["drive.proportional[0]"].unit == "N m/rad"
    assert found["drive.derivative[0]"].unit == "N m s/rad"
    assert found["motion.start[0]"].unit == "m"
    assert found["arm.links[0].damping.ratio"].unit == ""
    assert found["arm.links[0].length"].description == "Length (m), from the root to the tip."
    assert found["arm.links[0].length"].range.low > 0.0  # must be greater than 0
    assert found["arm.payload.mass"].range.low == 0.0
    assert found["motion.start[1]"].range.low < 0.0
    assert found["motion.start[1]"].label == "start y"
    assert found["arm.links[0].damping.ratio"].range.high <= 1.0
    assert found["arm.links[0].elements"].range.step == 1.0


def test_drives_stand_under_the_titles_of_their_groups():
    choices = fields_of(paper_project())["drive.kind"].choices
    assert [title for title, _ in choices] == list(DRIVES)
    kinds = [kind for _, entries in choices for kind, _ in entries]
    assert set(kinds) == {"none", "torque", *FEEDFORWARD_DRIVES, *CONTROLLED}
    assert dict(choices)["joint control"][0] == ("joint_pd", "joint PD")


def test_values_beside_the_usual_ones_are_folded_unless_they_are_given():
    def more(project):
        (group,) = (group for group in groups_of(project) if group.title == "Link 1")
        return next(
            entry for entry in group.entries if getattr(entry, "title", "") == "More values"
        )

    assert more(paper_project()).folded
    assert not more(paper_project().edited(("arm", "links", 0, "modes"), 2)).folded


def test_instruments_and_motors_are_not_folded():
    project = controlled().edited(("hardware", NEW), None)
    (group,) = (group for group in groups_of(project) if group.title == "Hardware")
    assert [getattr(entry, "title", "") or entry.label for entry in group.entries] == [
        "Instruments",
        "Add motors",
        "More values",
        "Remove hardware",
    ]


def test_names_and_abbreviations_are_written_as_usual():
    found = fields_of(open_file(ROOT / "tests/unit/studio/every_part.yaml"))
    labels = {field.label for field in found.values()}
    assert {"Young's modulus", "Poisson's ratio", "Coulomb friction"} <= labels
    words = {word for each in found.values() for _, part in each.choices for _, word in part}
    assert {"joint PID", "LQG", "Euler-Bernoulli", "Rayleigh", "ZVD"} <= words


def test_omitted_values_have_fields():
    found = fields_of(paper_project())
    assert found["arm.links[0].modes"].control == "text"
    assert found["arm.links[0].modes"].value is None
    assert found["arm.links[0].rotary_inertia"].word == "not set"
    assert found["loads.<new>"].label == "Add load"
    assert found["arm.joints[1].friction.<new>"].label == "Add friction"


def test_values_of_several_joints_have_a_slider_each_and_another_form():
    project = controlled()
    found = fields_of(project)
    assert found["drive.proportional[0]"].other == (("drive", "proportional", FORM), "number")
    assert found["drive.proportional[1]"].other is None
    found = fields_of(project.edited(("drive", "proportional", FORM), "number"))
    assert found["drive.proportional"].other == (("drive", "proportional", FORM), "list")


@pytest.mark.parametrize(
    ("description", "unit"),
    [
        ("Length (m).", "m"),
        ("Torque per rate error (N m s/rad), one for all joints or one for each.", "N m s/rad"),
        ("Beam theory: without (euler_bernoulli) or with (timoshenko) shear.", ""),
        ("Acceleration of gravity [x, y] in the world frame (m/s^2).", "m/s^2"),
        ("Torque per integral of the angle error (N m/(rad s)).", "N m/(rad s)"),
        ("Natural frequency of the error (Hz), one for all.", "Hz"),
        ("Force [x, y] (N); per length (N/m) with spread.", "N"),
        ("Joint rate per curvature (rad/s per 1/m). It damps vibration.", "rad/s per 1/m"),
        ("Decay rate of angle errors, one for all (1/s).", "1/s"),
        ("Number of the mode (1).", ""),
    ],
)
def test_units_are_read_from_descriptions(description, unit):
    assert unit_of(description) == unit


class Magnet(Record):
    """A record that the studio does not know."""

    strength: Positive = Field(description="Force at the surface (N).")
    gains: Annotated[Any, PerJoint(NonNegative)] = Field(description="Gain (1/s).")
    pole: Literal["north", "south"] = Field(description="Pole that the arm meets.")
    place: Pair = Field(description="Centre [x, y], world frame (m).")
    on: Flag = Field(description="Whether it is switched on.")
    times: Listed[Number] = Field(description="Times (s).")
    current: Listed[Number] = Field(description="Current at each time (A).")
    core: Gauge = Field(description="A record inside.")
    turns: Count | None = Field(default=None, description="Number of turns.")
    _columns: ClassVar[tuple[str, ...]] = ("times", "current")


def test_record_that_the_studio_does_not_know_has_starting_values_and_fields():
    magnet = Magnet(**new_record(paper_project().scenario, Magnet))
    entries = FieldMaker(Sizes(2, 2.4, 1.4)).record(magnet, ("magnet",))
    found = {field.name: field for field in fields_in(entries)}
    assert {name: field.control for name, field in found.items()} == {
        "magnet.<table>": "table",
        "magnet.strength": "slider",
        "magnet.gains": "slider",
        "magnet.pole": "list",
        "magnet.place[0]": "slider",
        "magnet.place[1]": "slider",
        "magnet.on": "switch",
        "magnet.core.station": "slider",
        "magnet.core.distance": "slider",
        "magnet.turns": "text",
    }
    assert found["magnet.strength"].unit == "N"
    assert found["magnet.strength"].range.low > 0.0
    assert found["magnet.gains"].other == (("magnet", "gains", FORM), "list")
    assert found["magnet.place[1]"].range.high == 2.4
    assert found["magnet.<table>"].value == "times, current\n1, 1\n2, 2"


def test_the_kind_of_a_filter_is_a_choice():
    """A kind with several words is no discriminator: the record is one, and offers them all."""
    project = paper_project().edited(("drive", "kind"), "estimator")
    assert project.record.drive.estimator.kind == "extended"
    kind = fields_of(project)["drive.estimator.kind"]
    words = {word for _, group in kind.choices for word, _ in group}
    assert words == {"extended", "unscented", "moving_horizon"}
    for word in ("moving_horizon", "extended"):
        project = project.edited(kind.path, word)
        assert project.record.drive.estimator.kind == word
