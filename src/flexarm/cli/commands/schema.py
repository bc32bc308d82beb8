"""``flexarm schema``: print or write the JSON schema of a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from flexarm.cli.options import option

Kind = Literal["scenario", "arm", "study"]


def schema(
    kind: Annotated[Kind, typer.Option(help="Kind of file.")] = "scenario",
    out: Annotated[Path | None, option("FILE", "Save the schema: .json.")] = None,
) -> None:
    """Print the JSON schema of files, from which editors complete and check."""
    import json

    from flexarm.base.writing.places import check_place, write_text
    from flexarm.model.file_format.files import json_schema

    text = json.dumps(json_schema(kind), indent=2) + "\n"
    if out is None:
        print(text, end="")
    else:
        write_text(text, check_place("--out", out, (".json",)))
