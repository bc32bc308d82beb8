"""Base classes of drives that are controllers, and the parameters that several of them have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from flexarm.model.checks import Given, Record
from flexarm.model.drives.parameters import Parameters, parameters_of, record_of
from flexarm.model.quantities import NonNegative, PerJoint, Positive
from flexarm.model.wording import Fault

Feedforward = Annotated[
    Literal["none", "rigid_inverse_dynamics"],
    Field(description="Torque added to the feedback."),
]
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

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        return cls.declaration._file_faults(given)

    def balances(self) -> bool:
        """Return whether the controller includes gravity compensation, or accepts no feedforward.

        In both cases a scenario cannot add the torque of an equilibrium.
        """
        return self.declaration._file_balances(self)


def drive_of(parameters: type[ControllerParameters]) -> Any:
    """Return the class of the drives that describe a controller in a file."""
    keys = parameters_of(parameters)
    if "sample_time" in keys:  # last in every file
        keys["sample_time"] = keys.pop("sample_time")
    named = next(base for base in parameters.__mro__ if "name" in vars(base))
    name = named.__name__.removesuffix("Parameters") + "Drive"
    kind = (Literal[named.name], named.name)  # type: ignore[attr-defined]
    made = record_of(name, named.__doc__ or "", keys, ControllerDrive, kind=kind)
    made.declaration = parameters
    made.per_joint = tuple(key for key, item in keys.items() if item.per_joint)
    return made
