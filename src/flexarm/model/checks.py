"""`Record`, the base class of user input in Python and in files, and the texts of its fields.

A record is a frozen pydantic model that rejects unknown keys and reports all its problems together:
those of single values and, for values that are valid, those between values. In Python it raises
`ModelError`; in a file the reader of the file receives the faults and adds the lines.

The meaning of a field, with its unit, is the docstring below it. Python discards these docstrings,
so they are read from the source when help, a schema or a unit requires them.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from inspect import Signature, cleandoc
from itertools import pairwise
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    Self,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
)

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    TypeAdapter,
    ValidationError,
    ValidatorFunctionWrapHandler,
    model_validator,
)

from flexarm.base.errors import NAMES, InputError, ModelError, shown
from flexarm.base.notebook import html_table
from flexarm.model.quantities import Typed
from flexarm.model.units import in_si, maps_names, unit_of
from flexarm.model.wording import Fault, Path, worded

_WIDTH = 92
#: Characters of a record in a console, and rows of its table in a notebook.
_REPR_WIDTH, _MOST_ROWS = 240, 40


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


if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
    from pydantic_core import CoreSchema
else:
    ModelMetaclass = type(BaseModel)

T = TypeVar("T")
R = TypeVar("R", bound="Record")

#: Attributes of records that pydantic defines.
_INTERNAL = {*dir(BaseModel), *BaseModel.__annotations__}


@dataclass_transform(kw_only_default=True, field_specifiers=(Field,))
class RecordType(ModelMetaclass):
    """Metaclass of records: ``Link(length=-1)`` raises `ModelError` instead of pydantic's error.

    Overriding ``__init__`` would also affect records nested in a file, whose faults must reach the
    reader of the file with their paths. Pydantic does not call the metaclass for those.
    """

    def __call__(cls: type[T], *args: Any, **kwargs: Any) -> T:
        arguments = _by_name(cls, args, kwargs) if args else kwargs  # type: ignore[arg-type]
        try:
            arguments = cls._from_python(arguments)  # type: ignore[attr-defined]
            return super().__call__(**arguments)  # type: ignore[misc, no-any-return]
        except ValidationError as error:
            problems = [fault.problem(cls.__name__) for fault in faults_of(error)]
            raise ModelError(*problems).at(cls._place()) from None  # type: ignore[attr-defined]
        except InputError as error:
            raise error.at(cls._place()) from None  # type: ignore[attr-defined]

    @property
    def __signature__(cls) -> Signature:
        return signature_of(cls)

    @__signature__.setter
    def __signature__(cls, value: object) -> None:
        """Ignore the signature that pydantic assigns."""

    @property
    def __doc__(cls) -> str:  # type: ignore[override]
        # This is a property, because the fields are complete only after the class is.
        text = cls.__dict__.get("__doc__") or ""
        return docstring_of(cls, text) if getattr(cls, "model_fields", None) else text

    def __dir__(cls) -> list[str]:
        """List the attributes of a record without those of pydantic and of every class."""
        return [n for n in super().__dir__() if n not in _INTERNAL and not n.startswith("__")]


def _by_name(cls: type[Record], args: tuple[Any, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of a call by the names of their fields."""
    names = positional_fields(cls)
    if not names:
        raise TypeError(f"{cls.__name__} takes its values by name: {cls.__name__}(name=value)")
    if len(args) > len(names):
        raise TypeError(f"{cls.__name__} takes at most {len(names)} values by position: {names}")
    twice = [name for name in names[: len(args)] if name in kwargs]
    if twice:
        raise TypeError(f"{cls.__name__} got multiple values for argument {twice[0]!r}")
    return {**dict(zip(names, args, strict=False)), **kwargs}


