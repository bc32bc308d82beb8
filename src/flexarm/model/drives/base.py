"""Parameters of controllers, declared once: the arguments of a constructor and the keys of a file.

A subclass of `Parameters` annotates each parameter with its type and bounds, in the manner of a
dataclass; the docstring below a parameter has its meaning and unit. The controller class derives
from it (``flexarm.control.contract.parametrised``), and `drive_of` makes the record that reads the
same values from a file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from inspect import Parameter, cleandoc, get_annotations
from types import NoneType
from typing import Annotated, Any, ClassVar, Literal, dataclass_transform, get_args

from pydantic import Field, create_model
from pydantic.fields import FieldInfo

from flexarm.model.checks import Given, Record, field_texts
from flexarm.model.quantities import NonNegative, PerJoint, Positive
from flexarm.model.wording import Fault, look

#: Stands for the default of a parameter that has none and must be given.
REQUIRED = Parameter.empty


@dataclass(frozen=True, eq=False)
class Declared:
    """One parameter of a class."""

    name: str
    annotation: Any  # type, with bounds
    source: str  # the type in the source code
    given: Any  # default, a field, or ``REQUIRED``
    keyword_only: bool
    owner: type  # class that declares it
    inherited: Declared | None  # its declaration in a base of that class

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
    parts = [*get_args(annotation), *getattr(annotation, "__metadata__", ())]
    return next(filter(None, map(_marker, parts)), None)


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
    """Return a record class of parameters, after ``more`` fields: type and default of each."""
    fields = {
        key: (item.annotation, ... if item.given is REQUIRED else item.given)
        for key, item in declared.items()
    }
    module = {"__module__": "flexarm.model.drives", "__doc__": cleandoc(doc)}
    record: Any = create_model(name, __base__=base, **module, **more, **fields)  # type: ignore[call-overload]
    record._declared = declared
    return record


#: Torques along the motion that a drive can add to its feedback.
FeedforwardKind = Literal["none", "reference", "rigid_inverse_dynamics", "flexible_torque"]
Feedforward = Annotated[
    FeedforwardKind | None,
    Field(
        description="Torque added to the feedback: none, that of the reference, that of the rigid "
        "arm, or that with which the joints of the flexible arm follow the motion; by default that "
        "of the reference.",
    ),
]
#: Feedforward torques with which the joints, not the tip, follow the motion.
OF_JOINTS = ("rigid_inverse_dynamics", "flexible_torque")
SampleTime = Annotated[
    Positive, Field(description="Time between updates; the torque is constant in between (s).")
]
Proportional = Annotated[
    Any,
    PerJoint(NonNegative),
    Field(description="Torque per angle error (N m/rad), one for all joints or one for each."),
]
Derivative = Annotated[
    Any,
    PerJoint(NonNegative),
    Field(description="Torque per rate error (N m s/rad), one for all joints or one for each."),
]


class ControllerParameters(Parameters):
    """Base of the parameters of controllers. ``name`` is the kind of the drive in a file.

    Keys that only files have, and methods that start with ``_file``, are in a subclass, from which
    the controller does not derive.
    """

    name: ClassVar[str]
    plans_bending: ClassVar[bool] = False
    """Whether the controller computes the bending along a motion of the rigid arm itself."""
    takes_feedforward: ClassVar[bool] = False
    """Whether files have the key `feedforward`; in Python it is a function."""

    @classmethod
    def _file_faults(cls, given: Given) -> Iterator[Fault]:
        """Yield the faults between keys of a file."""
        yield from ()

    @staticmethod
    def _file_balances(drive: Any) -> bool:
        """Return what `ControllerDrive.balances` is for a drive of a file."""
        inner = getattr(drive, "inner", None)
        return not hasattr(drive, "feedforward") if inner is None else bool(inner.balances())


class ControllerDrive(Record):
    """Base of drives that are controllers; keys are the arguments of the controller class.

    Omitted keys have the default of the class. Arguments that need Python objects have no key.
    """

    declaration: ClassVar[type[ControllerParameters]]
    per_joint: ClassVar[tuple[str, ...]]
    """Keys with one number for all joints, or one for each."""

    reference: Literal["quasi_static", "integral_manifold", "tip_inversion", "rigid"] | None = None
    """Joint angles to follow: those of the statically bent arm (of lqg, mpc and composite, which
    plan the bending by inertia themselves, bent by gravity alone), of the same with the
    accelerations of its bending, of the arm under the torques of a tip inversion, or of the rigid
    arm; by default quasi_static where arm and motion allow it, of lqg, mpc and composite only under
    gravity."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if look(given.raw("inner"), "reference") is not None:
            hint = "It is a key of the outer drive."
            yield Fault(("inner", "reference"), "is not supported in an inner drive", hint=hint)
        yield from cls.declaration._file_faults(given)

    @property
    def reference_kind(self) -> str | None:
        """The kind of the reference; None or "sag" if it depends on the arm and the motion.

        "static" is that of an arm that gravity alone bends, and "sag" the same where it exists and
        the arm has gravity.
        """
        innermost: Any = self
        while getattr(innermost, "inner", None) is not None:
            innermost = innermost.inner
        planned = innermost.declaration.plans_bending
        if self.reference is None and getattr(innermost, "feedforward", None) in OF_JOINTS:
            return "rigid"
        if not planned:
            return self.reference
        return {None: "sag", "quasi_static": "static"}.get(self.reference, self.reference)

    def balances(self) -> bool:
        """Return whether the controller includes gravity compensation, or accepts no feedforward.

        In both cases a scenario cannot add the torque of an equilibrium.
        """
        return self.declaration._file_balances(self)


def drive_of(parameters: type[ControllerParameters]) -> Any:
    """Return the class of the drives that describe a controller in a file."""
    keys = parameters_of(parameters)
    if parameters.takes_feedforward and "feedforward" not in keys:
        key = Declared("feedforward", Feedforward, "Feedforward", None, True, parameters, None)
        keys[key.name] = key
    if "sample_time" in keys:  # last in every file
        keys["sample_time"] = keys.pop("sample_time")
    named = next(base for base in parameters.__mro__ if "name" in vars(base))
    name = named.__name__.removesuffix("Parameters") + "Drive"
    kind = (Literal[named.name], named.name)  # type: ignore[attr-defined]
    made = record_of(name, named.__doc__ or "", keys, ControllerDrive, kind=kind)
    made.declaration = parameters
    made.per_joint = tuple(key for key, item in keys.items() if item.per_joint)
    return made
