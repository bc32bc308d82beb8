"""Fields of a studio window: values, controls, ranges, units and names."""

from pathlib import Path

import pytest

from flexarm.errors import ModelError
from flexarm.model.wording import look
from flexarm.studio.fields import groups_of, unit_of
from flexarm.studio.state import open_file, paper_project

EXAMPLES = sorted((Path(__file__).parents[3] / "examples").rglob("*.yaml"))


def fields_of(project):
    return {field.name: field for group in groups_of(project) for field in group.fields}


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
        value = project.scenario
        for part in field.path[: -1 if field.path[-1] == "kind" else None]:
            value = look(value, part)
        if field.path[-1] == "kind":
            assert field.value == ("none" if value is None else value.kind)
            assert field.value in field.choices
            continue
        assert field.value == value, field.name
        assert field.description, field.name
        if field.control == "slider":
            assert field.low <= field.value <= field.high, field.name
            assert 0.0 < field.step <= field.high - field.low, field.name
        elif field.control == "list":
            assert field.value in field.choices, field.name


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_ends_of_a_slider_are_within_the_bounds_of_the_value(file):
    project = open_file(file)
    for field in fields_of(project).values():
        if field.control != "slider":
            continue
        for value in (field.low, field.high):
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
    assert found["arm.links[0].length"].description == "Length (m)."
    assert found["arm.links[0].length"].low > 0.0  # must be greater than 0
    assert found["arm.payload.mass"].low == 0.0
    assert found["motion.start[1]"].low < 0.0
    assert found["motion.start[1]"].label == "start y"
    assert found["arm.links[0].damping.ratio"].high <= 1.0
    assert found["arm.links[0].elements"].step == 1.0


@pytest.mark.parametrize(
    ("description", "unit"),
    [
        ("Length (m).", "m"),
        ("Torque per rate error (N m s/rad), one for all joints or one for each.", "N m s/rad"),
        ("Beam theory: without (euler_bernoulli) or with (timoshenko) shear.", ""),
        ("Acceleration of gravity [x, y] in the world frame (m/s^2).", "m/s^2"),
        ("Torque per integral of the angle error (N m/(rad s)).", "N m/(rad s)"),
        ("Natural frequency of the error (Hz), one for all.", "Hz"),
    ],
)
def test_units_are_read_from_descriptions(description, unit):
    assert unit_of(description) == unit
