"""Tables of records as text: a line of names, then a line of numbers for each row."""

from __future__ import annotations

import re
from itertools import zip_longest
from typing import Any

from flexarm.base.errors import InputError, Problem
from flexarm.model.checks import Record

_SPACES = re.compile(r"\s*[,;\t]\s*|\s+")
_NAME = re.compile(r"(\w+)(?:\[(\d{1,3})\])?$")


def table_text(record: Record) -> str:
    """Return the table of a record; the numbers of a list in a column have columns of their own."""
    columns = {name: getattr(record, name) for name in record._columns}
    head: list[str] = []
    cells: list[list[str]] = []
    for name, values in columns.items():
        if values is None:
            continue
        width = max((len(each) for each in values if isinstance(each, tuple)), default=0)
        head += [f"{name}[{k}]" for k in range(width)] or [name]
        rows = [each if isinstance(each, tuple) else (each,) for each in values]
        cells += [[_text(row[k]) for row in rows] for k in range(max(width, 1))]
    rows_text = [", ".join(row) for row in zip_longest(*cells, fillvalue="")]
    return "\n".join([", ".join(head), *rows_text])


def table_content(text: str, record: Record) -> dict[str, Any]:
    """Return the columns of a table in text as a file has them, for a record to check.

    The line of names may be missing. Cells that are not numbers remain text.

    Raises:
        InputError: if a row has more or fewer values than there are names.
    """
    rows = [_SPACES.split(line.strip()) for line in text.splitlines() if line.strip()]
    head = _SPACES.split(table_text(record).splitlines()[0])
    if rows and any(isinstance(_value(cell), str) for cell in rows[0]):
        head = rows.pop(0)
    found: dict[str, Any] = dict.fromkeys(record._columns)
    for k, row in enumerate(rows):
        if len(row) != len(head):
            rule = f"have {len(head)} values, one for each name"
            raise InputError(Problem(f"row {k + 1} of the table", rule, str(len(row))))
    for k, name in enumerate(head):
        match = _NAME.match(name)
        values = [_value(row[k]) for row in rows]
        if match is None or match[2] is None:
            found[name] = values
        else:
            entries = found.get(match[1]) or [[] for _ in rows]
            found[match[1]] = [[*old, value] for old, value in zip(entries, values, strict=True)]
    return {name: values for name, values in found.items() if values is not None}


def _text(value: float) -> str:
    return repr(value).removesuffix(".0")


def _value(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell
