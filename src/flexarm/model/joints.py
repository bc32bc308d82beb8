"""What sits between the links and at the tip: joints and the payload. All SI units."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from flexarm.model.checks import Record
from flexarm.model.quantities import NonNegative, Number, Pair, plain


class Joint(Record):
    """An actuated revolute joint at the root of a link."""

    hub_inertia: NonNegative = Field(
        default=0.0,
        description="Rotary inertia that turns with the root of the outboard link (kg m^2).",
    )
    mass: NonNegative = Field(
        default=0.0,
        description="Mass of the joint, carried as a point by the tip of the inboard link (kg); "
        "without effect at the first joint, which does not move.",
    )
    housing_inertia: NonNegative = Field(
        default=0.0,
        description="Rotary inertia of the motor housing, fixed to the tip section of the inboard "
        "link (kg m^2); without effect at the first joint.",
    )
    damping: NonNegative = Field(
        default=0.0, description="Viscous damping: torque per relative joint rate (N m s/rad)."
    )


def _along_x(value: Any) -> Any:
    """Read a single number as an offset along the tip tangent."""
    one = plain(value)
    return (one, 0.0) if isinstance(one, int | float) else one


class Payload(Record):
    """A rigid body attached to the tip of the last link."""

    mass: NonNegative = Field(default=0.0, description="Mass (kg).")
    inertia: NonNegative = Field(
        default=0.0, description="Rotary inertia about the payload's own centre of mass (kg m^2)."
    )
    offset: Annotated[Pair, BeforeValidator(_along_x, json_schema_input_type=Number | Pair)] = (
        Field(
            default=(0.0, 0.0),
            description="Centre of mass from the tip, in tip axes: x along the tip tangent (m). "
            "A single number is a distance along x.",
        )
    )
