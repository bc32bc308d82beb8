"""Numbers of a record by their paths: ``links[0].flexural_rigidity``, ``payload.mass``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from difflib import get_close_matches
from typing import Any, TypeVar

from flexarm.base.errors import InputError, ModelError, Problem, shown
from flexarm.model.arm.joints import Joint, unit_of_sliding
from flexarm.model.checks import Record, unit_of_field
from flexarm.model.quantities import Names
from flexarm.model.units import unit_of_entry

R = TypeVar("R", bound=Record)

_PART = re.compile(r"\.?([A-Za-z_](?:\w| (?=\w))*)|\[(\d{1,6})\]")


def number_at(name: str, record: Record, path: object, whole: str = "arm") -> float:
    """Return the number at a path; ``name`` is the argument, ``whole`` the record, for messages.

    Raises:
        InputError: if the record has no such path, or its value is not a floating-point number.
    """
    rule = f"be the path of a number of the {whole}"
    if not isinstance(path, str):
        hint = "A path is text such as 'links[0].flexural_rigidity' or 'payload.mass'."
        raise InputError(Problem(name, rule, shown(path), hint))
    parts = parts_of(path)
    value: Any = record if parts else None
    walked = ""
    for part in parts:
        known = _names(value)
        if part not in known:
            near = get_close_matches(str(part), [str(k) for k in known], n=1)
            hint = f"{walked or f'The {whole}'} has no {part}" + (
                f"; did you mean {near[0]}?" if near else "."
            )
            raise InputError(Problem(name, rule, shown(path), hint))
        value = _inside(value, part)
        walked = _joined(walked, part)
    if isinstance(value, float):
        return value
    content = "nothing" if value is None else shown(value)
    hint = f"It is {content} there." if parts else "An example is 'links[0].flexural_rigidity'."
    raise InputError(Problem(name, rule, shown(path), hint))


def unit_at(record: Record, path: str) -> str:
    """Return the unit of the number at a path that ``number_at`` accepts; empty without a unit."""
    value: Any = record
    unit, slides = "", False
    for part in parts_of(path):
        slides = slides or (isinstance(value, Joint) and value.kind == "prismatic")
        if isinstance(value, Record):
            units = unit_of_sliding if slides else unit_of_field
            unit = units(type(value), str(part))[0]
        elif isinstance(part, int):
            unit = unit_of_entry(unit, part)
        value = _inside(value, part)
    return unit


def with_number(record: R, path: str, value: Any, *, checked: bool = True) -> R:
    """Return a copy of a record with another number at a path that ``number_at`` accepts.

    ModelError names the path of a wrong value. Symbols require a copy that is not ``checked``.
    """
    changed: R = _with(record, parts_of(path), value, checked, "")
    return changed


def with_numbers(record: R, values: Mapping[str, Any]) -> R:
    """Return a copy of a record with other numbers, by paths that ``number_at`` accepts."""
    # All numbers are set before the copy is validated, so their order has no effect.
    for path, value in values.items():
        record = with_number(record, path, value, checked=False)
    for path, value in values.items():  # validates all records that contain the number
        record = with_number(record, path, value)
    return record


def number_paths(value: Any, walked: str = "") -> Iterator[str]:
    """Yield the paths of all numbers of a record, or of its value at a path."""
    for part in _names(value):
        inside, path = _inside(value, part), _joined(walked, part)
        if isinstance(inside, float):
            yield path
        else:
            yield from number_paths(inside, path)


def parts_of(path: str) -> list[str | int]:
    """Split a path into names and indices; return an empty list if it is invalid."""
    parts: list[str | int] = []
    end = 0
    for match in _PART.finditer(path):
        if match.start() != end:
            return []
        parts.append(int(match[2]) if match[1] is None else match[1])
        end = match.end()
    return parts if end == len(path) and not path.startswith(".") else []


def _names(value: Any) -> list[str | int]:
    if isinstance(value, Record):
        return list(type(value).model_fields)
    if isinstance(value, Names):
        return list(value)
    return list(range(len(value))) if isinstance(value, tuple) else []


def _inside(value: Any, part: str | int) -> Any:
    return getattr(value, str(part)) if isinstance(value, Record) else value[part]


def _joined(walked: str, part: str | int) -> str:
    if isinstance(part, int):
        return f"{walked}[{part}]"
    return f"{walked}.{part}" if walked else part


def _with(value: Any, parts: list[str | int], number: Any, checked: bool, walked: str) -> Any:
    if not parts:
        return number
    first, *rest = parts
    inside = _with(_inside(value, first), rest, number, checked, _joined(walked, first))
    if isinstance(first, int):
        return (*value[:first], inside, *value[first + 1 :])
    if isinstance(value, Names):
        return Names({**value, first: inside})
    if not checked:
        return value.model_copy(update={first: inside})
    try:
        return value.replace(**{first: inside})
    except ModelError as error:  # name the path instead of the class
        raise ModelError(*(_at(walked, problem, value) for problem in error.problems)) from None


def _at(walked: str, problem: Problem, record: Record) -> Problem:
    """Return a problem of the record at a path with its complete path."""
    whole = problem.name == type(record).__name__
    return replace(problem, where="", name=walked if whole else _joined(walked, problem.name))
