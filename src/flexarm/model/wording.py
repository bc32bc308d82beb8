"""Conversion of pydantic's errors to the messages of this package.

A `Fault` is one problem inside a record, at a path relative to it. Pydantic passes faults on as
custom errors of type ``fault``, so that faults of nested records keep the message of the innermost
record.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from flexarm.base.errors import Problem, one_of, shown
from flexarm.base.errors import nearest as nearest
from flexarm.base.errors import suggestion as suggestion

Path = tuple[str | int, ...]


@dataclass(frozen=True)
class Fault:
    """One problem at `path` inside a record, with the texts of a `Problem`."""

    path: Path
    rule: str
    value: str = ""
    hint: str = ""

    def inside(self, *path: str | int) -> Fault:
        """Return the fault as one of the record that has its record at a path."""
        return replace(self, path=(*path, *self.path))

    def problem(self, name: str = "") -> Problem:
        """Return the problem for the user; `name` is used if the path is empty."""
        return Problem(path_text(self.path) or name, self.rule, self.value, self.hint)

    def as_pydantic(self) -> PydanticCustomError:
        """Return the error that a pydantic validator raises; pydantic adds the path."""
        words = {"rule": self.rule, "value": self.value, "hint": self.hint}
        return PydanticCustomError("fault", "{rule}", words)

    def as_details(self) -> InitErrorDetails:
        """Return the entry for a `ValidationError` that is constructed directly."""
        return InitErrorDetails(type=self.as_pydantic(), loc=self.path, input=None)


def refuse(rule: str, value: object, hint: str = "") -> PydanticCustomError:
    """Return the error that the validator of a field raises."""
    return Fault((), rule, shown(value), hint).as_pydantic()


def path_text(path: Path) -> str:
    """Return a path in the notation for users: ``links[0].section.width``."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.removeprefix(".")


def path_of(text: str) -> Path:
    """Return the path for a text of `path_text`."""
    parts = re.findall(r"\[(\d+)\]|([^.\[\]]+)", text)
    return tuple(int(number) if number else word for number, word in parts)


def worded(details: ErrorDetails, data: object, known: Iterable[str]) -> Fault:
    """Convert an entry of the `ValidationError` of a record with ``known`` keys to a fault."""
    path = _without_tags(details["loc"], data)
    context: dict[str, Any] = details.get("ctx", {})
    value = details["input"]
    if details["type"] == "fault":
        return Fault(path, context["rule"], context["value"], context["hint"])
    if details["type"] in ("extra_forbidden", "invalid_key"):
        return Fault(path, "is not a known key", hint=suggestion(str(path[-1]), known))
    if details["type"] == "missing":
        return Fault(path, "is missing")
    if details["type"].startswith("union_tag"):
        # Without a tag list the tag is missing.
        if "tag" not in context:
            return Fault((*path, "kind"), "is missing")
        rule, hint = one_of(context["tag"], _choices(context["expected_tags"]))
        kind = value["kind"] if isinstance(value, dict) else context["tag"]
        return Fault((*path, "kind"), rule, shown(kind), hint)
    fault = Fault(path, _rule(details["type"], context) or details["msg"], shown(value))
    if details["type"] == "float_type":
        # An integer beyond the largest float is a number, but not a finite one.
        if isinstance(value, int) and not isinstance(value, bool):
            return replace(fault, rule="be a finite number")
        hint = "Write the bare number, in SI units." if isinstance(value, str) else ""
        return replace(fault, rule="be a number", hint=hint)
    if details["type"] == "literal_error":
        rule, hint = one_of(value, _choices(context["expected"]))
        return replace(fault, rule=rule, hint=hint)
    return fault


def _rule(kind: str, context: dict[str, Any]) -> str:
    """Return the rule for pydantic's error type `kind`; empty if the type is unknown."""
    match kind:
        case "greater_than":
            return f"be greater than {context['gt']:g}"
        case "greater_than_equal":
            return f"be at least {context['ge']:g}"
        case "less_than":
            return f"be less than {context['lt']:g}"
        case "less_than_equal":
            return f"be at most {context['le']:g}"
        case "finite_number":
            return "be a finite number"
        case "int_type":
            return "be a whole number"
        case "bool_type":
            return "be true or false"
        case "string_type" | "string_too_short":
            return "be a word"
        case "model_type" | "model_attributes_type":
            return "be a mapping of keys to values"
        case _:
            return ""


def _choices(listed: str) -> list[str]:
    """Split pydantic's list of choices ("'a', 'b' or 'c'")."""
    return [word.strip(" '") for word in listed.replace(" or ", ",").split(",")]


def _without_tags(location: Path, data: object) -> Path:
    """Remove from a location the tags that pydantic inserts for members of unions.

    Tags of the form ``<...>`` are those of our unions without `kind`; the others equal the `kind`
    at that place of `data`.
    """
    path: list[str | int] = []
    tagged = True  # the record itself is not a member of a union
    for part in location:
        own = isinstance(data, dict) and part in data
        if isinstance(part, str) and part.startswith("<") and not own:
            continue
        if not tagged and part == look(data, "kind"):
            tagged = True  # a key of that name may follow
            continue
        path.append(part)
        data, tagged = look(data, part), False
    return tuple(path)


def look(data: object, part: str | int) -> object:
    """Return one part of raw data or of a finished record, or None if there is none."""
    if isinstance(data, dict):
        return data.get(part)
    if isinstance(data, list | tuple):
        return data[part] if isinstance(part, int) and part < len(data) else None
    return getattr(data, part, None) if isinstance(part, str) else None
