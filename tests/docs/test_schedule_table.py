"""The table of scheduled gains has the numbers of its script."""

from __future__ import annotations

import pytest
from reference_tables import table_rows

from page_scripts import script


@pytest.mark.thorough
def test_rows_have_the_numbers_of_the_script() -> None:
    module = script("measure_schedule")
    rows = table_rows("docs/performance/controllers.md", "schedule")
    found = {name: module.measure(name) for name in ("line", "elbow")}
    wanted = [(name, law) for name, laws in found.items() for law in laws]
    assert [tuple(row[:2]) for row in rows] == wanted
    for name, law, pushed, moved, tip in rows:
        shown = [float(cell.removesuffix(" %")) for cell in (pushed, moved, tip)]
        *costs, error = found[name][law]
        # Half a unit of the last digit, and rounding errors of other libraries.
        assert shown[:2] == pytest.approx([100.0 * cost for cost in costs], abs=0.06)
        assert shown[2] == pytest.approx(error, abs=0.006)
