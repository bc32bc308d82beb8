"""Tables of a studio window as text."""

import pytest

from flexarm.base.errors import InputError
from flexarm.model.arm.links import SectionTable
from flexarm.model.drives import TorqueDrive
from flexarm.model.environment import AccelerationTable
from flexarm.model.scenarios.motions import ViaPointMotionSpec
from flexarm.model.surfaces import SurfaceTable
from flexarm.view.studio.state import table_content, table_text

TABLES = [
    (SurfaceTable([0, 1, 2.5], [0, 0.5, 0]), "x, y\n0, 0\n1, 0.5\n2.5, 0"),
    (
        AccelerationTable(times=[0, 1], values=[(0, 1), (2, 3)]),
        "times, values[0], values[1]\n0, 0, 1\n1, 2, 3",
    ),
    (
        TorqueDrive(rate=10, values=[[1, 2, 3], [4, 5, 1e-12]]),
        "values[0], values[1], values[2]\n1, 2, 3\n4, 5, 1e-12",
    ),
    (
        ViaPointMotionSpec(duration=1, points=[(0, 1), (2, 3)]),
        "points[0], points[1]\n0, 1\n2, 3",
    ),
    (SectionTable(x=[0, 1], mass_per_length=[2, 1]), "x, mass_per_length\n0, 2\n1, 1"),
]


@pytest.mark.parametrize(("record", "text"), TABLES, ids=lambda each: type(each).__name__)
def test_the_text_has_a_line_of_names_and_one_for_each_row(record, text):
    assert table_text(record) == text
    content = table_content(text, record)
    assert type(record).model_validate({**dict(record), **content}) == record


@pytest.mark.parametrize(
    "text", ["0 0\n1 0.5\n2.5 0", "x\ty\n0\t0\n1\t0.5\n2.5\t0\n\n", "0;0\n1; 0.5\n2.5 ;0"]
)
def test_spaces_tabs_and_semicolons_separate_values_and_names_may_be_missing(text):
    assert table_content(text, TABLES[0][0]) == {"x": [0.0, 1.0, 2.5], "y": [0.0, 0.5, 0.0]}


def test_a_column_is_added_and_removed_by_its_name():
    table = TABLES[-1][0]
    content = table_content("x, mass_per_length, flexural_rigidity\n0, 2, 5\n1, 1, 4", table)
    assert content["flexural_rigidity"] == [5.0, 4.0]
    assert table_content("x, y\n0, 2", table) == {"x": [0.0], "y": [2.0]}  # a key to be refused


def test_rows_of_another_length_are_refused():
    with pytest.raises(InputError, match="row 2 of the table must have 2 values, one for each"):
        table_content("x, y\n0, 0\n1, 0.5, 3", TABLES[0][0])


def test_cells_that_are_not_numbers_stay_text_for_the_record_to_refuse():
    assert table_content("x, y\n0, high", TABLES[0][0]) == {"x": [0.0], "y": ["high"]}


def test_an_empty_text_is_an_empty_table():
    assert table_content("", TABLES[0][0]) == {"x": [], "y": []}
