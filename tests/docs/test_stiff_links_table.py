"""The script of the table of almost rigid links gives the rows of the page."""

from __future__ import annotations

import pytest
from reference_tables import table_rows

from page_scripts import script


def test_stiff_links_script_gives_the_rows_of_the_page() -> None:
    module = script("measure_stiff_links")
    rows = table_rows("docs/performance/accuracy.md", "stiff")
    assert [float(row[0]) for row in rows] == list(module.RIGIDITIES)
    for row in rows:
        if float(row[0]) in (1e2, 1e8, 1e10):  # the others take a second
            cells = module.row(float(row[0])).strip("|").split("|")
            _, *evaluations, method, error = [cell.strip() for cell in cells]
            # The control of the steps amplifies rounding, which differs between versions of NumPy.
            for count, stated in zip(evaluations, row[1:3], strict=True):
                assert count == stated or float(count) == pytest.approx(float(stated), rel=0.01)
            assert [method, error] == row[3:]
