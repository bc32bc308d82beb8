"""Write the pages of the gallery: a table of all cases, and pages with a picture for each case."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

from flexarm.view.plot.style import Sheet, styled
from gallery.case import Case, Page, Row, Source

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "gallery"

DPI = 160

#: Numbers in the name of a quantity.
_NUMBER = re.compile(r"\d[\d./]*")

#: Rows of a case beside the case.
Results = Sequence[tuple[Case, Sequence[Row]]]

_INDEX = """# Validation gallery

When two simulators disagree, which one is right? These pages compare the package with problems
that have a known solution. `make gallery` and the tests compute every number again.

*Digits* is the number of digits that agree, -log₁₀ of the difference relative to the reference
value, and in brackets the number that the tests require. For distances, and for values that pass
through zero, the difference is relative to a scale: the reach of the arm or the length of the beam.
The pages give the reason for the required number: a mesh, a truncated theory, or the last printed
digit of the reference.

{pictures}

{count} quantities of {cases} cases; enough digits agree in {good}.

"""


def table_row(cells: Sequence[str]) -> str:
    """One line of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def shown_values(row: Row) -> tuple[str, str]:
    """Reference and computed value, to one digit more than agree or are requested."""
    digits = max(6, math.ceil(max(row.digits_agreed, row.digits_required)) + 1)
    count = min(15, digits)
    if row.theirs == 0.0:
        return "0", f"{row.ours:.2g}"
    return f"{row.theirs:.{count}g}", f"{row.ours:.{count}g}"


def shown_digits(row: Row) -> str:
    """Digits that agree, and in brackets those required, both rounded down."""
    agreed, required = (math.floor(10 * d) / 10 for d in (row.digits_agreed, row.digits_required))
    return f"{agreed:.1f} ({required:.1f})"


def index_text(pages: Sequence[Page], results: Results) -> str:
    """The page that lists every case, with the range of the digits that agree."""
    rows = [row for _, rows in results for row in rows]
    good = sum(row.agrees for row in rows)
    links = {case.name: _link(page, case) for page in pages for case in page.cases}
    head = ("case", "quantities", "sources", "digits that agree")
    lines = [table_row(head), table_row(["---"] * len(head))]
    for case, own in results:
        digits = [math.floor(10 * row.digits_agreed) / 10 for row in own]
        sources = "; ".join(dict.fromkeys(row.source.cite for row in own))
        cells = (f"[{case.title}]({links[case.name]})", str(len(own)), sources)
        lines.append(table_row((*cells, f"{min(digits):.1f} to {max(digits):.1f}")))
    counted = "all" if good == len(rows) else f"{good} of them"
    pictures = picture_table([(case, links[case.name]) for case, _ in results])
    text = _INDEX.format(count=len(rows), cases=len(results), good=counted, pictures=pictures)
    return text + "\n".join(lines) + "\n"


def _link(page: Page, case: Case) -> str:
    """Address of a case: its page, and the anchor of its heading."""
    anchor = re.sub(r"[^\w\- ]", "", case.title.lower()).replace(" ", "-")
    return f"{page.name}.md#{anchor}"


def picture_table(links: Sequence[tuple[Case, str]]) -> str:
    """Return the pictures of all cases, three in a row, each a link to its section."""
    lines = [table_row([" "] * 3), table_row(["---"] * 3)]
    for first in range(0, len(links), 3):
        row = links[first : first + 3]
        cells = [f"[![{c.title}]({c.name}.png)]({link})<br>{c.title}" for c, link in row]
        lines.append(table_row(cells + [""] * (3 - len(cells))))
    return "\n".join(lines)


def shown_rows(rows: Sequence[Row]) -> list[Row]:
    """The last row of each kind: names that differ in numbers alone, as times and modes do."""
    kinds = {(_NUMBER.sub("", row.quantity), row.source, row.reason): row for row in rows}
    return list(kinds.values())


