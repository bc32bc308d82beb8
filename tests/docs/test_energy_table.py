"""The script of the table of energies runs, and its cases are those of the page."""

from __future__ import annotations

import numpy as np
from reference_tables import table_rows

from page_scripts import script


def test_energy_script_runs_the_cases_of_the_page() -> None:
    module = script("measure_energy")
    rows = table_rows("docs/performance/accuracy.md", "energy")
    assert [row[0] for row in rows] == [name for name, _ in module.CASES]
    for row, (_, setting) in zip(rows, module.CASES, strict=True):
        error = np.abs(module.energy_error(module.run(2.0, **setting))).max()
        # Two of the hundred seconds: errors must not exceed those of the whole run.
        assert error < 1.5 * float(row[2])
