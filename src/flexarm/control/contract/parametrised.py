"""Constructors of classes whose parameters are declared in ``flexarm.model.drives``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from inspect import Parameter, Signature, cleandoc, signature
from typing import Any, ClassVar, get_args

import numpy as np
from pydantic import Field, ValidationError

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_kind, check_positive
from flexarm.base.errors import (
    Problem,
    problems_of,
    public_call,
    raise_any,
    shown,
    unknown_arguments,
)
from flexarm.base.notebook import html_table
from flexarm.control.contract.base import Controller, check_controller, joint_problems
from flexarm.model.arm.spec import UNDRIVEN, serial_only
from flexarm.model.checks import TypeText, args_text, faults_of, type_text
from flexarm.model.drives.base import Declared, Parameters, parameters_of, record_of
from flexarm.model.quantities import ListPerJoint
from flexarm.model.units import unit_of

#: The parameter that is the last keyword argument.
_LAST = "sample_time"
#: Parameters in the text of an object; its table has all.
_MOST_SHOWN = 4
#: Sections of a docstring that follow the arguments.
_AFTER_ARGS = ("\nAttributes:\n", "\nRaises:\n", "\nReferences:\n")


class Parametrised(Parameters):
    """Base of classes whose constructor takes their parameters.

    The constructor sets each parameter as an attribute and calls ``__post_init__``. Parameters of
    the model layer are validated by the types that also validate files; those with a value for
    each joint become arrays: (joints,) if an ``arm`` is given. Parameters that a subclass of this
    class declares exist in Python only; if their type is not a class of this package,
    ``__post_init__`` checks them.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        kind: Any = cls
        own = cls.__init__ is not Parametrised.__init__
        kind.__signature__ = _without_self(kind) if own else _signature(kind)
        if vars(cls).get("__doc__") and cls.__module__.startswith("flexarm."):
            cls.__doc__ = _Documented(cleandoc(cls.__doc__ or ""))  # type: ignore[assignment]

    @public_call
    def __init__(self, *values: Any, **named: Any) -> None:
        kind: Any = type(self)
        known = _signature(kind).parameters
        if not named.keys() <= known.keys():
            raise unknown_arguments(named, known)
        try:
            bound = _signature(kind).bind(*values, **named)
        except TypeError as error:
            raise TypeError(f"{kind.__name__}: {error}") from None
        given = dict(bound.arguments)
        bound.apply_defaults()
        found = dict(bound.arguments)
        arm = found.get("arm")
        joints = arm.n_joints if isinstance(arm, Arm) else None
        problems = _object_problems(kind, found)
        checked, wrong = _validated(kind, given, joints)
        problems += wrong
        if "sample_time" in found and all(problem.name != "sample_time" for problem in problems):
            problems += problems_of(check_positive, "sample_time", found["sample_time"])
        raise_any(problems)
        for name, item in _shared(kind).items():
            found[name] = _kept(item, checked.get(name, found[name]), joints)
        vars(self).update(found)
        if isinstance(arm, Arm):
            what = f"the model of {kind.__name__}"
            serial_only(arm.spec, what, getattr(self, "_unsupported", UNDRIVEN))
        self.__post_init__()

    def __post_init__(self) -> None:
        """Complete the construction; every parameter is an attribute."""

    def __repr__(self) -> str:
        words = [f"{name} {text}" for name, text, _ in self._rows() if name != "arm"]
        words[_MOST_SHOWN:] = ["..."] * (len(words) > _MOST_SHOWN)
        return f"<flexarm.{type(self).__name__}: {', '.join(words)}>"

    def _repr_html_(self) -> str:
        heads = ("parameter", "value", "unit")
        return html_table(f"flexarm.{type(self).__name__}", heads, self._rows())

    def _rows(self) -> Iterator[tuple[str, str, str]]:
        """Yield name, value and unit of each parameter that is not at its default."""
        kind: Any = type(self)
        for name, item in _parameters(kind).items():
            value = getattr(self, name, None)
            plain = value.tolist() if isinstance(value, np.ndarray) else value
            if plain is not None and plain != item.default:
                yield name, shown(plain), unit_of(item.description)

    def _per_joint(self) -> list[Any]:
        """Return the values of the parameters that may have one number for each joint."""
        kind: Any = type(self)
        declared = _parameters(kind).items()
        return [getattr(self, name) for name, item in declared if item.per_joint]


