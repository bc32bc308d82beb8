"""The table of settings for "auto": rows of the page, measured again on a few arms."""

from __future__ import annotations

import re

import pytest
from docs_pages import text_of
from reference_tables import table_rows

from page_scripts import script

PAGE = "docs/performance/accuracy.md"
ARMS = 3


@pytest.fixture(scope="module")
def module():
    return script("measure_auto")


@pytest.fixture(scope="module")
def rows():
    """Return cells: integrator, setting, failed, median error, largest error, evaluations."""
    return table_rows(PAGE, "auto")


def test_page_has_a_row_for_each_setting(module, rows):
    wanted = [[f"`{setting.integrator}`", str(setting)] for setting in module.SETTINGS]
    assert [row[:2] for row in rows] == wanted
    arms = re.search(r"On (\d+) random arms, two thirds.*?the settings below", text_of(PAGE), re.S)
    assert arms is not None


@pytest.mark.thorough
def test_first_arms_are_within_the_rows_of_the_page(module, rows):
    for case in module.cases(ARMS):
        for setting, (_, _, failed, _, largest, _) in zip(module.SETTINGS, rows, strict=True):
            outcome = module.measure(case, setting)
            if outcome.error is None:
                assert int(failed) > 0, setting
            else:
                # One unit of the only digit printed is up to a half.
                assert outcome.error <= 1.5 * float(largest), setting
                assert outcome.cost > 0.0


def test_page_supports_the_choice(module, rows):
    """At equal tolerance the method of order 8 errs less; cowell_4 fails more often than rk4."""
    cells = {(row[0].strip("`"), row[1]): row for row in rows}
    for rtol in module.TOLERANCES:
        setting = f"`rtol={rtol:g}`"
        eighth, fifth = (
            float(cells[name, setting][3]) for name in ("dormand_prince_8", "kennedy_carpenter_5")
        )
        assert eighth < fifth
    for angle in module.ANGLES:
        half = cells["cowell_4", f"{angle / 2:g} rad"]
        assert int(half[2]) > int(cells["rk4", f"{angle:g} rad"][2])
