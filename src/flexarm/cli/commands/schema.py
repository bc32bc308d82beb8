"""``flexarm schema``: print or write the JSON schema of a kind of file."""

from __future__ import annotations

import json
from pathlib import Path

from flexarm.model.file_format.schema import json_schema


def print_schema(kind: str, out: Path | None) -> None:
    """Print the JSON schema of a kind of file, or write it to ``out``."""
    text = json.dumps(json_schema(kind), indent=2) + "\n"
    if out is None:
        print(text, end="")
        return
    from flexarm.base.writing.places import check_place, write_text

    write_text(text, check_place("--out", out, (".json",)))
