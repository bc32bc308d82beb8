"""Signatures and field lists of records for ``help()``, without pydantic's annotations."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Mapping
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from flexarm.model.quantities import Typed

if TYPE_CHECKING:
    from pydantic import BaseModel

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
    if origin is not None:
        return f"{origin.__name__}[{', '.join(map(type_text, parts))}]"
    return str(getattr(annotation, "__name__", annotation))


def signature_of(record: type[BaseModel]) -> inspect.Signature:
    """Return the signature of a record: keyword-only fields, plain types, defaults."""
    parameters = []
    for name, field in record.model_fields.items():
        default = inspect.Parameter.empty
        if not field.is_required():
            default = field.get_default(call_default_factory=True)
        kind, words = inspect.Parameter.KEYWORD_ONLY, TypeText(type_text(field.annotation))
        parameters.append(inspect.Parameter(name, kind, default=default, annotation=words))
    return inspect.Signature(parameters)


def docstring_of(record: type[BaseModel], text: str) -> str:
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
