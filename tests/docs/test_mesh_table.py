"""The script of the table of meshes gives the rows of the page."""

from __future__ import annotations

import pytest
from reference_tables import table_rows

from page_scripts import script


@pytest.mark.thorough
def test_mesh_script_gives_the_rows_of_the_page() -> None:
    module = script("measure_mesh")
    rows = table_rows("docs/performance/accuracy.md", "mesh")
    assert [int(row[0]) for row in rows] == list(module.ELEMENTS)
    # The finer meshes take minutes.
    for row in rows[:4]:
        elements, modes, error = module.row(int(row[0]))
        assert [elements, modes] == row[:2]
        # One unit of the last printed digit is a few per cent.
        assert abs(float(error) - float(row[2])) <= 0.05 * float(row[2])
