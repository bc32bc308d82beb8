"""``flexarm report``: write the report of a result file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import flexarm as fa
from flexarm.base.errors import InputError
from flexarm.cli.options import argument, flag, option
from flexarm.cli.tables import print_line


def report(
    result: Annotated[Path, argument("RESULT.nc", "Result of `flexarm run` or `identify`.")],
    out: Annotated[Path | None, option("FILE", "The .html file; default: beside it.")] = None,
    title: Annotated[str | None, option("TEXT", "Title; by default the name of the file.")] = None,
    magnify: Annotated[
        float | None,
        typer.Option(
            metavar="FACTOR",
            min=0,
            max=10_000,
            help="Factor on the drawn bending; by default it is drawn at about 5 % of a link.",
        ),
    ] = None,
    rigid: Annotated[
        bool, flag("--rigid", "Also draw the rigid arm at the same joint angles.")
    ] = False,
) -> None:
    """Write a report of a run or an identification: one HTML page with all numbers."""
    from flexarm.base.writing.places import check_place
    from flexarm.identification.result import is_identification
    from flexarm.view.plot.drawn_result import check_drawable
    from flexarm.view.reporting import template_engine

    template_engine()
    dataset = fa.read_result(result)
    if not is_identification(dataset):
        try:
            check_drawable("the file", dataset)
        except InputError as error:
            raise error.at(str(result)) from None
    place = check_place("--out", out or result.with_suffix(".html"), (".html",))
    options: dict[str, Any] = {"magnify": "auto" if magnify is None else magnify, "rigid": rigid}
    fa.report(dataset, place, title=title or result.stem, **options)
    print_line(f"report in {place}")
