"""Signatures and field lists of records for ``help()``, without pydantic's annotations."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Mapping
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from flexarm.model.quantities import Typed

if TYPE_CHECKING:
    from flexarm.model.checks import Record

_WIDTH = 92


class TypeText:
    """An annotation of a signature that prints as the given words."""

    def __init__(self, words: str) -> None:
        self.words = words

    def __repr__(self) -> str:
        return self.words


def type_text(annotation: Any) -> str:
    """Return the type that a user may pass, in Python's notation, without constraints."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if annotation is NoneType:
        return "None"
    if origin is Annotated:
        numbers = (item.annotation for item in parts[1:] if isinstance(item, Typed))
        return type_text(next(numbers, parts[0]))
    if origin in (Union, UnionType):
        return " | ".join(dict.fromkeys(map(type_text, parts)))
    if origin is Literal:
        return f"Literal[{', '.join(map(repr, parts))}]"
    if origin is tuple and parts[-1:] == (...,):
        return f"Sequence[{type_text(parts[0])}]"
    if origin is Callable:
        return "Callable"
    if origin is not None:
        return f"{origin.__name__}[{', '.join(map(type_text, parts))}]"
    return str(getattr(annotation, "__name__", annotation))


def positional_fields(record: type[Record]) -> list[str]:
    """Return the fields of a record that may be given by position."""
    fields = {} if record._kw_only else record.model_fields
    return [name for name, field in fields.items() if not field.kw_only]


def signature_of(record: type[Record]) -> inspect.Signature:
    """Return the signature of a record: plain types, defaults."""
    parameters = []
    positional = positional_fields(record)
    for name, field in record.model_fields.items():
        default = inspect.Parameter.empty
        if not field.is_required():
            default = field.get_default(call_default_factory=True)
        by_place = name in positional
        kind = (
            inspect.Parameter.POSITIONAL_OR_KEYWORD if by_place else inspect.Parameter.KEYWORD_ONLY
        )
        words = TypeText(type_text(field.annotation))
        parameters.append(inspect.Parameter(name, kind, default=default, annotation=words))
    return inspect.Signature(sorted(parameters, key=lambda parameter: parameter.kind))


def docstring_of(record: type[Record], text: str) -> str:
    """Return the docstring of a record followed by its fields, with units, and its errors."""
    fields = record.model_fields.items()
    entries = {name: field.description or type_text(field.annotation) for name, field in fields}
    lines = [inspect.cleandoc(text), "", *args_text(entries)]
    lines += ["", "Raises:", "    ModelError: if a value is invalid; every problem is listed."]
    return "\n".join(lines)


def args_text(entries: Mapping[str, str]) -> list[str]:
    """Return the lines of the section "Args:" of a docstring."""
    lines = ["Args:"]
    for name, text in entries.items():
        entry = f"{name}: {text}"
        lines += textwrap.wrap(entry, _WIDTH, initial_indent="    ", subsequent_indent=" " * 8)
    return lines