class Given:
    """The valid fields of a record, and the raw input."""

    def __init__(self, valid: Mapping[str, Any], raw: object) -> None:
        self._valid = valid
        self._raw = raw if isinstance(raw, dict) else {}

    def has(self, *names: str) -> bool:
        """Return whether all these fields are valid and not None."""
        return all(self._valid.get(name) is not None for name in names)

    def absent(self, name: str) -> bool:
        """Return whether the user has omitted the field (an invalid value is not omitted)."""
        return self.raw(name) is None

    def omitted(self, name: str) -> bool:
        """Return whether the user has omitted the field, also if it has a default value."""
        return self._raw.get(name) is None

    def raw(self, name: str) -> Any:
        """Return the user's value of the field, validated or not."""
        return self._valid.get(name, self._raw.get(name))

    def __getattr__(self, name: str) -> Any:
        return self._valid[name]


class Record(BaseModel, metaclass=RecordType):
    """Base of user input: frozen, finite numbers; lists all problems in an error.

    A field with a unit in its description accepts text with another unit: ``"667 mm"``.
    An unknown key or an invalid value raises `ModelError`. In Python, the fields are keyword
    arguments; those of a class that is defined with ``kw_only=False`` are positional, too, except
    fields with ``kw_only=True``.
    """

    # Validators are built at their first use: a run needs those of few records.
    model_config = ConfigDict(defer_build=True, frozen=True, extra="forbid")

    _hints: ClassVar[dict[str, str]] = {}
    """A sentence per field, added to a complaint about that field which has no hint of its own."""
    _written: ClassVar[tuple[str, ...]] = ()
    """Fields that files contain even if they equal their defaults, because rules require them."""
    _columns: ClassVar[tuple[str, ...]] = ()
    """Fields that are the columns of a table: lists with one entry for each of its rows."""
    _kw_only: ClassVar[bool] = True
    _declared: ClassVar[Mapping[str, Any]] = {}
    """Declarations of its fields, if they are the parameters of another class."""
    _called: ClassVar[str] = ""
    """Public class whose constructor takes the fields, if it is another one, for messages."""

    def __init_subclass__(cls, *, kw_only: bool = True, **config: Any) -> None:
        super().__init_subclass__(**config)
        cls._kw_only = kw_only

    @classmethod
    def _place(cls) -> str:
        """Return the place of errors of the constructor."""
        return cls._called or cls.__name__

    @classmethod
    def _from_python(cls, arguments: dict[str, Any]) -> dict[str, Any]:
        """Convert arguments that only Python programs can give, such as pairs of arrays."""
        return arguments

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        """Yield the faults between fields; use only fields that `given` has."""
        yield from ()

    @classmethod
    def _in_si(cls, data: dict[str, Any]) -> tuple[Mapping[str, Any], dict[Path, Fault]]:
        """Return the input with the numbers that have a unit in SI units, and faults of units."""
        return in_si(data, partial(unit_of_field, cls))

    def replace(self, **changes: Any) -> Self:
        """Return a validated copy in which the named fields have other values.

        Raises:
            ModelError: if the changed record is invalid.
        """
        kept = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self)(**{**kept, **changes})

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Return a JSON schema with the docstrings of the record and of its fields."""
        reference = handler(schema)
        content = handler.resolve_ref_schema(reference)
        content["description"] = cleandoc(cls.__dict__["__doc__"])
        for name, text in descriptions_of(cls).items():
            content["properties"][name]["description"] = text
        return reference

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """Show only the fields that the user gave, not the defaults."""
        return ((k, v) for k, v in super().__repr_args__() if k in self.model_fields_set)

    def __repr__(self) -> str:
        """Return the call of the constructor, shortened if it would not fit into a few lines."""
        text = super().__repr__()
        if len(text) <= _REPR_WIDTH:
            return text
        fields = ", ".join(f"{name}={_short(value)}" for name, value in self.__repr_args__())
        return f"{type(self).__name__}({fields})"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        rows = list(leaves(self, ""))
        if len(rows) > _MOST_ROWS:
            rows[_MOST_ROWS:] = [(f"... and {len(rows) - _MOST_ROWS} more", "", "")]
        return html_table(f"flexarm.{type(self).__name__}", ("field", "value", "unit"), rows)

    @model_validator(mode="wrap")
    @classmethod
    def _check_all(cls, data: Any, handler: ValidatorFunctionWrapHandler) -> Self:
        if isinstance(data, cls):
            return data
        wrong_units: dict[Path, Fault] = {}
        if isinstance(data, dict):
            data, wrong_units = cls._in_si(data)
        try:
            record: Self = handler(data)
        except ValidationError as error:
            faults = [
                _hinted(worded(details, data, cls.model_fields), cls._hints)
                for details in error.errors(include_url=False)
            ]
            faults = [wrong_units.get(fault.path, fault) for fault in faults]
            if isinstance(data, Mapping):
                wrong = {fault.path[0] for fault in faults if fault.path}
                faults += cls._faults(Given(_right_fields(cls, data, wrong), data))
        else:
            faults = list(cls._faults(Given(record.__dict__, data)))
            if not faults:
                return record
        details = [fault.as_details() for fault in faults]
        raise ValidationError.from_exception_data(cls.__name__, details) from None


def checked_arguments(kind: type[R], **values: Any) -> R:
    """Return the arguments of a function as the record of files; InputError lists all problems."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        raise InputError(*(fault.problem() for fault in faults_of(error))) from None


