"""The table of default steps on random arms: rows of the page, made again on a few of the arms."""

from __future__ import annotations

import importlib.util
import re

import pytest
from reference_tables import ROOT, part_pattern

PAGE = ROOT / "docs" / "how-to" / "choose-an-integrator.md"
SCRIPT = ROOT / "docs" / "how-to" / "measure_default_step.py"
#: The first arms of the page, measured again with every method.
ARMS = 3


@pytest.fixture(scope="module")
def module():
    spec = importlib.util.spec_from_file_location("measure_default_step", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def rows():
    """Cells of the page: integrator, runs, wrong, failed, largest error, its seed, evaluations."""
    found = part_pattern("default steps").search(PAGE.read_text(encoding="utf-8"))
    assert found is not None
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in found[1].splitlines()[2:]]


def test_the_page_has_a_row_for_each_fixed_step_method(module, rows):
    assert [row[0].strip("`") for row in rows] == list(module.METHODS)
    arms = re.search(r"\[(\d+) random arms\]", PAGE.read_text(encoding="utf-8"))
    assert arms is not None
    assert {row[1] for row in rows} == {arms[1]}


def test_the_first_arms_are_within_the_rows_of_the_page(module, rows):
    for case in module.cases(ARMS):
        for name, _, _, failed, largest, _, _ in rows:
            error, evaluations = module.measure(case, name.strip("`"))
            assert evaluations > 0
            if error is None:
                assert int(failed) > 0, name
            else:
                # One unit of the last digit printed is a few per cent.
                assert error <= 1.05 * float(largest), name


def test_the_largest_errors_of_the_page_repeat(module, rows):
    """Each row names the seed of its largest error, which is measured again."""
    for name, _, _, _, largest, seed, _ in rows:
        (case,) = module.cases(1, first=int(seed))
        assert case.seed == int(seed)
        error, _ = module.measure(case, name.strip("`"))
        # One unit of the last digit printed is a few per cent.
        assert error == pytest.approx(float(largest), rel=0.05), name
