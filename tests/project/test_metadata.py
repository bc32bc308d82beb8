"""Package, citation, changelog and paper agree with each other."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import yaml

from flexarm.base.references import _entries

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
PAPER = (ROOT / "joss/paper.md").read_text(encoding="utf-8")
BIBLIOGRAPHY = (ROOT / "joss/paper.bib").read_text(encoding="utf-8")
ENTRIES = dict(re.findall(r"^@\w+\{(\w+),\n(.*?)^\}$", BIBLIOGRAPHY, re.MULTILINE | re.DOTALL))
CITED = _entries("")


def fields(entry: str) -> dict[str, str]:
    """Return the fields of a BibTeX entry, without the layout of its lines."""
    found = re.findall(r"(\w+) = \{((?:[^{}]|\{(?:[^{}]|\{[^{}]*\})*\})*)\}", entry)
    return {name: " ".join(text.split()) for name, text in found}


def test_citation_agrees_with_the_package() -> None:
    assert CITATION["version"] == PROJECT["version"]
    assert CITATION["license"] == PROJECT["license"]
    assert [author["name"] for author in CITATION["authors"]] == [
        author["name"] for author in PROJECT["authors"]
    ]
    # Both omit the address of the repository until it has one; then both have the same.
    assert CITATION.get("repository-code") == PROJECT.get("urls", {}).get("Repository")


def test_changelog_has_a_section_for_the_next_version() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = re.findall(r"^## \[([^\]]+)\]", text, flags=re.MULTILINE)
    assert sections[0] == "Unreleased"


def test_paper_has_the_required_sections_and_length() -> None:
    body = PAPER.split("---\n", maxsplit=2)[2]
    sections = re.findall(r"^# (.*)$", body, flags=re.MULTILINE)
    needed = ["Summary", "Statement of need", "State of the field", "Software design"]
    assert sections[:4] == needed
    assert sections[-1] == "References"
    assert 750 <= len(body.split()) <= 1750


def test_paper_names_the_authors_of_the_package() -> None:
    head = yaml.safe_load(PAPER.split("---\n", maxsplit=2)[1])
    assert [author["name"] for author in head["authors"]] == [
        author["name"] for author in CITATION["authors"]
    ]
    assert (ROOT / "joss" / head["bibliography"]).exists()


def test_every_reference_is_cited_and_every_citation_has_a_reference() -> None:
    assert len(ENTRIES) == BIBLIOGRAPHY.count("\n@") + BIBLIOGRAPHY.startswith("@")
    assert set(re.findall(r"@(\w+)", PAPER)) == set(ENTRIES)


@pytest.mark.parametrize("key", sorted(ENTRIES.keys() & CITED.keys()))
def test_references_equal_those_that_results_cite(key: str) -> None:
    assert fields(ENTRIES[key]) == fields(CITED[key])


@pytest.mark.parametrize("key", sorted(ENTRIES.keys() - CITED.keys()))
def test_other_references_have_an_identifier(key: str) -> None:
    assert re.fullmatch(r"10\.\d{4,}/\S+", fields(ENTRIES[key]).get("doi", ""))


def test_measured_ratios_of_the_paper_are_on_the_performance_page() -> None:
    """Rows of the paper's table: `| Exudyn | 1.3e-04 | 52.5 | 27.3 |`."""
    page = (ROOT / "docs/performance/index.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\w+)[^|]*\| ([\d.e-]+) \| ([\d.e+]+) \| ([\d.]+) \|$", PAPER, re.M)
    assert len(rows) >= 5
    for program, error, milliseconds, ratio in rows:
        wanted = rf"^\| {error} \| {program}, [^|]* \| {milliseconds} \| [^|]* \| {ratio} \|$"
        assert re.search(wanted.replace("+", r"\+"), page, re.M), (program, error)
