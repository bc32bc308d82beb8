"""The tables of the default beside the best method: on the page, and measured again on an arm."""

from __future__ import annotations

import numpy as np
import pytest
from docs_pages import text_of
from reference_tables import table_rows

from page_scripts import script

PAGE = "docs/performance/accuracy.md"


@pytest.fixture(scope="module")
def module():
    return script("measure_choice")


def test_cost_at_an_error_is_interpolated(module) -> None:
    """Errors of order 2: four times the error costs half the evaluations."""
    outcomes = [(1e-4, 100.0), (4e-4, 50.0), (np.inf, np.inf)]
    assert module.cost_at(2e-4, outcomes) == pytest.approx(100.0 / np.sqrt(2.0))
    assert module.cost_at(1e-3, outcomes) == 50.0
    assert module.cost_at(1e-5, outcomes) == np.inf


def test_tables_count_arms_by_ratio_and_kind(module) -> None:
    costs = dict.fromkeys(module.INTEGRATORS, 1.05)
    found = [
        module.Compared("stops", 1e-9, 1.0, 3.0, costs),
        module.Compared("stops", 3e-9, 5.0, 5.0, costs),
        module.Compared("friction", 1e-7, 1.5, 2.0, costs),
    ]
    text = module.tables(found)
    assert "| 1 to 1.1 | 1 |" in text
    assert "| 4 to inf | 1 |" in text
    assert "| `rk4` | 3 | 1.1 |" in text
    assert "| stops | 2 | 2e-09 | 3e-09 | 4.0 | 5 |" in text
    assert "| neither |" not in text


def test_page_has_the_arms_of_the_script(module) -> None:
    assert sum(int(arms) for _, arms in table_rows(PAGE, "choice")) == 70
    kinds = table_rows(PAGE, "promise")
    assert sum(int(cells[1]) for cells in kinds) == 70
    # The page says that no error exceeds the promise, and that one run stops.
    errors = [float(cells[3]) for cells in kinds]
    assert max(filter(np.isfinite, errors)) < module.PROMISED
    assert np.isinf(errors).sum() == text_of(PAGE).count("(seed 61) ends with an error")
    assert "measure_choice.py" in text_of(PAGE)


@pytest.mark.thorough
def test_first_arm_is_within_the_rows_of_the_page(module) -> None:
    found = module.compare(next(module.cases(1)))
    kinds = {cells[0]: cells for cells in table_rows(PAGE, "promise")}
    _, _, _, largest, _, most = kinds[found.kind]
    # One unit of the only digit printed is up to a half.
    assert found.error <= 1.5 * float(largest)
    assert found.promised <= float(most) + 0.5
    assert found.ratio >= 1.0
