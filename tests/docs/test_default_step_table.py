"""The table of default steps on random arms: rows of the page, measured again on a few arms."""

from __future__ import annotations

import re

import pytest
from docs_pages import text_of
from reference_tables import table_rows

from page_scripts import script

PAGE = "docs/performance/accuracy.md"
#: The first arms of the page, measured again with every method.
ARMS = 3


@pytest.fixture(scope="module")
def module():
    return script("measure_default_step")


@pytest.fixture(scope="module")
def rows():
    """Return cells: integrator, runs, wrong, failed, largest error, its seed, evaluations."""
    return table_rows(PAGE, "default steps")


def test_page_has_a_row_for_each_fixed_step_method(module, rows):
    assert [row[0].strip("`") for row in rows] == list(module.METHODS)
    arms = re.search(r"\[(\d+) random arms\]", text_of(PAGE))
    assert arms is not None
    assert {row[1] for row in rows} == {arms[1]}


@pytest.mark.thorough
def test_first_arms_are_within_the_rows_of_the_page(module, rows):
    for case in module.cases(ARMS):
        for name, _, _, failed, largest, _, _ in rows:
            error, evaluations = module.measure(case, name.strip("`"))
            assert evaluations > 0
            if error is None:
                assert int(failed) > 0, name
            else:
                # One unit of the last digit printed is a few per cent.
                assert error <= 1.05 * float(largest), name


@pytest.mark.thorough
def test_largest_errors_of_the_page_are_reproduced(module, rows):
    """Each row names the seed of its largest error, which is measured again."""
    for name, _, _, _, largest, seed, _ in rows:
        (case,) = module.cases(1, first=int(seed))
        assert case.seed == int(seed)
        error, _ = module.measure(case, name.strip("`"))
        # One unit of the last digit printed is a few per cent.
        assert error == pytest.approx(float(largest), rel=0.05), name
