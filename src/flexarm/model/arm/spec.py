"""Description of an arm: joints, links, payload, gravity and theory, and variations by factors."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator

from flexarm.base.errors import InputError, Problem, shown
from flexarm.model.arm.links import Link
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import (
    Count,
    CountOrZero,
    Flag,
    Listed,
    NonNegative,
    Number,
    Pair,
    Positive,
    length_of,
    plain,
)
from flexarm.model.wording import Fault

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


_TORQUE_HINT = "Torques are given at the joint, behind the gear."
_TURNING = (
    *("damping", "stiffness", "friction", "limits", "rotor_inertia", "backlash", "winding"),
)


class Joint(Record):
    """The joint at the root of a link: driven by a motor, or fixed.

    With `rotor_inertia` and `stiffness` it is *elastic*: a spring connects the motor to the link,
    and the joint angle is that of the motor divided by the gear ratio.
    """

    kind: Literal["revolute", "prismatic"] = "revolute"
    """Whether the joint turns (revolute) or slides (prismatic). For a sliding joint, read lengths
    for angles and forces for torques in the fields below: m for rad, N for N m, and rad/m for the
    gear ratio."""
    axis: Pair = (1.0, 0.0)
    """Direction in which a sliding joint moves its link, in the axes of the section that carries
    the joint."""
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
    """Point mass of the joint at the tip of the inboard link (kg); no effect at the first joint,
    which does not move."""
    housing_inertia: NonNegative = 0.0
    """Rotary inertia of the motor housing, fixed to the tip section of the inboard link (kg m^2);
    no effect at the first joint."""
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


def _along_x(value: Any) -> Any:
    """Convert a single number to an offset along the tip tangent."""
    one = plain(value)
    return (one, 0.0) if isinstance(one, int | float) else one


class Payload(Record):
    """A rigid body attached to the tip of the last link."""

    mass: NonNegative = 0.0
    """Mass (kg)."""
    inertia: NonNegative = 0.0
    """Rotary inertia about the payload's own centre of mass (kg m^2)."""
    offset: Annotated[Pair, BeforeValidator(_along_x, json_schema_input_type=Number | Pair)] = (
        0.0,
        0.0,
    )
    """Centre of mass from the tip, in tip axes: x along the tip tangent (m). A single number is a
    distance along x."""


MOST_LINKS = 256

Triple = tuple[NonNegative, NonNegative, NonNegative]


class Base(Record):
    """The body that carries the first joint: fixed, free to move, or elastically supported.

    Its origin is at the world's origin at rest. Joints of links with ``parent=0`` sit on it.
    """

    mass: NonNegative = 0.0
    """Mass (kg)."""
    inertia: NonNegative = 0.0
    """Rotary inertia about its centre of mass (kg m^2)."""
    centre: Pair = (0.0, 0.0)
    """Centre of mass from the origin of the base, in its axes (m)."""
    free: tuple[Literal["x", "y", "angle"], ...] = ()
    """Coordinates of the base that move: x and y along the world's axes, and its angle."""
    stiffness: Triple = (0.0, 0.0, 0.0)
    """Springs to the ground of x, y and angle, unloaded at zero (N/m, N/m, N m/rad)."""
    damping: Triple = (0.0, 0.0, 0.0)
    """Dampers to the ground of x, y and angle (N s/m, N s/m, N m s/rad)."""


class Closure(Record):
    """A connection that closes a loop: two points are pinned, welded, or slide along a line."""

    kind: Literal["pin", "weld", "line"] = "pin"
    """Equal positions (pin), also equal angles (weld), or a point on a line (line)."""
    link: Count
    """Number of the link of the first point."""
    station: NonNegative | None = None
    """Distance of the first point from the root of its link (m); by default at the tip."""
    offset: Pair = (0.0, 0.0)
    """First point from the axis of its link, in the axes of the section (m)."""
    to_link: CountOrZero | None = None
    """Number of the link of the second point, 0 for the base; by default the ground."""
    to_station: NonNegative | None = None
    """Distance of the second point from the root of its link (m); by default at the tip."""
    to_offset: Pair = (0.0, 0.0)
    """Second point from the axis of its link, in the axes of the section; of the base in its axes,
    of the ground in world axes (m)."""
    angle: Number = 0.0
    """Weld: angle of the first section from the second. Line: direction of the line from the second
    section (rad)."""


