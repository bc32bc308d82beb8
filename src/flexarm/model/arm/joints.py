"""Joints of an arm: springs, friction, stops, gears and motors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from flexarm.base.errors import shown
from flexarm.model.checks import Given, Record, unit_of_field
from flexarm.model.quantities import Direction, Flag, NonNegative, Number, Pair, Positive
from flexarm.model.units import in_si
from flexarm.model.wording import Fault, Path

#: Smoothing rate of functions of q and qd, relative to the rate of the Stribeck effect.
_SMOOTHED = 0.1


class Friction(Record):
    """Friction of a joint: viscous and Coulomb friction with the Stribeck effect.

    Torque ``(coulomb + (static - coulomb) exp(-(rate / stribeck_rate)^2)) sign(rate) + viscous
    rate`` against the motion. In simulations the joint sticks: at rest, friction holds it up to the
    breakaway torque ``static``. Coulomb and viscous friction may have other values at negative
    rates; static friction is above both Coulomb levels by the same amount. The formula is that of
    equal directions; for others see (R.47) on the theory page "recursion".

    Functions of q and qd, such as forward dynamics, linear models, filters, controllers and
    exports, do not stick: they have ``tanh(rate / w)`` instead of ``sign(rate)``, with a tenth of
    ``stribeck_rate`` for ``w``. With a ``smoothing_rate``, ``w`` is this rate, and simulations have
    ``tanh``, too: below the smoothing rate the joint creeps instead of sticking.

    With bristles (``bristle_stiffness``), friction has a state: the LuGre model, (R.50). The joint
    turns like a damped spring before it slips, and holds. At a constant rate the torque is that of
    the formula. Bristles act in simulations; functions of q and qd have ``tanh``.
    """

    coulomb: NonNegative
    """Friction torque in motion (N m)."""
    static: NonNegative | None = None
    """Breakaway torque (N m); by default equal to coulomb."""
    stribeck_rate: Positive = 0.1
    """Rate above which the Stribeck friction has decayed (rad/s), a property of the bearing and its
    lubricant, not of the arm."""
    smoothing_rate: Positive | None = None
    """Rate below which friction is viscous (rad/s); by default joints stick in simulations, and
    functions of q and qd have a tenth of stribeck_rate."""
    viscous: NonNegative = 0.0
    """Friction torque per rate, on the side of the motor (N m s/rad)."""
    coulomb_negative: NonNegative | None = None
    """Friction torque at negative rates (N m); by default equal to coulomb."""
    viscous_negative: NonNegative | None = None
    """Friction torque per rate at negative rates (N m s/rad); by default equal to viscous."""
    bristle_stiffness: Positive | None = None
    """Torque per angle of a sticking joint (N m/rad); by default no bristles."""
    bristle_damping: NonNegative = 0.0
    """Torque per rate of a sticking joint (N m s/rad)."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("bristle_stiffness"):
            for name in ("coulomb", "coulomb_negative"):
                if given.has(name) and getattr(given, name) == 0.0:
                    yield Fault((name,), "be positive with bristles", "0")
        loose = given.absent("bristle_stiffness") and given.has("bristle_damping")
        if loose and given.bristle_damping:
            yield Fault(("bristle_damping",), "requires bristle_stiffness")
        static = given.static if given.has("coulomb", "static") else None
        if static is not None and static < given.coulomb:
            yield Fault(("static",), f"be at least coulomb ({given.coulomb:.9g})", shown(static))

    @property
    def holds(self) -> bool:
        """Whether the joint sticks in simulations, as the default does."""
        return self.smoothing_rate is None and self.bristle_stiffness is None

    @property
    def model_rate(self) -> float:
        """Smoothing rate of functions of q and qd, rad/s."""
        if self.smoothing_rate is not None:
            return self.smoothing_rate
        return _SMOOTHED * self.stribeck_rate