def faults_of(error: ValidationError) -> list[Fault]:
    """Return the faults of the validation of a record, with paths relative to the record."""
    return [worded(details, None, ()) for details in error.errors(include_url=False)]


def _hinted(fault: Fault, hints: Mapping[str, str]) -> Fault:
    """Return a fault with the hint of its field, if it is directly at the field and has none."""
    hint = hints.get(str(fault.path[0]), "") if len(fault.path) == 1 else ""
    if not hint or not (fault.hint == "" or fault.hint.startswith(NAMES)):
        return fault
    return Fault(fault.path, fault.rule, fault.value, f"{hint} {fault.hint}".rstrip())


def _right_fields(
    cls: type[Record], data: Mapping[str, Any], wrong: set[str | int]
) -> dict[str, Any]:
    """Return the valid fields among those without faults, validated singly, and defaults."""
    right: dict[str, Any] = {}
    for name, field in cls.model_fields.items():
        if name in wrong:
            continue
        if name not in data:
            # A key that is not text stops the validation before missing fields are reported.
            if not field.is_required():
                right[name] = field.get_default(call_default_factory=True)
            continue
        try:
            right[name] = _field_adapter(cls, name).validate_python(data[name])
        except ValidationError:  # valid only after the validators of the record
            continue
    return right


@cache
def unit_of_field(cls: type[Record], name: str) -> tuple[str, bool]:
    """Return the unit of a field, and whether its value maps names to numbers."""
    field = cls.model_fields.get(name)
    unit = unit_of(descriptions_of(cls).get(name, ""))
    return unit, field is not None and maps_names(field.annotation)


def _short(value: object) -> str:
    """Return a field of a long record in a few words."""
    if isinstance(value, Record):
        return f"{type(value).__name__}(...)"
    if isinstance(value, tuple) and value and isinstance(value[0], Record):
        rest = f" ... {len(value)} in all" if len(value) > 1 else ""
        return f"({_short(value[0])},{rest})"
    return shown(value)


def leaves(record: Record, path: str) -> Iterator[tuple[str, object, str]]:
    """Yield the path, the value and the unit of each number or text that the user gave."""
    for name, value in record.__repr_args__():
        items = value if isinstance(value, tuple) else (value,)
        if items and all(isinstance(item, Record) for item in items):
            for i, item in enumerate(items):
                place = f"{path}{name}[{i}]" if items is value else f"{path}{name}"
                yield from leaves(item, f"{place}.")
        else:
            unit = unit_of_field(type(record), str(name))[0]
            text = value if isinstance(value, float | str) else shown(value)
            yield f"{path}{name}", text, unit


@cache
def _field_adapter(cls: type[Record], name: str) -> TypeAdapter[Any]:
    """Return the validator of a single field."""
    field = cls.model_fields[name]
    annotated: Any = field.annotation
    for constraint in field.metadata:
        annotated = Annotated[annotated, constraint]
    if field.discriminator is not None:
        annotated = Annotated[annotated, Field(discriminator=field.discriminator)]
    return TypeAdapter(annotated)
