"""Parameters of controllers, declared once: the arguments of a constructor and the keys of a file.

A subclass of `Parameters` annotates each parameter with its type and bounds, in the manner of a
dataclass; the docstring below a parameter has its meaning and unit. The controller class derives
from it (``flexarm.control.contract.parametrised``), and `record_of` makes the record that reads the
same values from a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from inspect import Parameter, cleandoc, get_annotations
from types import NoneType
from typing import Any, ClassVar, dataclass_transform, get_args

from pydantic import Field, create_model
from pydantic.fields import FieldInfo

from flexarm.model.checks import Record
from flexarm.model.help_text import field_texts
from flexarm.model.quantities import PerJoint

#: Stands for the default of a parameter that has none and must be given.
REQUIRED = Parameter.empty


@dataclass(frozen=True, eq=False)
class Declared:
    """One parameter of a class.

    Attributes:
        name: its name.
        annotation: type, with bounds. source: the type in the source code.
        given: default, a field, or ``REQUIRED``.
        keyword_only: whether it is a keyword argument.
        owner: class that declares it. inherited: its declaration in a base of that class.
    """

    name: str
    annotation: Any
    source: str
    given: Any
    keyword_only: bool
    owner: type
    inherited: Declared | None

    @cached_property
    def field(self) -> FieldInfo:
        """The parameter as a field of a record."""
        if self.given is REQUIRED:
            return FieldInfo.from_annotation(self.annotation)
        return FieldInfo.from_annotated_attribute(self.annotation, self.given)

    @property
    def optional(self) -> bool:
        """Whether the value may be None."""
        return NoneType in get_args(self.annotation)

    @property
    def default(self) -> Any:
        """The default, or ``REQUIRED``."""
        return REQUIRED if self.field.is_required() else self.field.default

    @property
    def description(self) -> str:
        """Meaning and unit."""
        text = field_texts(self.owner).get(self.name) or self.field.description
        return text or (self.inherited.description if self.inherited else "")

    @property
    def per_joint(self) -> PerJoint | None:
        """The marker of a parameter with values for each joint, or None."""
        return _marker(self.annotation)


def _marker(annotation: Any) -> PerJoint | None:
    if isinstance(annotation, PerJoint):
        return annotation
    found = [*get_args(annotation), *getattr(annotation, "__metadata__", ())]
    return next(filter(None, map(_marker, found)), None)


@dataclass_transform(eq_default=False, field_specifiers=(Field,))
class Parameters:
    """Base of classes that declare parameters; a subclass adds to those of its bases.

    Parameters after ``_: KW_ONLY`` are keyword arguments. A ``ClassVar`` removes a parameter of a
    base.
    """

    _declared: ClassVar[dict[str, tuple[str, Any, bool]]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        keyword_only, cls._declared = False, {}
        if not cls.__module__.startswith("flexarm."):
            return  # annotations in classes of users declare attributes
        for name, source in get_annotations(cls).items():
            if source == "KW_ONLY":
                keyword_only = True
                continue
            cls._declared[name] = source, vars(cls).get(name, REQUIRED), keyword_only
            if name in vars(cls) and not source.startswith("ClassVar"):
                delattr(cls, name)  # it would hide a property of a later base


def parameters_of(kind: type[Parameters]) -> dict[str, Declared]:
    """Return the parameters of a class by name, those of its last base first."""
    parameters: dict[str, Declared] = {}
    for base in reversed(kind.__mro__):
        declared = vars(base).get("_declared", {})
        hints = get_annotations(base, eval_str=True) if declared else {}
        for name, (source, default, keyword_only) in declared.items():
            if source.startswith("ClassVar"):
                parameters.pop(name, None)
            else:
                inherited = parameters.get(name)
                parameters[name] = Declared(
                    name, hints[name], source, default, keyword_only, base, inherited
                )
    return parameters


def record_of(
    name: str, doc: str, declared: Mapping[str, Declared], base: type[Record] = Record, **more: Any
) -> Any:
    """Return a class of records with parameters as fields, after ``more`` fields.

    Args:
        name: name of the class. doc: its docstring. base: its base class.
        declared: the parameters.
        more: type and default of each further field.
    """
    fields = {
        key: (item.annotation, ... if item.given is REQUIRED else item.given)
        for key, item in declared.items()
    }
    module = {"__module__": "flexarm.model.drives", "__doc__": cleandoc(doc)}
    record: Any = create_model(name, __base__=base, **module, **more, **fields)  # type: ignore[call-overload]
    record._declared = declared
    return record
