"""Wrong calls, and what they raise word for word.

Each table ``*.txt`` of this folder reads like a session of Python: after a call stand the kind and
the message of its error, wrapped; lines without an error prepare the next ones. All names of
``arms`` and ``controllers`` are there. After a change of wording, ``WRITE=1 python -m pytest
tests/messages`` writes the tables again: read the difference.
"""

from __future__ import annotations

import doctest
import os
import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

import arms
import controllers
import flexarm as fa

TABLES = sorted(Path(__file__).parent.glob("*.txt"))
WIDTH = 116
#: Addresses of objects and rounding errors, which are different on other machines, and their place.
VARYING = ((r"0x[0-9a-f]+", "0x..."), (r"-?\d(\.\d+)?e-1[5-9]", "0"))


def raised(source: str, names: dict[str, object]) -> str:
    """Execute the lines; return kind and message of their error, or nothing."""
    try:
        exec(source, names)
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        for pattern, placeholder in VARYING:
            text = re.sub(pattern, placeholder, text)
        return "".join(f"{_wrapped(line)}\n" for line in text.splitlines())
    return ""


def _wrapped(line: str) -> str:
    return textwrap.fill(
        line, WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )


def _entered(source: str) -> str:
    """Return the lines with the prompts of Python."""
    first, *others = source.splitlines(keepends=True)
    return ">>> " + first + "".join("... " + line for line in others)


def today(table: str) -> str:
    """Return the table with the messages of today."""
    names: dict[str, object] = {**vars(arms), **vars(controllers), "fa": fa, "np": np}
    return "".join(
        piece if isinstance(piece, str) else _entered(piece.source) + raised(piece.source, names)
        for piece in doctest.DocTestParser().parse(table)
    )


@pytest.mark.parametrize("table", TABLES, ids=lambda path: path.stem)
def test_messages_are_those_of_the_table(table, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    kept = table.read_text(encoding="utf-8")
    found = today(kept)
    if os.environ.get("WRITE"):
        table.write_text(found, encoding="utf-8")
    else:
        assert found.splitlines() == kept.splitlines()
