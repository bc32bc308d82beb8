"""The table of the Kalman filter's consistency has the arms and bands of its script."""

from __future__ import annotations

import importlib.util

import pytest
from reference_tables import ROOT, part_pattern
from scipy.stats import chi2

PAGE = ROOT / "docs" / "how-to" / "control-uncertain.md"
SCRIPT = ROOT / "docs" / "how-to" / "measure_consistency.py"
#: Runs of each row of the page.
SEEDS = 100


def test_rows_have_the_arms_and_bands_of_the_script() -> None:
    """tests/unit/control/test_filter_consistency.py measures them again with fewer runs."""
    spec = importlib.util.spec_from_file_location("measure_consistency", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = part_pattern("consistency").search(PAGE.read_text(encoding="utf-8"))
    assert found is not None
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in found[1].splitlines()[2:]]
    wanted = [[name, state] for name in module.ARMS for state in ("at rest", "in motion")]
    assert [row[:2] for row in rows] == wanted
    for name, _, *_, band, _ in rows:
        size = SEEDS * (2 * module.ARMS[name][0].dof + 1)
        limits = [float(text) for text in band.split(" to ")]
        assert limits == pytest.approx(chi2.ppf([0.025, 0.975], size) / size, abs=6e-4)
