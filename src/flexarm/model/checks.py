"""`Record`: the base of everything a user writes down, in Python or in a file.

A record is a frozen pydantic model that refuses unknown keys and tells all its problems at once:
those of single values together with those between values, as far as the values concerned are
right. In Python it raises `ModelError`; inside a file the faults go up to the reader of the file,
which knows the lines.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from inspect import Signature, cleandoc
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeVar, dataclass_transform

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

from flexarm.errors import ModelError
from flexarm.model.help_text import docstring_of, signature_of
from flexarm.model.wording import Fault, worded

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
    from pydantic_core import CoreSchema
else:
    ModelMetaclass = type(BaseModel)

T = TypeVar("T")

#: Attributes that records get from pydantic and from Python's class machinery.
_INTERNAL = {*dir(BaseModel), *BaseModel.__annotations__, "__abstractmethods__", "__annotations__"}
_INTERNAL -= set(dir(object))


@dataclass_transform(kw_only_default=True, field_specifiers=(Field,))
class RecordType(ModelMetaclass):
    """Makes ``Link(length=-1)`` raise `ModelError` instead of pydantic's own error.

    Overriding ``__init__`` would do the same to records nested in a file, whose faults must reach
    the reader of the file with their place; pydantic does not come through here for those.
    """

    def __call__(cls: type[T], *args: Any, **kwargs: Any) -> T:
        if args:
            raise TypeError(f"{cls.__name__} takes its values by name: {cls.__name__}(name=value)")
        try:
            return super().__call__(**kwargs)  # type: ignore[misc, no-any-return]
        except ValidationError as error:
            found = faults_of(error)
            raise ModelError(*(f.problem(cls.__name__, cls.__name__) for f in found)) from None

    @property
    def __signature__(cls) -> Signature:
        return signature_of(cls)  # type: ignore[arg-type]

    @__signature__.setter
    def __signature__(cls, value: object) -> None:
        """Ignore the signature that pydantic assigns."""

    @property
    def __doc__(cls) -> str:  # type: ignore[override]
        # A property, because fields are not complete until the class is.
        text = cls.__dict__.get("__doc__") or ""
        return docstring_of(cls, text) if getattr(cls, "model_fields", None) else text  # type: ignore[arg-type]

    def __dir__(cls) -> list[str]:
        """List what a record offers itself: pydantic's own attributes would bury it in ``help``."""
        names = super().__dir__()
        return [n for n in names if n not in _INTERNAL and not n.startswith("__pydantic")]


class Given:
    """The fields of a record that are right: all of them, or what an invalid input has left."""

    def __init__(self, valid: Mapping[str, Any], raw: object) -> None:
        self._valid = valid
        self._raw = raw if isinstance(raw, dict) else {}

    def has(self, *names: str) -> bool:
        """Tell whether all these fields are right and not None."""
        return all(self._valid.get(name) is not None for name in names)

    def absent(self, name: str) -> bool:
        """Tell whether the user has left the field out (a wrong value is not left out)."""
        return self.raw(name) is None

    def raw(self, name: str) -> Any:
        """Return what the user wrote for the field, checked or not."""
        return self._valid.get(name, self._raw.get(name))

    def __getattr__(self, name: str) -> Any:
        return self._valid[name]


class Record(BaseModel, metaclass=RecordType):
    """Frozen, keyword-only, no unknown keys, no NaN; raises `ModelError` with every problem."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    _hints: ClassVar[dict[str, str]] = {}
    """A sentence per field, added to a complaint about that field which has no hint of its own."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        """Yield what is wrong between fields; look only at fields that `given` has."""
        yield from ()

    def replace(self, **changes: Any) -> Self:
        """Return a checked copy in which the named fields have other values.

        Raises:
            ModelError: the changed record is wrong.
        """
        kept = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self)(**{**kept, **changes})

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Describe the record by its own docstring: the schema has an entry for each field."""
        made = handler(schema)
        handler.resolve_ref_schema(made)["description"] = cleandoc(cls.__dict__["__doc__"])
        return made

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """Show what was given, not the defaults."""
        return ((k, v) for k, v in super().__repr_args__() if k in self.model_fields_set)

    @model_validator(mode="wrap")
    @classmethod
    def _check_all(cls, data: Any, handler: ValidatorFunctionWrapHandler) -> Self:
        if isinstance(data, cls):
            return data
        try:
            record: Self = handler(data)
        except ValidationError as error:
            faults = [
                _hinted(worded(details, data, cls.model_fields), cls._hints)
                for details in error.errors(include_url=False)
            ]
            if isinstance(data, Mapping):
                wrong = {fault.path[0] for fault in faults if fault.path}
                faults += cls._faults(Given(_right_fields(cls, data, wrong), data))
        else:
            faults = list(cls._faults(Given(record.__dict__, data)))
            if not faults:
                return record
        details = [fault.as_details() for fault in faults]
        raise ValidationError.from_exception_data(cls.__name__, details) from None


def faults_of(error: ValidationError) -> list[Fault]:
    """Return the faults a record's validation has raised, paths relative to the record."""
    return [worded(details, None, ()) for details in error.errors(include_url=False)]


def _hinted(fault: Fault, hints: Mapping[str, str]) -> Fault:
    """Give a fault directly at a field that field's hint."""
    if fault.hint or len(fault.path) != 1:
        return fault
    return Fault(fault.path, fault.rule, fault.value, hints.get(str(fault.path[0]), ""))


def _right_fields(
    cls: type[Record], data: Mapping[str, Any], wrong: set[str | int]
) -> dict[str, Any]:
    """Validate one by one the fields that were not complained about; defaults fill the rest."""
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
        except ValidationError:  # a field validator has put it right in the record's context only
            continue
    return right


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