class ArmSpec(Record):
    """A planar serial arm; joint i is between the tip of link i-1 and the root of link i."""

    links: Listed[Link] = Field(json_schema_extra={"minItems": 1, "maxItems": MOST_LINKS})
    """Links from the base to the tip."""
    joints: Listed[Joint] = Field(default=(), validate_default=True)
    """One joint for each link, at its root; ideal joints by default."""
    payload: Payload = Payload()
    """Rigid body at the tip of the last link."""
    gravity: Pair = (0.0, 0.0)
    """Acceleration of gravity [x, y] in the world frame (m/s^2)."""
    base: Base = Base()
    """Body that carries the first joint; by default the ground."""
    closures: Listed[Closure] = ()
    """Connections that close loops; none by default."""
    theory: Literal["linear", "second_order"] = "linear"
    """Beam theory: linear, or second_order with shortening due to bending."""

    @field_validator("payload", mode="before")
    @classmethod
    def _no_payload(cls, value: Any) -> Any:
        """Convert None to an arm without a payload."""
        return Payload() if value is None else value

    _called: ClassVar[str] = "Arm"
    _hints: ClassVar[dict[str, str]] = {
        "gravity": "Gravity that pulls down is [0, -9.81].",
    }

    @field_validator("joints", mode="before")
    @classmethod
    def _ideal_joints(cls, value: Any, info: ValidationInfo) -> Any:
        """Return ideal joints if none are described."""
        if plain(value) in (None, [], ()):
            return (Joint(),) * len(info.data.get("links", ()))
        return value

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        # Compare the lengths of the raw values, because single links and joints may be invalid.
        links, joints = length_of(given.raw("links")), length_of(given.raw("joints"))
        if links is not None and not 1 <= links <= MOST_LINKS:
            yield Fault(("links",), f"have 1 to {MOST_LINKS} entries", str(links))
        if links and joints and joints != links:
            yield Fault(("joints",), f"have length {links}, one joint for each link", str(joints))
        if links and links == joints and given.has("links", "joints", "payload"):
            yield from _inertia_faults(given.links, given.joints, given.payload)

    @property
    def features(self) -> tuple[str, ...]:
        """Features that a serial arm on a fixed base does not have, in words; empty for those."""
        follows = all(
            (link.parent is None or link.parent == i)
            and (i == 0 or link.parent_station in (None, self.links[i - 1].length))
            for i, link in enumerate(self.links)
        )
        placed = any(any(joint.offset) or joint.mounting_angle for joint in self.joints)
        features = {
            "branches": not follows,
            "sliding joints": any(joint.kind == "prismatic" for joint in self.joints),
            "joints with an offset or a mounting angle": placed,
            "a free base": bool(self.base.free),
            "closures": bool(self.closures),
        }
        return tuple(name for name, present in features.items() if present)

    @property
    def is_serial(self) -> bool:
        """Whether every link follows the one before, without any of the `features`."""
        return not self.features



def place_faults(
    arm: ArmSpec, link: int, furthest: float | None, name: str = "station"
) -> Iterator[Fault]:
    """Yield a fault if an arm has no such link, or its distance ``name`` (m) is beyond the tip."""
    links = arm.links
    if not 1 <= link <= len(links):
        yield Fault(("link",), f"be the number of a link, 1 to {len(links)}", shown(link))
        return
    length = links[link - 1].length
    if furthest is not None and furthest > length * (1.0 + 1e-9):  # sums of lengths are rounded
        yield Fault((name,), f"be at most {length:.9g} (the length of the link)", shown(furthest))


def _inertia_faults(
    links: Sequence[Link], joints: Sequence[Joint], payload: Payload
) -> Iterator[Fault]:
    """Yield a fault for each joint whose torque acts on no inertia in any posture.

    The links between two joints that turn are fixed to each other and rotate together.
    """
    tables = [link.beam() for link in links]
    heavy = [any(table.mass_per_length) for table in tables]
    turned = [any(table.rotary_inertia_per_length or ()) for table in tables]
    turned = [own or joint.hub_inertia > 0 for own, joint in zip(turned, joints, strict=True)]
    carried = [joint.mass > 0 for joint in joints[1:]] + [payload.mass > 0]
    attached = [joint.housing_inertia > 0 for joint in joints[1:]] + [payload.inertia > 0]
    turning = [i for i, joint in enumerate(joints) if not joint.fixed]
    for i, end in zip(turning, [*turning[1:], len(joints)], strict=False):
        geared = joints[i].rotor_inertia > 0 and not joints[i].elastic
        # Bodies that rotate about a joint further out resist with their mass only.
        if geared or any(turned[i:end] + attached[i:end] + heavy[i:] + carried[i:]):
            continue
        if end < len(joints):
            hint = (
                "Give mass to the link or to bodies that it carries, or hub_inertia to its joint."
            )
            yield Fault(("links", i), "has no inertia and carries no mass", hint=hint)
        else:
            hint = "Give mass to the last link, hub_inertia to its joint, or a payload to the arm."
            yield Fault(
                ("payload", "mass"), "be greater than 0 at the tip of a massless link", "0", hint
            )


#: Features with which the coordinates of the joints do not determine the rigid posture.
UNDRIVEN = ("a free base", "closures")


