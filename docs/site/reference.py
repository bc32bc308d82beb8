"""Pages of the Python interface: docstrings, a page for each table of names.

The tables, their names and their order are those of ``docs/reference/python-api.md``, which
``tests/docs/reference_tables.py`` makes.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import flexarm as fa
from flexarm.model.checks import Record, descriptions_of

_PART = re.compile(
    r"^## (?P<title>[^\n]+)\n(?:(?!^## ).)*?<!-- begin (?P<part>\w+) -->(?P<table>.*?)<!-- end",
    re.DOTALL | re.MULTILINE,
)
_ROW = re.compile(r"^\| `(?:fa\.)?(\w[\w.]*)(.*?)` \|", re.MULTILINE)
#: Where inherited members end: those of other packages are not documented here.
_FOREIGN = "BaseModel, Exception, UserWarning, Mapping, ABC, tuple"
#: Rows of methods of an arm; they are on the page of its class.
_METHOD = "arm."


def write_reference(folder: Path) -> None:
    """Write a page for each table of the entry page, and link the names in the tables to them."""
    entry = folder / "python-api.md"
    text = entry.read_text(encoding="utf-8")
    (folder / "api").mkdir()
    parts = []
    for match in _PART.finditer(text):
        names = [name for name, _ in _ROW.findall(match["table"]) if not name.startswith(_METHOD)]
        if names:
            page = "\n".join([f"# {match['title']}\n", *map(_section, names)])
            (folder / "api" / f"{match['part']}.md").write_text(page, encoding="utf-8")
            parts.append(f"api/{match['part']}")
    lines = "\n".join(parts)
    toctree = f"\n\n```{{toctree}}\n:hidden:\n\n{lines}\n```\n"
    entry.write_text(_ROW.sub(_linked, text) + toctree, encoding="utf-8")


def _linked(row: re.Match[str]) -> str:
    """Return the first cell of a row with a link to the docstring."""
    name, arguments = row.groups()
    goal = f"Arm.{name.removeprefix(_METHOD)}" if name.startswith(_METHOD) else name
    return f"| [`{name}`](#flexarm.{goal})" + (f"`{arguments}` |" if arguments else " |")


def _section(name: str) -> str:
    """Return the section of one public name."""
    value = fa
    for part in name.split("."):
        value = getattr(value, part)
    kind, options = "function", ""
    if inspect.isclass(value):
        kind = "exception" if issubclass(value, BaseException) else "class"
        options = f"   :members:\n   :inherited-members: {_FOREIGN}\n"
    return f"## {name}\n\n```{{eval-rst}}\n.. auto{kind}:: flexarm.{name}\n{options}```\n"


def add_fields(
    _app: object, _what: str, _name: str, value: object, _options: object, lines: list[str]
) -> None:
    """Add the keys of a record, with their descriptions, to its docstring (autodoc)."""
    if not (inspect.isclass(value) and issubclass(value, Record)):
        return
    for name, text in descriptions_of(value).items():
        field = value.model_fields[name]
        if name != "kind":
            default = "" if field.is_required() else f" Default: ``{field.default!r}``."
            lines.append(f":param {name}: {text}{default}")
    lines.append("")


def skip_foreign(
    _app: object, _what: str, name: str, value: object, skip: bool, _options: object
) -> bool:
    """Skip fields of named tuples, described by their class, and pydantic settings (autodoc)."""
    alias = (inspect.getdoc(value) or "").startswith("Alias for field number")
    return skip or alias or name == "model_config"
