"""Links between pages have targets, files that pages name exist, and tables are whole."""

from __future__ import annotations

import re

import pytest
from docs_pages import ROOT, anchors, pages, prose

_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
#: Spaces inside a link, which is then shown as text.
_BROKEN = re.compile(r"\] ?\([^)\s]* [^)\s]*\.md[^)]*\)|\] \([^)\s]*\.md[^)]*\)")
_HTML = re.compile(r"(?:src|href)=\"([^\"]+)\"")
#: First two lines of a group of lines that begin with a bar.
_TABLE = re.compile(r"^\n\|.*\n(.*)", re.MULTILINE)
_NAMED = re.compile(r"`((?:src|tests|docs|examples|benchmarks)/[\w./-]+)`")


@pytest.mark.thorough_cases("docs/reference/file-format.md")
@pytest.mark.parametrize("page", pages())
def test_links_resolve(page: str) -> None:
    text = prose(page)
    assert _BROKEN.findall(text) == []
    for target in _LINK.findall(text) + _HTML.findall(text):
        if target.startswith(("http://", "https://", "mailto:")):
            continue
        name, _, anchor = target.partition("#")
        path = ((ROOT / page).parent / name).resolve() if name else ROOT / page
        assert path.exists(), f"{page}: {target} does not exist"
        if anchor:
            known = anchors(str(path.relative_to(ROOT)))
            assert anchor in known, f"{page}: {target}: no such heading; there are {sorted(known)}"


def test_named_files_exist() -> None:
    for page in pages():
        for name in _NAMED.findall(prose(page)):
            assert (ROOT / name).exists(), f"{page} names {name}, which does not exist"


def test_rows_of_tables_are_below_a_head() -> None:
    """Rows behind an empty line are shown as text with bars."""
    for page in pages():
        heads = _TABLE.findall(prose(page))
        assert [line for line in heads if not re.fullmatch(r"\|[ :|-]+\|", line)] == [], page


def test_patterns_find_links_and_files() -> None:
    """Otherwise the tests above could not fail."""
    text = '[a](b.md) <img src="c.png"> `docs/d.md`'
    assert _TABLE.findall("a\n\n| b |\n| - |\n| c |\n\n| d |\ne\n") == ["| - |", "e"]
    found = (_LINK.findall(text), _HTML.findall(text), _NAMED.findall(text))
    assert found == (["b.md"], ["c.png"], ["docs/d.md"])


def test_every_page_is_reachable() -> None:
    """By links from the README, in any number of steps."""
    reached, ahead = set(), {"README.md"}
    while ahead:
        page = ahead.pop()
        reached.add(page)
        for target in _LINK.findall(prose(page)):
            path = ((ROOT / page).parent / target.partition("#")[0]).resolve()
            if path.suffix == ".md" and path.is_relative_to(ROOT):
                ahead.add(str(path.relative_to(ROOT)))
        ahead -= reached
    assert set(pages()) <= reached, f"no link leads to {sorted(set(pages()) - reached)}"