def _table(rows: Sequence[Row], sources: Sequence[Source], reasons: Sequence[str]) -> str:
    """The table of a case; sources and reasons have a column if they differ between rows.

    It is one column for both if they have the same numbers in all rows.
    """
    notes = {}
    if several_cites(rows):
        notes["source"] = [str(sources.index(row.source) + 1) for row in rows]
    if len(reasons) > 1:
        notes["reason"] = [str(reasons.index(row.reason) + 1) for row in rows]
    if len(notes) > 1 and notes["source"] == notes["reason"]:
        notes = {"source, reason": notes["source"]}
    quantity, *names = named_quantities(rows)
    head = [quantity, "reference", "flexarm", "digits", *notes]
    lines = [table_row(head), table_row(["---"] * len(head))]
    for name, row, *marks in zip(names, rows, *notes.values(), strict=True):
        lines.append(table_row([name, *shown_values(row), shown_digits(row), *marks]))
    return "\n".join(lines)


def several_cites(rows: Sequence[Row]) -> bool:
    """Whether the rows of a case have sources of more than one kind."""
    return len({row.source.cite for row in rows}) > 1


def named_quantities(rows: Sequence[Row]) -> list[str]:
    """Heading and names of quantities, with units in brackets; a common unit is in the heading."""
    units = [f" [{row.unit}]" if row.unit != "1" else "" for row in rows]
    if len({*units}) == 1:
        return [f"quantity{units[0]}", *(row.quantity for row in rows)]
    return ["quantity", *(row.quantity + unit for row, unit in zip(rows, units, strict=True))]


def _list(title: str, items: Sequence[str], numbered: bool) -> str:
    """A list under its title, or one line for a single item."""
    if len(items) == 1:
        return f"**{title}**: {items[0]}"
    marks = (f"{k}." if numbered else "-" for k in range(1, len(items) + 1))
    return f"**{title}**\n\n" + "\n".join(f"{m} {x}" for m, x in zip(marks, items, strict=True))


def case_text(case: Case, rows: Sequence[Row]) -> str:
    """The section of one case."""
    reasons = list(dict.fromkeys(row.reason for row in rows))
    sources = list(dict.fromkeys(row.source for row in rows))
    cites = [f"{source.cite}: {source.full}" for source in sources]
    shown = shown_rows(rows)
    table = _table(shown, sources, reasons)
    if len(shown) < len(rows):
        table += f"\n\n{len(rows)} quantities; the table has the last one of each kind."
    parts = [
        f"## {case.title}",
        case.physics.strip(),
        f"![{case.title}]({case.name}.png)",
        f"*{case.caption}*",
        table,
        _list("Reasons for the digits", reasons, numbered=True),
        _list("Sources", cites, numbered=several_cites(rows)),
        f"Code: [`{case.module}`](../../{case.module}).",
    ]
    return "\n\n".join(parts) + "\n"


def picture(case: Case, path: Path) -> None:
    """Draw the picture of a case into a PNG file."""
    sheet = Sheet(*case.size, layout="constrained")
    with styled():
        case.draw(sheet)
    small = {"compress_level": 9}  # the pages load these pictures together
    sheet.savefig(path, format="png", metadata={"Software": None}, dpi=DPI, pil_kwargs=small)


def page_text(page: Page, results: Results) -> str:
    """The text of a page, with the results of its cases."""
    own = {case.name: rows for case, rows in results}
    sections = [case_text(case, own[case.name]) for case in page.cases]
    head = [f"# {page.title}", "[All cases](index.md).", page.introduction.strip()]
    return "\n".join(["\n\n".join(filter(None, head)) + "\n", *sections])


def write_page(folder: Path, page: Page, results: Results) -> None:
    """Write a page with the results of all of its cases."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{page.name}.md").write_text(page_text(page, results), encoding="utf-8")


def write_index(folder: Path, pages: Sequence[Page], results: Results) -> None:
    """Write the table of all cases."""
    (folder / "index.md").write_text(index_text(pages, results), encoding="utf-8")
