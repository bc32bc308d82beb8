"""Base class of drives that are controllers, and the keys that several of them have."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from flexarm.model.checks import Record
from flexarm.model.quantities import Listed, NonNegative, Number, OneOrMany, Positive

Feedforward = Annotated[
    Literal["none", "rigid_inverse_dynamics"],
    Field(description="Torque added to the feedback."),
]
SampleTime = Annotated[
    Positive, Field(description="Time between updates; the torque is held in between (s).")
]
Proportional = Annotated[
    OneOrMany[NonNegative],
    Field(description="Torque per angle error, one for all joints or one each (N m/rad)."),
]
Derivative = Annotated[
    OneOrMany[NonNegative],
    Field(description="Torque per rate error, one for all joints or one each (N m s/rad)."),
]
Bandwidth = Annotated[
    OneOrMany[Positive],
    Field(description="How fast angle errors die, one for all joints or one each (1/s)."),
]
StrainGain = Annotated[
    OneOrMany[NonNegative],
    Field(
        description="Joint rate per curvature at the root of the joint's link, which needs a "
        "gauge: damps vibration (rad/s per 1/m)."
    ),
]
Washout = Annotated[
    Positive, Field(description="Curvature that changes more slowly is left alone (Hz).")
]
Posture = Annotated[
    Listed[Number] | None,
    Field(description="Joint angles to design for; zero where left out (rad)."),
]


class ControllerDrive(Record):
    """Base of drives that are controllers; keys are the arguments of the controller class.

    Omitted keys have the default of the class. Arguments that need Python objects have no key.
    """

    per_joint: ClassVar[tuple[str, ...]] = ()
    """Keys with one number for all joints, or one for each."""

    def balances(self) -> bool:
        """Return whether the controller includes gravity compensation, or accepts no feedforward.

        In both cases a scenario cannot add the torque of an equilibrium.
        """
        return not hasattr(self, "feedforward")
