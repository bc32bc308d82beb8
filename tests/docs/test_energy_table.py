"""The script of the table of energies runs, and its cases are those of the page."""

from __future__ import annotations

import importlib.util

import numpy as np
from reference_tables import ROOT, part_pattern

PAGE = ROOT / "docs" / "how-to" / "choose-an-integrator.md"
SCRIPT = ROOT / "docs" / "how-to" / "measure_energy.py"


def test_energy_script_runs_the_cases_of_the_page() -> None:
    spec = importlib.util.spec_from_file_location("measure_energy", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = part_pattern("energy").search(PAGE.read_text(encoding="utf-8"))
    assert found is not None
    rows = [line.split("|")[1:-1] for line in found[1].strip().splitlines()[2:]]
    assert [row[0].strip() for row in rows] == [name for name, _ in module.CASES]
    for row, (_, setting) in zip(rows, module.CASES, strict=True):
        error = np.abs(module.energy_error(module.run(2.0, **setting))).max()
        # Two of the hundred seconds: errors must not exceed those of the whole run.
        assert error < 1.5 * float(row[2])
