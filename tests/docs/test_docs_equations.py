"""Equation numbers: cited ones exist, and each is defined once."""

from __future__ import annotations

import re
import runpy

import pytest
from docs_pages import ROOT, text_of

THEORY = sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs" / "theory").glob("*.md"))
_CITED = re.compile(r"\(([BCDFILMPRSTV])\.(\d+)([a-z]?)\)")
_TAG = re.compile(r"\\tag\{([BCDFILMPRSTV])\.(\d+)\}")


def tags() -> list[tuple[str, int]]:
    """Return letter and number of every equation of the theory pages."""
    return [(letter, int(n)) for page in THEORY for letter, n in _TAG.findall(text_of(page))]


def test_the_site_can_draw_every_equation() -> None:
    pytest.importorskip("math_core", reason="it comes with the extra: pip install 'flexarm[docs]'")
    pytest.importorskip("sphinx")
    site = runpy.run_path(str(ROOT / "docs" / "site" / "equations.py"))
    draw, tag = site["_converter"].convert_with_local_state, site["_TAG"]
    blocks = [
        block
        for page in THEORY
        for block in re.findall(r"^\$\$(.+?)\$\$$", text_of(page), re.M | re.S)
    ]
    assert len(blocks) > 300
    for block in blocks:
        assert "<math" in draw(tag.sub("", block), displaystyle=True)


def test_numbers_are_unique_and_consecutive() -> None:
    found = tags()
    assert len(found) == len(set(found))
    for letter in "BCDFILMPRSTV":
        numbers = sorted(n for other, n in found if other == letter)
        # Pages on control begin at (C.1), (C.20), (C.40), ..., so that each can grow.
        starts = [1, *range(20, 200, 20)] if letter == "C" else [1]
        gaps = [n for n in numbers if n - 1 not in numbers and n not in starts]
        assert not gaps, f"({letter}.n) has gaps before {gaps}"


def test_numbers_of_pages_on_control_are_consecutive() -> None:
    """Each page on control has a range of numbers, from (C.1), (C.20), (C.40), ... on."""
    index, checked = text_of("docs/theory/index.md"), 0
    for page in (page for page in THEORY if "control" in page):
        numbers = [int(n) for letter, n in _TAG.findall(text_of(page)) if letter == "C"]
        if not numbers:  # a letter of its own
            continue
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), page
        assert f"(C.{numbers[0]}) to (C.{numbers[-1]})" in index, f"the index on {page}"
        checked += 1
    assert checked > 1


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


def test_index_states_the_last_equation_of_each_page() -> None:
    given = r"\((\w+)\.md\) \| \(([BCDFILMPRSTV])\.(\d+)\) to \(\2\.(\d+)\)"
    ranges = re.findall(given.replace(r"\w+", r"[\w-]+"), text_of("docs/theory/index.md"))
    assert len(ranges) == len(THEORY) - 1  # all pages except the index
    for page, letter, first, last in ranges:
        text = text_of(f"docs/theory/{page}.md")
        numbers = [int(n) for other, n in _TAG.findall(text) if other == letter]
        reported = f"the index says ({letter}.{first}) to ({letter}.{last}) of {page}"
        assert (min(numbers), max(numbers)) == (int(first), int(last)), reported
