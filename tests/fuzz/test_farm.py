"""A few cases of each part of the farm, and its table on the page. `make fuzz` runs more."""

import os
import re

import pytest

from fuzz import farm

PARTS = farm.parts()
#: Cases in every run of the suite, for other parts than calls.
CASES = {
    "files": 13,  # each command once that takes less than seconds
    "results": 15,
    "arms": 4,
    "equations": 4,
    "disk-full": 11,  # each format once
    "kills": 4,
    "output-full": 1,
    "stores": 2,
    "cache": 4,
    "compilation": 1,
    "dependencies": 0,  # minutes
}
needs_posix = pytest.mark.skipif(not hasattr(os, "fork"), reason="no processes to fork here")


@pytest.mark.sampled("calls-3", "compilation")
@needs_posix
@pytest.mark.parametrize("name", [name for name in PARTS if CASES.get(name, 60)])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_first_cases_have_no_defect(name):
    for number in range(CASES.get(name, 60)):
        try:
            with farm.interrupted_after(farm.PATIENCE):
                farm.run_case(name, PARTS[name], 0, number)
        except KeyboardInterrupt:  # allowed, so that the test does not depend on the machine
            continue
        except Exception as error:
            error.add_note(f"python tests/fuzz/farm.py {name} --seed 0 --case {number}")
            raise


def test_page_has_a_row_for_each_part():
    rows = re.findall(r"^\| `([a-z0-9-]+)` \| (.+?) \| .* \|$", farm.PAGE.read_text(), re.MULTILINE)
    assert dict(rows) == {name: part.meaning for name, part in PARTS.items()}


def test_counts_are_written_to_the_row(tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text("| `a` | old |\n| `b` | old |\n")
    monkeypatch.setattr(farm, "PAGE", page)
    counts = farm.run_part("b", farm.Part("meaning", _odd_numbers_fail), 3, 0.05)
    assert counts["defects"] in {counts["right"], counts["right"] - 1}
    farm.write_row("b", farm.row("b", farm.Part("meaning", _odd_numbers_fail), "3", "1.0", counts))
    total, defects = counts.total(), counts["defects"]
    row = f"| `b` | meaning | 1.0 | 3 | {total} | {defects} | 0 |\n"
    assert page.read_text() == f"| `a` | old |\n{row}"


def _odd_numbers_fail(rng, number):
    assert number % 2 == 0
