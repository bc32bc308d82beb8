"""The script of the table of meshes gives the rows of the page."""

from __future__ import annotations

import importlib.util

from reference_tables import ROOT, part_pattern

PAGE = ROOT / "docs" / "how-to" / "large-deflection.md"
SCRIPT = ROOT / "docs" / "how-to" / "measure_mesh.py"


def test_mesh_script_gives_the_rows_of_the_page() -> None:
    spec = importlib.util.spec_from_file_location("measure_mesh", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = part_pattern("mesh").search(PAGE.read_text(encoding="utf-8"))
    assert found is not None
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in found[1].splitlines()[2:]]
    assert [int(row[0]) for row in rows] == list(module.ELEMENTS)
    # The finer meshes take minutes.
    for row in rows[:4]:
        elements, modes, error = module.row(int(row[0]))
        assert [elements, modes] == row[:2]
        # One unit of the last printed digit is a few per cent.
        assert abs(float(error) - float(row[2])) <= 0.05 * float(row[2])
