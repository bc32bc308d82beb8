"""Base classes of drives that are controllers, and the parameters that several of them have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from flexarm.model.checks import Given, Record
from flexarm.model.drives.parameters import Parameters, parameters_of, record_of
from flexarm.model.quantities import NonNegative, PerJoint, Positive
from flexarm.model.wording import Fault, look

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
    """Joint angles to follow: those of the statically bent arm, of the same with the accelerations
    of its bending, of the arm under the torques of a tip inversion, or of the rigid arm; by default
    quasi_static where arm and motion allow it."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if look(given.raw("inner"), "reference") is not None:
            hint = "It is a key of the outer drive."
            yield Fault(("inner", "reference"), "is not supported in an inner drive", hint=hint)
        yield from cls.declaration._file_faults(given)

    @property
    def reference_kind(self) -> str | None:
        """The kind of the reference; None if it depends on the arm and the motion."""
        if self.reference is None:
            innermost: Any = self
            while getattr(innermost, "inner", None) is not None:
                innermost = innermost.inner
            follows = getattr(innermost, "feedforward", None)
            if innermost.declaration.plans_bending or follows in OF_JOINTS:
                return "rigid"
        return self.reference

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
