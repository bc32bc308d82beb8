"""Equation numbers: those cited exist, and each is given once."""

from __future__ import annotations

import re

import pytest
from docs_pages import ROOT, text_of

THEORY = sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs" / "theory").glob("*.md"))
_CITED = re.compile(r"\(([BCDILPRST])\.(\d+)([a-z]?)\)")
_TAG = re.compile(r"\\tag\{([BCDILPRST])\.(\d+)\}")


def tags() -> list[tuple[str, int]]:
    """Letter and number of every equation of the theory pages."""
    return [(letter, int(n)) for page in THEORY for letter, n in _TAG.findall(text_of(page))]


def test_each_number_is_given_once_and_none_is_left_out() -> None:
    found = tags()
    assert len(found) == len(set(found))
    for letter in "BDILPRST":
        numbers = sorted(n for other, n in found if other == letter)
        assert numbers == list(range(1, len(numbers) + 1)), f"({letter}.n) has gaps: {numbers}"
    # Control has a block of twenty numbers for each of its pages, so that each can grow.
    control = {n for letter, n in found if letter == "C"}
    for n in control:
        assert n % 20 == 0 or n == 1 or n - 1 in control, f"(C.{n}) follows a gap"


@pytest.mark.parametrize("folder", ["src", "tests", "docs"])
def test_cited_equations_exist(folder: str) -> None:
    known = set(tags())
    files = [*(ROOT / folder).rglob("*.py"), *(ROOT / folder).rglob("*.md")]
    cited = 0
    for path in files:
        for letter, number, _ in _CITED.findall(path.read_text(encoding="utf-8")):
            cited += 1
            name = f"({letter}.{number})"
            assert (letter, int(number)) in known, f"{path.relative_to(ROOT)} cites {name}"
    assert cited or folder == "tests", f"nothing under {folder} cites an equation"


def test_index_knows_the_last_equation_of_each_page() -> None:
    ranges = re.findall(r"\(([BCDILPRST])\.1\) to \(\1\.(\d+)\)", text_of("docs/theory/index.md"))
    assert len(ranges) == 8
    for letter, last in ranges:
        count = sum(1 for other, _ in tags() if other == letter)
        assert int(last) == count, f"the index says ({letter}.{last}), the pages have {count}"