def _kept(item: Declared, value: Any, joints: int | None) -> Any:
    """Return a valid value as an attribute: an array, if it is a number for each joint."""
    marker = item.per_joint
    if marker is None or value is None or isinstance(marker, ListPerJoint):
        return value
    return np.asarray(value) if joints is None else np.full(joints, value)


def _object_problems(kind: Any, found: Mapping[str, Any]) -> list[Problem]:
    """Return the problems of parameters whose type is a class of this package."""
    problems: list[Problem] = []
    for name, item in _parameters(kind).items():
        parts = get_args(item.annotation) if item.optional else (item.annotation,)
        own = isinstance(parts[0], type) and parts[0].__module__.startswith("flexarm.")
        if not own or (item.optional and found[name] is None):
            continue
        if parts[0] is Controller:
            problems += problems_of(check_controller, name, found[name])
        else:
            problems += problems_of(check_kind, name, found[name], parts[0])
    return problems


def _validated(
    kind: Any, given: Mapping[str, Any], joints: int | None
) -> tuple[Mapping[str, Any], list[Problem]]:
    """Return the validated values of those given for shared parameters, and all problems."""
    shared = _shared(kind)
    reported = {name: value for name, value in given.items() if name in shared}
    checked: Mapping[str, Any] = {}
    problems: list[Problem] = []
    try:
        checked = vars(_record(kind).model_validate(reported))
    except ValidationError as error:
        problems += [fault.problem() for fault in faults_of(error)]
    if joints is not None:
        lists = {name: value for name, value in reported.items() if shared[name].per_joint}
        problems += joint_problems(joints, lists)
    return checked, problems


@cache
def _parameters(kind: Any) -> dict[str, Declared]:
    return parameters_of(kind)


@cache
def _shared(kind: Any) -> dict[str, Declared]:
    """Return the parameters that files have, too."""
    found = _parameters(kind).items()
    return {name: item for name, item in found if not issubclass(item.owner, Parametrised)}


@cache
def _record(kind: Any) -> Any:
    return record_of(kind.__name__, "", _shared(kind))


@cache
def _signature(kind: Any) -> Signature:
    """Return the signature of a class: its parameters with plain types, as `Record` shows them."""
    found = []
    for name, item in _parameters(kind).items():
        shared = not issubclass(item.owner, Parametrised)
        words = TypeText(type_text(item.annotation) if shared else item.source)
        how = Parameter.KEYWORD_ONLY if item.keyword_only else Parameter.POSITIONAL_OR_KEYWORD
        found.append(Parameter(name, how, default=item.default, annotation=words))
    last = Parameter.KEYWORD_ONLY
    return Signature(sorted(found, key=lambda p: (p.kind, p.kind == last and p.name == _LAST)))


def _without_self(kind: Any) -> Signature:
    whole = signature(kind.__init__)
    return whole.replace(parameters=list(whole.parameters.values())[1:])


#: Errors of every constructor; a class with others writes its own section.
_RAISES = """
Raises:
    InputError: if a parameter has the wrong type or is outside its bounds, or a list does not have
        one value for each joint.
"""


class _Documented:
    """Docstring of a class; arguments and errors of its constructor are added when it is read."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __get__(self, instance: object, kind: Any) -> str:
        bases = [vars(base).get("__doc__") for base in kind.__mro__]
        texts = [base.text for base in bases if isinstance(base, _Documented)]
        text = self.text
        if "\nRaises:\n" not in text:
            errors = (part.partition("\nRaises:\n")[1:] for part in texts)
            text += "\n" + next(("".join(part) for part in errors if part[0]), _RAISES)
        entries = {name: item.description for name, item in _parameters(kind).items()}
        if not entries:
            return text
        ends = (text.find(section) for section in _AFTER_ARGS if section in text)
        at = min(ends, default=len(text))
        return "\n".join([text[:at].rstrip(), "", *args_text(entries), text[at:]]).rstrip()


class OfArm(Parametrised):
    """Base of classes whose first parameter is the arm that they have as their model."""

    #: Features of an arm that the class does not support; None: all that serial arms do not have.
    _unsupported: ClassVar[tuple[str, ...] | None] = UNDRIVEN
    arm: Arm = Field(description="Model of the arm.")
