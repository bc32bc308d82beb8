"""``flexarm report``: write the report of a result file."""

from __future__ import annotations

from pathlib import Path

from flexarm.cli.tables import console
from flexarm.errors import InputError
from flexarm.identification.storage import is_identification
from flexarm.output import read_result
from flexarm.plot.drawn_arm import check_drawable
from flexarm.reporting import report
from flexarm.reporting.document import template_engine
from flexarm.writing.places import check_place


def report_file(
    path: Path, out: Path | None, title: str | None, magnify: float, rigid: bool
) -> None:
    """Write the report of a result file, by default beside it.

    Raises:
        InputError: if the file is not a result with an arm, the report cannot be written, or
            Jinja2 is not installed.
    """
    template_engine()
    result = read_result(path)
    if not is_identification(result):
        try:
            check_drawable("the file", result)
        except InputError as error:
            raise error.at(str(path)) from None
    place = check_place("--out", out or path.with_suffix(".html"), (".html",))
    report(result, place, title=title or path.stem, magnify=magnify, rigid=rigid)
    console().print(f"report in {place}", soft_wrap=True)