def serial_only(spec: ArmSpec, what: str, unsupported: Collection[str] | None = None) -> None:
    """Raise for an arm that is not a serial arm, in a place that supports no other ones.

    Args:
        unsupported: the features that are not supported; by default all.
    """
    features = [k for k in spec.features if unsupported is None or k in unsupported]
    if features:
        listed = " and ".join(filter(None, (", ".join(features[:-1]), features[-1])))
        raise InputError(Problem(what, f"is not supported for arms with {listed}"))


def varied_spec(
    spec: ArmSpec,
    *,
    payload_factor: float = 1.0,
    payload_mass: float | None = None,
    flexural_rigidity_factor: float | Sequence[float] = 1.0,
    mass_factor: float | Sequence[float] = 1.0,
    friction: Friction | Sequence[Friction | None] | None = None,
) -> ArmSpec:
    """Return a description with changed parameters; arguments and errors as `flexarm.varied`."""
    problems: list[Problem] = []
    rigidity = _each(problems, "flexural_rigidity_factor", flexural_rigidity_factor, spec.links)
    mass = _each(problems, "mass_factor", mass_factor, spec.links)
    payload = _each(problems, "payload_factor", payload_factor, (None,), zero=True)[0]
    if payload_mass is not None:
        payload_mass = _each(problems, "payload_mass", payload_mass, (None,), zero=True)[0]
        if payload != 1.0:
            problems.append(Problem("payload_mass", "cannot be combined with payload_factor"))
    elif payload != 1.0 and spec.payload.mass == 0.0:
        rule = "is not supported for an arm without payload"
        problems.append(Problem("payload_factor", rule, hint="Give payload_mass in kg."))
    rubbing = _friction(problems, friction, spec.joints)
    if problems:
        raise InputError(*problems)
    carried = {"mass": spec.payload.mass * payload, "inertia": spec.payload.inertia * payload}
    if payload_mass is not None:
        carried = {"mass": payload_mass, "inertia": spec.payload.inertia}
    links = [_link(*item) for item in zip(spec.links, rigidity, mass, strict=True)]
    joints = [
        joint if rubs is None else joint.replace(friction=rubs)
        for joint, rubs in zip(spec.joints, rubbing, strict=True)
    ]
    return spec.replace(links=links, joints=joints, payload=spec.payload.replace(**carried))


def _each(
    problems: list[Problem], name: str, value: Any, of: Sequence[Any], zero: bool = False
) -> list[float]:
    """Return one factor for each of ``of``; all 1 if the value is invalid."""
    value = plain(value)
    values = list(value) if isinstance(value, list | tuple) else [value] * len(of)
    good = all(
        isinstance(v, (int, float))
        and not isinstance(v, bool)
        and (0.0 < v <= sys.float_info.max or (zero and v == 0.0))
        for v in values
    )
    if not good or len(values) != len(of):
        rule = f"be a number {'at least' if zero else 'greater than'} 0"
        rule += f", or one for each of the {len(of)} links" if len(of) > 1 else ""
        problems.append(Problem(name, rule, shown(value)))
        return [1.0] * len(of)
    return [float(v) for v in values]


def _friction(
    problems: list[Problem], friction: Any, joints: Sequence[Joint]
) -> list[Friction | None]:
    if friction is None:
        return [None] * len(joints)
    if isinstance(friction, Friction):
        return [None if joint.fixed else friction for joint in joints]
    listed: list[Any] = list(friction) if isinstance(friction, Sequence) else [0]
    if len(listed) != len(joints) or not all(isinstance(f, Friction | None) for f in listed):
        rule = "be a Friction, or a list with a Friction or None for each joint"
        problems.append(Problem("friction", rule, shown(friction)))
        return [None] * len(joints)
    return listed


def _link(link: Link, rigidity: float, mass: float) -> Link:
    """Return a link with scaled bending stiffness, and with scaled mass and rotary inertia."""
    if rigidity == 1.0 and mass == 1.0:
        return link
    if link.material is None and link.table is None:
        changed: dict[str, Any] = {}
        if link.flexural_rigidity is not None:
            changed["flexural_rigidity"] = link.flexural_rigidity * rigidity
        for name in ("mass_per_length", "rotary_inertia_per_length"):
            value = getattr(link, name)
            changed[name] = None if value is None else value * mass
        return link.replace(**changed)
    table = link.beam()
    columns: dict[str, Any] = {}
    if table.flexural_rigidity is not None:
        columns["flexural_rigidity"] = [rigidity * v for v in table.flexural_rigidity]
    columns["mass_per_length"] = [mass * v for v in table.mass_per_length]
    columns["rotary_inertia_per_length"] = [mass * v for v in table.rotary_inertia_per_length or ()]
    return link.replace(material=None, section=None, table=table.replace(**columns))
