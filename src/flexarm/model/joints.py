"""What sits between the links and at the tip: joints and the payload. All SI units."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from flexarm.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import NonNegative, Number, Pair, Positive, plain
from flexarm.model.wording import Fault


class Friction(Record):
    """Dry friction of a joint: Coulomb's, with Stribeck's rise towards rest, regularised.

    Torque ``(coulomb + (static - coulomb) exp(-(rate / stribeck_rate)^2)) tanh(rate /
    smoothing_rate)`` against the motion: below the smoothing rate it creeps where a real joint
    sticks.
    """

    coulomb: NonNegative = Field(description="Friction torque in motion (N m).")
    static: NonNegative | None = Field(
        default=None,
        description="Torque to break loose (N m); as in motion where left out.",
    )
    stribeck_rate: Positive = Field(
        default=0.1, description="Rate at which the rise towards rest has died away (rad/s)."
    )
    smoothing_rate: Positive = Field(
        default=0.01, description="Rate below which friction turns into viscous creep (rad/s)."
    )

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        static = given.static if given.has("coulomb", "static") else None
        if static is not None and static < given.coulomb:
            rule = f"be at least coulomb, which is {given.coulomb:.9g}"
            yield Fault(("static",), rule, shown(static))


class JointLimits(Record):
    """Compliant stops at both ends of a joint's range.

    Torque ``stiffness * p * (1 + damping * p_rate)`` back into the range, with p the angle beyond
    the stop: it grows from zero, and damping takes energy on every blow (Hunt and Crossley).
    """

    lower: Number = Field(description="Smallest free joint angle (rad).")
    upper: Number = Field(description="Largest free joint angle (rad).")
    stiffness: Positive = Field(description="Torque per angle beyond a stop (N m/rad).")
    damping: NonNegative = Field(
        default=0.0, description="Relative rise of that torque per rate of approach (s/rad)."
    )

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("lower", "upper") and given.upper <= given.lower:
            rule = f"be greater than lower, which is {given.lower:.9g}"
            yield Fault(("upper",), rule, shown(given.upper))


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
    stiffness: NonNegative = Field(
        default=0.0, description="Spring beside the motor: torque per angle from rest (N m/rad)."
    )
    rest_angle: Number = Field(
        default=0.0, description="Relative joint angle at which that spring is free (rad)."
    )
    friction: Friction | None = Field(default=None, description="Dry friction; none if left out.")
    limits: JointLimits | None = Field(default=None, description="Stops; none if left out.")


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
