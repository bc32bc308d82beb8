"""Tables of the reference pages, generated from the code.

Run this file to write them into the pages: ``python tests/docs/reference_tables.py``. The test
``test_docs_reference.py`` fails if a page differs from the code.
"""

from __future__ import annotations

import os
import re
import sys
from functools import cache
from itertools import pairwise
from typing import Any

from docs_pages import ROOT
from python_tables import python_tables

from flexarm.control.laws import CONTROLLERS
from flexarm.model import json_schema
from flexarm.model.drives import CONTROLLED
from flexarm.model.units import unit_of
from flexarm.simulation.run.channels import CHANNELS, LIMITS, Channel

FILE_FORMAT = "docs/reference/file-format.md"
PYTHON = "docs/reference/python-api.md"
RESULT = "docs/reference/channels.md"
STUB = "src/flexarm/__init__.pyi"

_SHORT = {word.lower(): word for word in ("PD", "PID", "LQG", "MPC", "RBF")}


@cache
def _schema() -> dict[str, Any]:
    return json_schema()


@cache
def _definitions() -> dict[str, Any]:
    """Return every mapping of the file format by the name of its record."""
    return json_schema("study")["$defs"] | _schema()["$defs"]


@cache
def generated() -> dict[tuple[str, str], str]:
    """Return the text of every generated part by page and name of the part."""
    parts = {(RESULT, "channels"): channel_table(CHANNELS, ("time",))}
    parts |= {(RESULT, "limits"): channel_table(LIMITS), (FILE_FORMAT, "file"): _keys(_schema())}
    parts[FILE_FORMAT, "study"] = _keys(json_schema("study"))
    parts |= {(PYTHON, name): table for name, table in python_tables().items()}
    for name, definition in _definitions().items():
        if _has_keys(definition):
            parts[FILE_FORMAT, name] = _keys(definition)
    return parts


def _has_keys(definition: dict[str, Any]) -> bool:
    return bool(definition["properties"].keys() - {"kind"})


def channel_table(channels: dict[str, Channel], before: tuple[str, ...] = ()) -> str:
    """Return the Markdown table of channels of a result; ``before``: dimensions in front."""
    rows = ["| name | dimensions | unit | meaning |", "| --- | --- | --- | --- |"]
    for channel in channels.values():
        dims = ", ".join((*before, *channel.dims))
        rows.append(f"| `{channel.name}` | {dims} | {channel.unit} | {channel.meaning} |")
    return "\n".join(rows)


def _keys(definition: dict[str, Any]) -> str:
    """Return the Markdown table of the keys of one mapping of the file format."""
    required = definition.get("required", [])
    rows = ["| key | value | unit | default | meaning |", "| --- | --- | --- | --- | --- |"]
    for key, schema in definition["properties"].items():
        meaning, unit = _meaning_and_unit(schema.get("description", "Kind of the entry."))
        default = "**required**" if key in required else _default(schema)
        rows.append(f"| `{key}` | {_value(schema)} | {unit} | {default} | {meaning} |")
    return "\n".join(rows)


def _meaning_and_unit(description: str) -> tuple[str, str]:
    unit = unit_of(description)
    if not unit:
        return description, ""
    meaning = re.sub(rf"\s*\({re.escape(unit)}\)", "", description, count=1)
    return meaning, unit.replace("^2", "²").replace("^3", "³")


def _default(schema: dict[str, Any]) -> str:
    value = schema.get("default")
    if value is None or value == [] or isinstance(value, dict):
        return "none"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, list):
        return f"`[{', '.join(f'{number:g}' for number in value)}]`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def title(definition: str) -> str:
    """Return the name of a mapping of the file format in words:

    ``JointPDDrive`` is a joint PD drive.
    """
    words = re.findall(r"[A-Z]+(?![a-z])|[A-Z][a-z]+", definition.removesuffix("Spec"))
    return " ".join(word if word.isupper() else word.lower() for word in words).capitalize()


def _value(schema: dict[str, Any], many: bool = False) -> str:
    """Return the type of a key's value, with its bounds; ``many`` is the plural, in a list."""
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return " or ".join(f"`{choice}`" for choice in schema["enum"])
    if "$ref" in schema:
        return _mapping(schema["$ref"].rpartition("/")[2])
    for union in ("anyOf", "oneOf"):
        if union in schema:
            members = [_value(member) for member in schema[union] if member.get("type") != "null"]
            return " or ".join(members)
    if schema["type"] == "array":
        return _list(schema, many)
    if schema["type"] == "object":
        return f"names, and for each {_value(schema['additionalProperties'])}"
    return _scalar(schema, many)


def _mapping(name: str) -> str:
    properties = _definitions()[name]["properties"]
    if not _has_keys(_definitions()[name]):
        return f"`{{kind: {properties['kind']['const']}}}`"
    words = _words(name)
    return f"[{words}](#{words.lower().replace(' ', '-')})"


