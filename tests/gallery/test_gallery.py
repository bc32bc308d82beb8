"""Every case of the gallery agrees with its references, and its pages state that."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from gallery.case import Case, Page, Row, Source
from gallery.cases import CASES, PAGES
from gallery.report import (
    FOLDER,
    case_text,
    named_quantities,
    picture,
    several_cites,
    shown_rows,
    write_index,
)

from gallery import __main__ as chore

ROOT = Path(__file__).parents[2]
#: Larger pictures make a slow page.
LARGEST_PICTURE = 150_000  # bytes


def allowed(row: Row) -> float:
    """Return the difference between values that agree to the required digits."""
    scale = abs(row.theirs) if row.scale is None else row.scale
    return 10.0**-row.digits_required * scale


def committed_section(case: Case) -> str:
    """Return a case's section of its page."""
    page = next(page for page in PAGES if case in page.cases)
    text = (FOLDER / f"{page.name}.md").read_text(encoding="utf-8")
    sections = re.split(r"^(?=## )", text, flags=re.MULTILINE)
    return next(part for part in sections if part.startswith(f"## {case.title}\n"))


def committed_rows(case: Case) -> list[list[str]]:
    """Return a case's rows in the table of its section: quantity with unit, values, ..."""
    lines = [line for line in committed_section(case).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def committed_count(case: Case) -> str:
    """Return the number of quantities that the section of a case states or shows."""
    stated = re.search(r"^(\d+) quantities;", committed_section(case), flags=re.MULTILINE)
    return stated[1] if stated else str(len(committed_rows(case)))


def prose(text: str) -> list[str]:
    """Return the lines of a page that have no numbers of a run."""
    return [line for line in text.splitlines() if not line.startswith("|")]


@pytest.mark.sampled("cantilever")
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case_agrees_with_its_references(case: Case, tmp_path: Path) -> None:
    rows = case.quantities()
    for row in rows:
        assert row.agrees, (
            f"{row.quantity}: {row.ours!r}, but {row.theirs!r} is known: "
            f"{row.digits_agreed:.2f} digits of {row.digits_required:.2f}"
        )
        perturbed = replace(row, ours=row.theirs + 1.05 * allowed(row))
        assert not perturbed.agrees, f"{row.quantity}: a wrong value passes"

    committed, shown = committed_rows(case), shown_rows(rows)
    assert [cells[0] for cells in committed] == named_quantities(shown)[1:]
    if several_cites(rows):
        sources = list(dict.fromkeys(row.source for row in rows))
        cites = [str(sources.index(row.source) + 1) for row in shown]
        assert [cells[4] for cells in committed] == cites
    for row, cells in zip(shown, committed, strict=True):
        for text, value in ((cells[1], row.theirs), (cells[2], row.ours)):
            assert abs(float(text) - value) <= allowed(row), f"{row.quantity}: run `make gallery`"

    picture(case, tmp_path / f"{case.name}.png")
    assert prose(committed_section(case).strip()) == prose(case_text(case, rows).strip())
    for folder in (tmp_path, FOLDER):
        assert 10_000 < (folder / f"{case.name}.png").stat().st_size < LARGEST_PICTURE


def test_cases_have_different_names() -> None:
    assert len({case.name for case in CASES}) == len({case.title for case in CASES}) == len(CASES)
    for case in CASES:
        assert (ROOT / case.module).exists(), case.module


def test_index_lists_every_case_with_its_quantities_and_the_readme_their_number() -> None:
    index = (FOLDER / "index.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[(.*?)\]\(.*?\) \| (\d+) \|", index, flags=re.MULTILINE)
    counts = {case.title: committed_count(case) for case in CASES}
    assert dict(rows) == counts
    total = sum(map(int, counts.values()))
    assert f"{total} quantities of {len(CASES)} cases" in index
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"compares {total} reference values" in readme


ROW = Row("length", "m", Source("ruler", "A ruler."), 2.0, 2.0 + 1e-5, 5.0, "a thick pencil")


def test_agreeing_digits_are_counted() -> None:
    assert ROW.digits_agreed == pytest.approx(-math.log10(5e-6))
    assert ROW.agrees
    assert not replace(ROW, ours=2.0 + 3e-5).agrees
    assert replace(ROW, scale=10.0).digits_agreed == pytest.approx(6.0)
    assert replace(ROW, ours=2.0).digits_agreed == 15.0
    for wrong in (math.nan, math.inf, -2.0):
        assert not replace(ROW, ours=wrong).agrees
    assert replace(ROW, theirs=0.0, ours=1e-7, scale=1.0).digits_agreed == pytest.approx(7.0)


@pytest.mark.parametrize(("ours", "status"), [(2.0 + 1e-5, 0), (2.0 + 3e-5, 1)])
def test_chore_fails_for_a_wrong_value(
    ours: float,
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    case = Case(
        name="ruler",
        title="Ruler",
        physics="A length.",
        quantities=lambda: [replace(ROW, ours=ours)],
        draw=lambda figure: figure.subplots().plot([0, 1]),
        caption="Nothing.",
        module="gallery/case.py",
    )
    monkeypatch.setattr(chore, "PAGES", (Page("lengths", "Lengths", (case,)),))
    monkeypatch.setattr(chore, "FOLDER", tmp_path)
    assert chore.main([]) == status
    assert ("is known" in capsys.readouterr().err) == bool(status)
    table = (tmp_path / "index.md").read_text(encoding="utf-8")
    assert "| [Ruler](lengths.md#ruler) | 1 | ruler | " in table
    page = (tmp_path / "lengths.md").read_text(encoding="utf-8")
    assert "| quantity [m] | reference" in page
    assert "| length | 2 | 2.0000" in page
    assert ("agree in all" in table) == (status == 0)
    assert chore.main(["rule"]) == 2


def test_pages_have_the_reasons_and_sources(tmp_path: Path) -> None:
    case = replace(CASES[0], quantities=lambda: [ROW])
    text = case_text(case, [ROW])
    for part in (case.title, "a thick pencil", "A ruler.", case.module, f"{case.name}.png"):
        assert part in text
    write_index(tmp_path, [Page("one", "One", (case,))], [(case, [ROW])])
    assert "1 quantities of 1 cases" in (tmp_path / "index.md").read_text(encoding="utf-8")
