"""``flexarm report``: write the report of a result file."""

from __future__ import annotations

from pathlib import Path

from flexarm.base.errors import InputError
from flexarm.base.writing.places import check_place
from flexarm.cases.results import read_result
from flexarm.cli.tables import console
from flexarm.identification.result import is_identification
from flexarm.view.plot.drawn_arm import check_drawable
from flexarm.view.reporting import report
from flexarm.view.reporting.document import template_engine


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
