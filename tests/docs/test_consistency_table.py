"""The table of the Kalman filter's consistency has the arms and bands of its script."""

from __future__ import annotations

import pytest
from reference_tables import table_rows
from scipy.stats import chi2

from page_scripts import script


@pytest.mark.parametrize(("table", "seeds"), [("consistency", 100), ("moving-horizon", 20)])
def test_rows_have_the_arms_and_bands_of_the_script(table: str, seeds: int) -> None:
    """tests/unit/control/test_filter_consistency.py measures them again with fewer runs."""
    module = script("measure_consistency")
    rows = table_rows("docs/performance/controllers.md", table)
    wanted = [[name, state] for name in module.ARMS for state in ("at rest", "in motion")]
    assert [row[:2] for row in rows] == wanted
    for name, _, *_, band, _ in rows:
        size = seeds * (2 * module.ARMS[name][0].dof + 1)
        limits = [float(text) for text in band.split(" to ")]
        assert limits == pytest.approx(chi2.ppf([0.025, 0.975], size) / size, abs=6e-4)
