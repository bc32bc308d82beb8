"""Forms that the value of a key may have, read from the types of the records."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from flexarm.model import Scenario, StudySpec
from flexarm.model.checks import Record
from flexarm.model.quantities import PerJoint, Typed
from flexarm.model.wording import Path, look

FormName = Literal[
    "none", "flag", "number", "choice", "word", "pair", "list", "names", "record", "function"
]
#: Forms between which a button switches; the others of a union are edited as text.
_SWITCHED = ("number", "pair", "list", "record")


@dataclass(frozen=True, eq=False)
class Form:
    """One of the forms of a value."""

    name: FormName  # what it is
    type: Any  # its type without annotations
    marks: tuple[Any, ...]  # bounds and other annotations

    @property
    def words(self) -> tuple[str, ...]:
        """The words of a choice."""
        return get_args(self.type)

    @property
    def kind(self) -> str | None:
        """The ``kind`` of a record that is distinguished by it."""
        return kind_of(self.type) if self.name == "record" else None

    @property
    def per_joint(self) -> bool:
        """Whether a list has one value for each joint."""
        return any(isinstance(mark, PerJoint) for mark in self.marks)

    def bounds(self) -> Iterator[tuple[float, bool, bool]]:
        """Yield the bounds of a number: value, whether it is a lower one, whether it is open."""
        for mark in self.marks:
            for part in (mark, *getattr(mark, "metadata", ())):
                for name in ("gt", "ge", "lt", "le"):
                    bound = getattr(part, name, None)
                    if isinstance(bound, int | float):
                        yield float(bound), name.startswith("g"), name.endswith("t")

    def items(self) -> Forms:
        """Return the forms of the entries of a list, a pair or a mapping."""
        parts = get_args(self.type)
        return forms_of(parts[1] if self.name == "names" else parts[0])


@dataclass(frozen=True, eq=False)
class Forms:
    """All forms of a value."""

    optional: bool  # whether the value may be omitted, that is None, or infinity for a limit
    #: Its forms as a value; those that only Python programs can give are left out
    given: tuple[Form, ...]

    @property
    def records(self) -> tuple[Form, ...]:
        """The records among the forms."""
        return tuple(form for form in self.given if form.name == "record")

    @property
    def kinds(self) -> tuple[Form, ...]:
        """The records that are distinguished by ``kind``."""
        return tuple(form for form in self.records if form.kind is not None)

    def named(self, name: str) -> Form | None:
        """Return the first form of a name."""
        return next((form for form in self.given if form.name == name), None)

    def of(self, value: Any) -> Form | None:
        """Return the form of a value; None for an omitted one."""
        name = _name_of(value)
        if name == "record":
            return next((form for form in self.records if isinstance(value, form.type)), None)
        names = {"word": ("choice", "word"), "list": ("list", "pair")}.get(name, (name,))
        return next((found for each in names if (found := self.named(each))), None)

    def other(self, value: Any) -> str:
        """Return the name of the other form to which a button switches, or an empty text."""
        now, names = self.of(value), [form.name for form in self.given]
        if now is None or len(names) != 2 or not set(names) <= set(_SWITCHED) or self.kinds:
            return ""
        return next((form.name for form in self.given if form is not now), "")


def kind_of(record: type[Record]) -> str | None:
    """Return the kind that distinguishes a record; None without one, or where it is a choice."""
    field = record.model_fields.get("kind")
    if field is None or field.is_required() or len(get_args(field.annotation)) > 1:
        return None
    return str(field.default)


def _name_of(value: Any) -> str:
    if isinstance(value, Record):
        return "record"
    if value is None or value == math.inf:
        return "none"
    for kind, name in ((bool, "flag"), (int | float, "number"), (str, "word"), (tuple, "list")):
        if isinstance(value, kind):
            return name
    return "names" if isinstance(value, dict) else "function"


@lru_cache(maxsize=2000)
def field_forms(record: type[Record], name: str) -> Forms:
    """Return the forms of a field of a class of records."""
    return forms_of(record.model_fields[name])


def forms_of(annotation: Any) -> Forms:
    """Return the forms of a type, or of a field of a record."""
    forms = list(_forms(annotation, ()))
    constants = tuple(form for form in forms if form.name not in ("none", "function"))
    return Forms(any(form.name == "none" for form in forms), constants)


def _forms(annotation: Any, marks: tuple[Any, ...]) -> Iterator[Form]:
    if isinstance(annotation, FieldInfo):
        yield from _forms(annotation.annotation, (*marks, *annotation.metadata))
        return
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        yield from _forms(parts[0], (*marks, *parts[1:]))
    elif annotation is Any:
        typed = next(mark for mark in marks if isinstance(mark, Typed))
        yield from _forms(typed.annotation, marks)
    elif origin in (Union, UnionType):
        for part in parts:
            yield from _forms(part, marks)
    else:
        yield Form(_form_name(annotation, origin, parts), annotation, marks)


def _form_name(annotation: Any, origin: Any, parts: tuple[Any, ...]) -> FormName:
    if origin is Literal:
        return "choice"
    if origin is tuple:
        return "list" if parts[-1] is ... else "pair"
    if origin is dict:
        return "names"
    if origin is not None:
        return "function"
    simple: dict[Any, FormName] = {
        NoneType: "none",
        bool: "flag",
        int: "number",
        float: "number",
        str: "word",
        Callable: "function",
    }
    if annotation in simple:
        return simple[annotation]
    return "record" if issubclass(annotation, Record) else "function"


def forms_at(record: Scenario | StudySpec, path: Path) -> Forms:
    """Return the forms of the value at a path, which may be omitted; LookupError without one."""
    value: Any = record
    forms: Forms | None = None
    for part in path:
        if isinstance(value, Record) and part in type(value).model_fields:
            forms = field_forms(type(value), str(part))
        elif forms is not None and isinstance(value, tuple | dict):
            form = forms.of(value)
            if form is None:
                raise LookupError(path)
            forms = form.items()
        else:
            raise LookupError(path)
        value = look(value, part)
    if forms is None:
        raise LookupError(path)
    return forms