class JointLimits(Record):
    """Compliant stops at both ends of a joint's range.

    Torque ``stiffness * p * (1 + damping * p_rate)`` towards the range, with p the angle beyond
    the stop. It is continuous, and damping dissipates energy in each impact (Hunt and Crossley).
    """

    lower: Number
    """Smallest free joint angle (rad)."""
    upper: Number
    """Largest free joint angle (rad)."""
    stiffness: Positive
    """Torque per angle beyond a stop (N m/rad)."""
    damping: NonNegative = 0.0
    """Relative increase of the torque of the stop per rate of approach (s/rad)."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("lower", "upper") and given.upper <= given.lower:
            rule = f"be greater than lower ({given.lower:.9g})"
            yield Fault(("upper",), rule, shown(given.upper))


class Winding(Record):
    """Winding of a direct-current motor that a voltage drives.

    The voltage less the back electromotive force drives the current: with the constant K, the gear
    ratio r and the resistance R, the torque at the joint is ``r K / R (voltage - r K rate)``. The
    inductance is neglected. The torque input of the joint is the torque at standstill, ``r K / R
    voltage``; the back electromotive force is part of the joint, as viscous damping.
    """

    torque_constant: Positive
    """Torque per current of the motor, before the gear; also its back electromotive force per rate
    (N m/A)."""
    resistance: Positive
    """Resistance of the winding and its leads (ohm)."""


#: Units of a sliding joint in place of those of a turning one.
_SLIDING = {
    "rad": "m",
    "rad/s": "m/s",
    "s/rad": "s/m",
    "N m": "N",
    "N m/rad": "N/m",
    "N m s/rad": "N s/m",
}


def unit_of_sliding(record: type[Record], name: str) -> tuple[str, bool]:
    """Return the unit of a field of a sliding joint or of a record in it, as `unit_of_field`."""
    unit, maps = unit_of_field(record, name)
    if name == "gear_ratio":
        return "rad/m", maps
    return unit if name == "mounting_angle" else _SLIDING.get(unit, unit), maps


class _WrongUnit(str):
    """Text that is not converted again; its fault replaces that of a text in place of a number."""

    __slots__ = ()


_TORQUE_HINT = "Torques are given at the joint, behind the gear."
_TURNING = (
    *("damping", "stiffness", "friction", "limits", "rotor_inertia", "backlash", "winding"),
)


class Joint(Record):
    """The joint at the root of a link: driven by a motor, or fixed; it turns or slides.

    With `rotor_inertia` and `stiffness` it is *elastic*: a spring connects the motor to the link,
    and the joint angle is that of the motor divided by the gear ratio.
    """

    kind: Literal["revolute", "prismatic"] = "revolute"
    """Whether the joint turns (revolute) or slides (prismatic). The fields of a sliding joint have
    lengths for angles and forces for torques: m for rad, N for N m, and rad/m for the gear ratio.
    Its mounting_angle is an angle."""
    axis: Direction | None = Field(default=None, validate_default=True)
    """Direction in which a sliding joint moves its link, in the axes of the section that carries
    the joint, of any length; by default [1, 0]."""
    offset: Pair = (0.0, 0.0)
    """Position of the joint from the point that carries it, in the axes of that section (m)."""
    mounting_angle: Number = 0.0
    """Angle of the root tangent of the link from the section that carries the joint, at a joint
    angle of zero or at any position of a sliding joint (rad)."""
    fixed: Flag = False
    """Whether the joint is rigid at rest_angle; otherwise it is driven by a motor."""
    hub_inertia: NonNegative = 0.0
    """Rotary inertia fixed to the root of the outboard link (kg m^2)."""
    mass: NonNegative = 0.0
    """Point mass of the joint, fixed to the section that carries it (kg); no effect on a base that
    does not move."""
    housing_inertia: NonNegative = 0.0
    """Rotary inertia of the motor housing, fixed to the section that carries the joint (kg m^2); no
    effect on a base that does not turn."""
    damping: NonNegative = 0.0
    """Viscous damping: torque per relative joint rate (N m s/rad); for an elastic joint, per rate
    of its spring."""
    stiffness: NonNegative = 0.0
    """Spring: torque per angle, parallel to the motor (N m/rad); with rotor_inertia, between motor
    and link."""
    rest_angle: Number = 0.0
    """Relative angle at which the spring is unloaded, or at which the joint is fixed (rad)."""
    rotor_inertia: NonNegative = 0.0
    """Rotary inertia of the motor's rotor about its own axis (kg m^2)."""
    gear_ratio: Positive = 1.0
    """Rotor turns per joint turn, in the same direction."""
    friction: Friction | None = None
    """Friction; none by default."""
    limits: JointLimits | None = None
    """Stops; none by default."""
    backlash: NonNegative = 0.0
    """Angle between the contacts of the gear in both directions, in which the spring of an elastic
    joint transmits no torque (rad)."""
    winding: Winding | None = None
    """Winding of a motor driven by a voltage; none by default."""

    @field_validator("axis", mode="before")
    @classmethod
    def _default_axis(cls, value: Any, info: ValidationInfo) -> Any:
        """Return the default of a sliding joint; a turning joint has no axis."""
        return (1.0, 0.0) if value is None and info.data.get("kind") == "prismatic" else value

    @classmethod
    def _in_si(cls, data: dict[str, Any]) -> tuple[Mapping[str, Any], dict[Path, Fault]]:
        if data.get("kind") != "prismatic":
            return super()._in_si(data)
        # Friction and limits do not know their joint, so their numbers are converted here, too.
        changed, faults = in_si(data, partial(unit_of_sliding, cls))
        for name, record in (("friction", Friction), ("limits", JointLimits)):
            if isinstance(data.get(name), dict):
                inside, wrong = in_si(data[name], partial(unit_of_sliding, record))
                kept = {path[0]: _WrongUnit(inside[str(path[0])]) for path in wrong}
                changed = {**changed, name: {**inside, **kept}}
                faults |= {(name, *path): fault.inside(name) for path, fault in wrong.items()}
        return changed, faults

    @property
    def elastic(self) -> bool:
        """Whether a spring connects motor and link, which adds a coordinate."""
        return self.rotor_inertia > 0.0 and self.stiffness > 0.0

    @property
    def torque_per_voltage(self) -> float:
        """Torque at standstill per voltage (N m/V), at the joint; 0 without a winding."""
        if self.winding is None:
            return 0.0
        return self.gear_ratio * self.winding.torque_constant / self.winding.resistance

    @property
    def braking(self) -> float:
        """Torque of the back electromotive force per rate (N m s/rad), at the joint."""
        if self.winding is None:
            return 0.0
        return self.torque_per_voltage * self.gear_ratio * self.winding.torque_constant

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("kind", "axis") and given.kind == "revolute":
            yield Fault(("axis",), "requires kind prismatic")
        if given.has("fixed") and given.fixed:
            for name in _TURNING:
                if given.has(name) and given.raw(name):
                    yield Fault((name,), "is not supported for a fixed joint")
            return
        springs = given.has("stiffness", "rotor_inertia", "rest_angle")
        if springs and given.stiffness and given.rotor_inertia and given.rest_angle:
            hint = "The spring of a joint with rotor_inertia connects motor and link."
            yield Fault(("rest_angle",), "be 0 for an elastic joint", shown(given.rest_angle), hint)
        geared = given.has("gear_ratio", "rotor_inertia") and given.gear_ratio != 1.0
        if geared and not given.rotor_inertia and given.absent("winding"):
            rule = "requires rotor_inertia or winding"
            yield Fault(("gear_ratio",), rule, hint=_TORQUE_HINT)
        springs = given.has("backlash", "stiffness", "rotor_inertia")
        if springs and given.backlash and not (given.stiffness and given.rotor_inertia):
            yield Fault(("backlash",), "requires stiffness and rotor_inertia")
