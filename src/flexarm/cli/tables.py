"""Plain tables for the output of commands, for a terminal with 80 columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from flexarm.base.errors import printable

if TYPE_CHECKING:
    from flexarm.cases.results import Savable


class _Screen(Console):
    """Console that removes control codes from names and paths of users."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Convert a string to printable text, line by line."""
        return super().render_str("\n".join(map(printable, text.split("\n"))), **options)


def console() -> Console:
    """Return the standard output without highlighting of numbers."""
    return _Screen(highlight=False, markup=False, emoji=False)


def print_line(text: object) -> None:
    """Print a line or a table that is as wide as its content."""
    console().print(text, soft_wrap=True)


def save_figure(figure: Savable, path: Path, content: str = "plot") -> None:
    """Write a figure, and print its content and its path."""
    from flexarm.cases.results import write_figure

    write_figure(figure, path)
    print_line(f"{content} in {path}")


def facts(rows: Iterable[tuple[str, str]]) -> Table:
    """Create a table of names and values."""
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(name, value)
    return table


def numbers(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Create a table of numbers with names in the first column and right-aligned values."""
    table = Table(
        title=title, box=SIMPLE_HEAD, title_justify="left", title_style="bold", pad_edge=False
    )
    for k, head in enumerate(heads):
        table.add_column(head, justify="left" if k == 0 else "right")
    for row in rows:
        table.add_row(*row)
    return table
