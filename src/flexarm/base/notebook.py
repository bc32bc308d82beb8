"""HTML tables for the display of objects in notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from flexarm.base.errors import printable


def html_table(title: str, heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with a caption; floats have five digits, all other values are text."""
    parts = [f'<table><caption style="text-align: left">{_text(title)}</caption>']
    parts += ["<thead>", _row("th", heads), "</thead><tbody>"]
    parts += [_row("td", row) for row in rows]
    return "".join([*parts, "</tbody></table>"])


def _row(tag: str, cells: Sequence[object]) -> str:
    return "<tr>" + "".join(f"<{tag}>{_text(cell)}</{tag}>" for cell in cells) + "</tr>"


def _text(cell: object) -> str:
    return escape(printable(f"{cell + 0.0:.5g}" if isinstance(cell, float) else str(cell)))
