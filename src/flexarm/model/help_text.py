"""Texts of records: signatures and field lists for ``help()``, and the meaning of each field.

The meaning of a field, with its unit, is the docstring below it. Python discards these docstrings,
so they are read from the source when help, a schema or a unit requires them.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from collections.abc import Callable, Mapping
from functools import cache
from itertools import pairwise
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from flexarm.model.quantities import Typed

_WIDTH = 92


def field_texts(kind: type) -> dict[str, str]:
    """Return the docstrings of the fields that a class of this package declares, by name."""
    ours = kind.__module__.startswith("flexarm.")
    return _texts_in(kind.__module__).get(kind.__name__, {}) if ours else {}


@cache
def _texts_in(module: str) -> dict[str, dict[str, str]]:
    """Return the docstrings of the fields of each class of a module."""
    source = inspect.getsource(sys.modules[module])
    return {
        node.name: {
            field.target.id: " ".join(text.value.value.split())
            for field, text in pairwise(node.body)
            if isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
            and isinstance(text.value.value, str)
        }
        for node in ast.parse(source).body
        if isinstance(node, ast.ClassDef)
    }


@cache
def descriptions_of(record: Any) -> dict[str, str]:
    """Return the meaning of each field of a record that has one, with its unit."""
    texts = {name: field.description for name, field in record.model_fields.items()}
    for base in reversed(record.__mro__):
        texts |= {name: text for name, text in field_texts(base).items() if name in texts}
    texts |= {name: item.description for name, item in record._declared.items()}
    return {name: text for name, text in texts.items() if text}


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


def positional_fields(record: Any) -> list[str]:
    """Return the fields of a record that may be given by position."""
    fields = {} if record._kw_only else record.model_fields
    return [name for name, field in fields.items() if not field.kw_only]


def signature_of(record: Any) -> inspect.Signature:
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


def docstring_of(record: Any, text: str) -> str:
    """Return the docstring of a record followed by its fields, with units, and its errors."""
    types = {name: type_text(field.annotation) for name, field in record.model_fields.items()}
    entries = types | descriptions_of(record)
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