def _words(definition: str) -> str:
    """Return the name of a mapping of the file format within a sentence."""
    return " ".join(_SHORT.get(word, word) for word in title(definition).lower().split())


def _list(schema: dict[str, Any], many: bool) -> str:
    if "prefixItems" in schema:
        entry = _value(schema["prefixItems"][0], many=True)
        return f"{('two', 'three')[len(schema['prefixItems']) - 2]} {entry}"
    count = f"{schema['minItems']} to {schema['maxItems']} " if "maxItems" in schema else ""
    return f"list{'s' * many} of {count}{_value(schema['items'], many=True)}"


def _scalar(schema: dict[str, Any], many: bool) -> str:
    if schema["type"] == "boolean":
        return "`true` or `false`"
    # A number with a unit may be text with another one, which the page says once.
    kind = schema["type"][0] if isinstance(schema["type"], list) else schema["type"]
    word = {"number": "number", "integer": "whole number"}.get(kind, "text")
    word += "s" * many
    if "minimum" in schema and "maximum" in schema:
        return f"{word} from {schema['minimum']:g} to {schema['maximum']:g}"
    # Some versions of Pydantic write the bounds of whole numbers as floats, others do not.
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    bounds = [f"{sign} {schema[name]:g}" for name, sign in signs.items() if name in schema]
    return f"{word} {', '.join(bounds)}".strip()


def part_pattern(name: str) -> re.Pattern[str]:
    """Return a pattern for a generated part of a page, with the text between its two markers in
    group 1."""
    return re.compile(rf"<!-- begin {name} -->\s*(.*?)\s*<!-- end {name} -->", re.DOTALL)


def table_rows(page: str, name: str) -> list[list[str]]:
    """Return the cells of a generated table of a page, without its head."""
    found = part_pattern(name).search((ROOT / page).read_text(encoding="utf-8"))
    assert found is not None
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in found[1].splitlines()[2:]]


def missing_sections() -> dict[str, str]:
    """Return the sections that the page of the file format lacks, by the name of the mapping."""
    page = (ROOT / FILE_FORMAT).read_text(encoding="utf-8")
    names = [name for name, definition in _definitions().items() if _has_keys(definition)]
    return {
        name: f"### {_words(name)[0].upper()}{_words(name)[1:]}\n\n"
        f"<!-- begin {name} -->\n<!-- end {name} -->\n"
        for name in names
        if not part_pattern(name).search(page)
    }


def with_drives(page: str, sections: dict[str, str]) -> str:
    """Return the page of the file format with the missing sections of controllers.

    Each follows that of the controller before it in the registry; ``sections`` loses them.
    """
    drives = [record.__name__ for record in CONTROLLED.values()]
    for before, name in pairwise(drives):
        if name in sections:
            end = page.index(f"<!-- end {before} -->")
            at = min(page.index(mark, end) for mark in ("\n## ", "\n### ") if mark in page[end:])
            page = f"{page[: at + 1]}{sections.pop(name)}{page[at:]}"
    return page


def stub() -> str:
    """Return the stub of the package, with the public names of all controllers of the registry."""
    names = sorted(
        (kind.__name__ for kind in CONTROLLERS.values()), key=lambda n: (not n.isupper(), n)
    )
    laws = "".join(f"from .control.laws import {name} as {name}\n" for name in names)
    parts = re.split(r"(?:^from \.control\.laws import .*\n)+", _stub_now(), flags=re.MULTILINE)
    return laws.join(parts)


def _stub_now() -> str:
    return (ROOT / STUB).read_text(encoding="utf-8")


def rewrite() -> None:
    """Write the stub, and every generated part into its page."""
    if stub() != _stub_now():
        (ROOT / STUB).write_text(stub(), encoding="utf-8")
        os.execv(sys.executable, [sys.executable, __file__])  # with the new public names
    page = (ROOT / FILE_FORMAT).read_text(encoding="utf-8")
    lacking = missing_sections()
    (ROOT / FILE_FORMAT).write_text(with_drives(page, lacking), encoding="utf-8")
    if lacking:
        text = "\n".join(lacking.values())
        raise SystemExit(f"Paste into {FILE_FORMAT}, where it belongs, and run again:\n\n{text}")
    for (page, name), text in generated().items():
        path = ROOT / page
        filled = f"<!-- begin {name} -->\n\n{text}\n\n<!-- end {name} -->"
        content, count = part_pattern(name).subn(lambda _, f=filled: f, path.read_text())
        if count != 1:
            raise SystemExit(f"{page} must hold the markers of {name!r} once, but has {count}")
        path.write_text(content)


if __name__ == "__main__":
    rewrite()
